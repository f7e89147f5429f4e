"""How large the sensors' noise is, and how well a filter predicts: both from its innovations."""

from __future__ import annotations

import math

from flex_payload_estimator.estimators.rpe.products import inner
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# Memory of the noise's scale and of the misfit, s: a burst of noise is over soon after its end.
MEMORY_S = 0.5
# And in samples, at least.
FEWEST = 30.0
# One sample counts as no more than this many variances of the noise known so far.
LARGEST = 30.0
# What the robot file's noise is worth at the start, in readings.
PRIOR = 8.0
# Noise whose variance is so many times what it was taken for has misled a filter.
NOISIER = 4.0
# The sensors may be this much noisier than the robot file says, in the logarithm of a variance.
NOISE_DOUBT = 2.0
# Where innovations are zero both would be, and have no logarithm.
SMALLEST_SCALE, SMALLEST_MISFIT = 1e-6, 1e-4
# A false alarm comes no more often than once in this long in motion, s.
APART_S = 3600.0


def new_record(channels: int) -> Array:
    """
    Return the memory of a new filter, (m + 11,).

    Noise variance over the robot file's for each channel, (m,); then for angles and gauges what
    says that it has fallen, readings since then and their sum, (2, 3); the readings that told it,
    (2,), and the mean square of the whitened innovations, (2,); samples.
    """
    return np.concatenate([np.ones(channels), np.zeros(6), [PRIOR, PRIOR, 1.0, 1.0, 0.0]])


@compiled
def rare(step: float) -> float:
    """
    Return the nats that one hypothesis must gain over another which may hold, at a step T, s.

    Page's sum, and any likelihood ratio that begins anew with each sample, passes h by chance once
    in e^h samples or more rarely (Lorden, Ann. Math. Statist. 42, 1971): h = ln(APART_S / T).
    """
    return math.log(APART_S / step)


@compiled
def weigh(record: Array, innovation: Array, before: Array, variances: Array, scores: Array,
          log_det: float, told: Array, gate: float, step: float) -> tuple[float, float, float]:
    """
    Bring the record up to date; return a sample's log-likelihoods: as judged, and as stated.

    The third is what the samples since gain where the noise is found to have fallen a while ago,
    else 0; both others have it as well.

    What changes from one innovation to the next is noise, what stays is the model's error:
    (e_k - e_{k-1})^2 / 2 is compared with what the filter expects of it. A filter that expects
    more than it sees (a model error that is not white) is judged by what it sees; what it says of
    its payload counts as it was stated.

    Parameters
    ----------
    record : Array
        See new_record.
    innovation, before : Array
        Of this sample and the last, rad and m/m, (m,).
    variances, scores, log_det : Array, Array, float
        Expected of the innovation, and the same whitened, (m,); ln |Sigma|.
    told : Array
        Variances of the noise as the robot file has them, (m,).
    gate : float
        See correction.correct.
    step : float
        T, s.

    """
    channels = innovation.size
    most = max(MEMORY_S / step, FEWEST)
    steps, fallen = record[channels + 10], 0.0
    cut = min(1.0, gate / max(inner(scores, scores), 1e-300))
    log = stated = log_det
    for kind in range(2):
        first, last = (0, 2) if kind == 0 else (2, channels)
        count, place = last - first, channels + 8 + kind
        square = cut / count * inner(scores[first:last], scores[first:last])
        fit = min(max(record[place], SMALLEST_MISFIT), 1.0)
        log += count * (square / fit + np.log(fit))
        stated += count * square
        record[place] += max(1.0 / (steps + 10.0), 1.0 / most) * (square - record[place])
        since = record[channels + 3 * kind:channels + 3 * kind + 3]
        fallen += _read_noise(record, since, channels + 6 + kind, first, last, innovation, before,
                              variances, told, record[place] - 1.0, most, rare(step))
    record[channels + 10] = steps + 1.0
    return fallen - 0.5 * log, fallen - 0.5 * stated, fallen


@compiled
def _read_noise(found: Array, since: Array, place: int, first: int, last: int,
                innovation: Array, before: Array, variances: Array, told: Array, excess: float,
                most: float, least: float) -> float:
    """
    Bring the scale of one kind of channels up to date, and at `place` what told it.

    That it has fallen, NOISIER times, counts from when that was best to begin (Page). Where this
    gains `least`, nats, the readings since alone tell the scale. Returns what they gain by that
    beyond it, else 0.
    """
    scale, kept = found[first], min(found[place], most * (last - first))
    total = told_by = seen = fell = 0.0
    for i in range(first, last if found[-1] > 0.0 else first):
        expected = scale * told[i]
        change = innovation[i] - before[i]
        change *= 0.5 * change
        trust = (expected / variances[i])**2
        told_by += trust
        reading = (change - max(variances[i] - expected, 0.0)) / told[i]
        total += trust * min(reading, LARGEST * scale)
        # No model error is less noise: where that shows, all of it counts.
        square = innovation[i] * innovation[i]
        less = variances[i] / (variances[i] - (1.0 - 1.0 / NOISIER) * expected)
        fell += 0.5 * (np.log(less) - (less - 1.0) * square / variances[i])
        # What is to be expected of the noise's square now (as in the EM algorithm).
        seen += trust * square / told[i] + scale * (1.0 - expected / variances[i])
        if excess > 0.0:
            # More than all that is expected is noise as well.
            trust = min(excess, 1.0)
            told_by += trust
            total += trust * scale * min(change / variances[i], LARGEST)
    # A scale that few readings have told comes down by itself.
    known = kept == most * (last - first)
    found[place], former = kept + told_by, scale
    scale = max((kept * scale + total) / found[place], SMALLEST_SCALE)
    gain, since[0] = 0.0, max(since[0] + fell, 0.0) if known else 0.0
    since[1], since[2] = since[1] + last - first, since[2] + seen
    if since[0] > least:
        scale = max(since[2] / since[1], SMALLEST_SCALE)
        found[place], ratio = since[1], scale / former
        gain = max(0.5 * since[1] * (ratio - 1.0 - np.log(ratio)) - least, 0.0)
    if not 0.0 < since[0] <= least:
        since[:] = 0.0
    for i in range(first, last):
        found[i] = scale
    return gain


def misfit_of(record: Array) -> float:
    """Return the larger of the angles' and the gauges' mean square of whitened innovations."""
    return max(record.item(-3), record.item(-2))


def belief(record: Array) -> float:
    """Return the log-density, before any sample, of how large a filter takes the noise to be."""
    larger = np.log(np.maximum(record[[0, 2]], 1.0))
    return float(-0.5 * (larger @ larger) / NOISE_DOUBT**2)
