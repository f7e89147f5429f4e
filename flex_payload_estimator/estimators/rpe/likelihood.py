"""The likelihood of a filter's innovations, their running statistics, and the sensors' noise."""

from __future__ import annotations

import math

from flex_payload_estimator.estimators.rpe.small_matrices import inner
from flex_payload_estimator.kalman.in_place import Numbers, numbers
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
from flex_plant_sim.tiny import TINY
import numpy as np
from scipy.special import chdtrc, chdtri

# Memory of the noise's scale and of the reduced chi-square, s, so that a burst of noise is over
# soon after its end; and in samples, at least.
MEMORY_S, MEMORY_SAMPLES = 0.5, 30.0
# One reading of the noise counts as no more than this many variances of the noise known so far.
LARGEST_READING = 30.0
# What the robot file's noise counts for at the start, in readings.
PRIOR_READINGS = 8.0
# Noise whose variance is so many times what it was taken for has misled a filter. A drop counts
# from the inverse ratio on.
NOISE_RATIO = 4.0
# A model does not fit where the reduced chi-square of its innovations is above this. At 100 Hz the
# memory tells as much as 99 samples, so this is four of the standard deviations that two angles
# have by chance, (1 / 99)^(1/2).
POOR_FIT = 1.4
# A filter's mean square begins at 1, which counts for so many samples: chosen, so that none of the
# first ones alone decides whether it is above POOR_FIT.
FIRST_SAMPLES = 10.0
# Where the sums of the payload's score are among the statistics.
SCORE = slice(-9, -3)
# Smallest scale and reduced chi-square, where innovations are zero and these have no logarithm.
SMALLEST_SCALE, SMALLEST_CHI_SQUARE = 1e-6, 1e-4
# Share of the samples of a model that fits that are beyond the gate: that of the squares of six
# standard normal numbers, of two angles and four gauges, that sum to more than 44. At 100 Hz that
# is one sample in a day and a half.
BEYOND_GATE = float(chdtrc(6, 44.0))
# Mean time in motion between two false alarms, at least, s.
FALSE_ALARM_S = 3600.0


def gate_of(channels: int) -> float:
    """
    Return the largest e' Sigma^-1 e of a sample; beyond it the sample's noise counts as larger.

    It grows with the number of channels, m, as a sum of so many squares does: chi-squared with m
    degrees of freedom is beyond it with the probability BEYOND_GATE.
    """
    return float(chdtri(channels, BEYOND_GATE))


def initial_statistics(channels: int) -> Array:
    """
    Return the statistics of a new filter, (m + 17,), for m channels.

    In this order: noise variance over that of the robot file, of each channel, (m,); for angles
    and for gauges, Page's sum for a drop of the noise, nats, the number of readings since it was
    zero and their sum, (2, 3); number of readings by which the noise's scale is known, (2,); sums
    of the payload's score, see score.py, (6,); mean square of the whitened innovations, (2,);
    number of samples.
    """
    return np.concatenate([np.ones(channels), np.zeros(6),
                           [PRIOR_READINGS, PRIOR_READINGS], np.zeros(6), [1.0, 1.0, 0.0]])


@compiled
def false_alarm_threshold(step: float) -> float:
    """
    Return the log-likelihood ratio from which a hypothesis replaces another one, nats.

    Page's sum, and any likelihood ratio that begins anew with each sample, passes h by chance at
    most once in e^h samples (Lorden, Ann. Math. Statist. 42, 1971), so h = ln(FALSE_ALARM_S / T).

    Parameters
    ----------
    step : float
        T, s.

    """
    return math.log(FALSE_ALARM_S / step)


@compiled
def update_statistics(statistics: Array, innovation: Array, before: Array, variances: Array,
                      scores: Array, log_det: float, told: Array, least: float, gate: float,
                      step: float) -> tuple[float, float]:
    """
    Update the statistics by an innovation, and return the sample's log-likelihoods.

    Parameters
    ----------
    statistics : Array
        See initial_statistics; changed.
    innovation, before, variances, told, least : Array and float
        See `_read_noise`, of all channels, (m,).
    scores, log_det, gate, step : Array, float, float, float
        L^-1 e with L L' = Sigma, (m,); ln |Sigma|; see measurement_update.correct; T, s.

    Returns
    -------
    log_density, stated : float
        Log-likelihood of the sample, nats, without the constant. Sigma is scaled, for angles and
        gauges, by the reduced chi-square so far where that is below 1: otherwise a filter whose
        model error is not white, and that expects more than it sees, could not be compared.
        Then the same with Sigma as stated, for comparisons of payloads in one mode.

    """
    channels, memory = innovation.size, max(MEMORY_S / step, MEMORY_SAMPLES)
    samples = statistics[channels + 16]
    gate_share = min(1.0, gate / max(inner(scores, scores), TINY))
    minus_twice_log = minus_twice_stated = log_det
    for kind in range(2 if channels > 2 else 1):
        first, last = (0, 2) if kind == 0 else (2, channels)
        count, place = last - first, channels + 14 + kind
        square = gate_share / count * inner(scores[first:last], scores[first:last])
        fit = min(max(statistics[place], SMALLEST_CHI_SQUARE), 1.0)
        minus_twice_log += count * (square / fit + np.log(fit))
        minus_twice_stated += count * square
        statistics[place] += max(1.0 / (samples + FIRST_SAMPLES), 1.0 / memory) \
            * (square - statistics[place])
        drop = statistics[channels + 3 * kind:channels + 3 * kind + 3]
        _update_noise(
            statistics, drop, channels + 6 + kind, first, last, innovation, before, variances,
            told, least, statistics[place] - 1.0, memory, false_alarm_threshold(step))
    statistics[channels + 16] = samples + 1.0
    return -0.5 * minus_twice_log, -0.5 * minus_twice_stated


@compiled
def _update_noise(statistics: Array, drop: Array, place: int, first: int, last: int,
                  innovation: Array, before: Array, variances: Array, told: Array, least: float,
                  excess: float, memory: float, threshold: float) -> None:
    """
    Update the noise's scale of one kind of channels.

    A drop of the variance to 1 / NOISE_RATIO counts from when it was best to begin (Page's sum).
    Where that passes the threshold, the readings since then alone give the scale.

    Parameters
    ----------
    statistics, drop : Array
        All statistics, and those of a drop of this kind's noise, (3,); changed.
    place, first, last : int
        Where the number of readings is among the statistics; the kind's channels.
    innovation, before, variances, told, least, excess
        See `_read_noise`; of all channels, (m,).
    memory, threshold : float
        Samples; nats.

    """
    scale, known = float(statistics[first]), min(statistics[place], memory * (last - first))
    readings, total, drop_ratio, expected_squares = _read_noise(
        scale, least, excess, numbers(innovation[first:last]), numbers(before[first:last]),
        numbers(variances[first:last]), numbers(told[first:last])) \
        if statistics[-1] > 0.0 else (0.0, 0.0, 0.0, 0.0)
    # Page's sum begins once the memory is full; until then few readings move the scale anyway.
    is_full = known == memory * (last - first)
    statistics[place] = known + readings
    scale = max((known * scale + total) / statistics[place], SMALLEST_SCALE)
    drop[0] = max(drop[0] + drop_ratio, 0.0) if is_full else 0.0
    drop[1], drop[2] = drop[1] + last - first, drop[2] + expected_squares
    if drop[0] > threshold:
        scale = max(drop[2] / drop[1], SMALLEST_SCALE)
        statistics[place] = drop[1]
    if not 0.0 < drop[0] <= threshold:
        drop[:] = 0.0
    for i in range(first, last):
        statistics[i] = scale


@compiled
def _read_noise(scale: float, least: float, excess: float, innovation: Numbers, before: Numbers,
                variances: Numbers, told: Numbers) -> tuple[float, float, float, float]:
    """
    Return number and sum of a sample's readings of the noise of one kind of channels.

    Then the log-likelihood ratio of a drop, nats, and the sum of the noise's expected squares.
    What changes from one innovation to the next is noise, what stays is the model's error. So
    the noise's variance is read from (e_k - e_{k-1})^2 / 2, compared with what the filter expects
    of it.

    Parameters
    ----------
    scale, least, excess : float
        Variance of the noise over that of the robot file, and the least that the filter takes for
        it; reduced chi-square, less 1.
    innovation, before : Array
        e of this sample and of the last, rad and m/m.
    variances, told : Array
        Expected variance of e, and the robot file's of the noise.

    """
    readings = total = drop_ratio = expected_squares = 0.0
    taken = max(scale, least)
    for i in range(len(innovation)):
        noise = taken * told[i]
        change = innovation[i] - before[i]
        change *= 0.5 * change
        # A channel whose innovation is mostly noise counts as one reading, any other as less.
        weight = (noise / variances[i])**2
        readings += weight
        reading = (change - max(variances[i] - noise, 0.0)) / told[i]
        total += weight * min(reading, LARGEST_READING * scale)
        # The whole innovation counts here, with the model error in it, so that a model error
        # that shows speaks against a drop.
        square = innovation[i] * innovation[i]
        ratio = variances[i] / (variances[i] - (1.0 - 1.0 / NOISE_RATIO) * noise)
        drop_ratio += 0.5 * (math.log(ratio) - (ratio - 1.0) * square / variances[i])
        # Expected square of the noise given this innovation, as in the EM algorithm.
        expected_squares += weight * square / told[i] + taken * (1.0 - noise / variances[i])
        if excess > 0.0:
            # What exceeds everything that is expected counts as noise too.
            weight = min(excess, 1.0)
            readings += weight
            total += weight * scale * min(change / variances[i], LARGEST_READING)
    return readings, total, drop_ratio, expected_squares


def reduced_chi_square(statistics: Array) -> float:
    """
    Return the reduced chi-square of the innovations, the square of Birge's ratio.

    That is the recent mean square of the whitened innovations, 1 where the model fits; the larger
    of that of the angles and that of the gauges.
    """
    return max(statistics.item(-3), statistics.item(-2))
