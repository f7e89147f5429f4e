"""
The regression (24)-(28) of SF1 on the composite measurement, and the variance of its errors.

`take_sample` compares a prediction of `joint.py` with a sample. Where a regression is due, it
updates the payload by SF1 (29) and the covariance of its error.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from flex_payload_estimator.estimators.sf1.adaptation import sf1_step, told_share
from flex_payload_estimator.estimators.sf1.composite import regression
from flex_payload_estimator.estimators.sf1.joint import (
    add_symmetric,
    at_known_payload,
    moved,
    take_gain,
    take_slope,
    Track,
)
from flex_payload_estimator.kalman.in_place import add, add_outer, put_matrix, row_products
from flex_payload_estimator.model.tabulated import times
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
from flex_plant_sim.tiny import TINY
import numpy as np

# Time constant over which noise and excitation are averaged, s.
MEMORY = 1.0
# The regressor shows the payload where its mean power is above this multiple of what noise alone
# would give: with as few as 20 independent samples in a MEMORY, chi-square exceeds it once in 2e8.
SIGNIFICANT = 4.0
# The same for one sample, six standard deviations: by noise alone once in 5e8 samples, two months
# at the interval of (30).
EVIDENT = 36.0


class SF1Constants(NamedTuple):
    """
    Constants of the regression, the same for all samples.

    Attributes
    ----------
    weights, row : Array
        See CompositeMeasurement; the row ends in a 0 for the payload, (n + 1,).
    output, rows : Array
        C-bar, (m, n), and the same with a column of 0 for the payload, (m, n + 1).
    sensors : Array
        Variances of the sensors' noise v, (m,).
    scale : Array
        Factors from (rad, rad, m/m…) to (rad, rad, V…), (m,).
    noise : float
        w' V w with the sensors' variances V, rad^2.
    tuned, reference : float
        w' R_2 w, and the variance to which the composite innovation settles, rad^2.
    alpha_0, alpha_1, payload_max, prior : float
        Constants of (29), the largest payload, kg, and its variance before any sample, kg^2.
    fading : float
        Time from one regression to the next, as a share of MEMORY.
    passing : float
        Time from one sample to the next, as a share of MEMORY.
    resolvent : bool
        Whether to normalise psi and phi, to ignore a regressor that noise explains, to carry the
        state on by (24), and to estimate the lag from the innovations.

    """

    weights: Array
    row: Array
    output: Array
    rows: Array
    sensors: Array
    scale: Array
    noise: float
    tuned: float
    reference: float
    alpha_0: float
    alpha_1: float
    payload_max: float
    prior: float
    fading: float
    passing: float
    resolvent: bool


class SF1State(NamedTuple):
    """
    What SF1 has estimated, beside the state of the arm.

    Attributes
    ----------
    mass, p, variance : float
        m_p (kg), P of (29), and the variance of the error of mass (kg^2).
    excitation : float
        Power of the regressor phi over that which noise alone would give it, averaged over
        MEMORY.
    lag, spread : float
        Present error of payload and state as a multiple of Track.doubt, as the innovations show
        it, and the variance of that multiple.
    level : float
        Mean square of the innovations over their stated standard deviation, averaged over
        MEMORY.
    misfit : float
        The level, averaged over what the samples have told of the payload: Birge's ratio of
        those that the estimate rests on.

    """

    mass: float
    p: float
    variance: float
    excitation: float
    lag: float
    spread: float
    level: float
    misfit: float


@compiled
def take_sample(predicted: tuple[Any, ...], scaled: Array, due: bool, before: tuple[float, ...],
                constants: tuple[Any, ...], reading: Array) -> tuple[float, tuple[float, ...]]:
    """
    Compare a prediction with a sample and, where due, regress on it by (28), (29).

    Named tuples are passed and returned as plain ones, see joint.moved.

    Parameters
    ----------
    predicted : tuple
        A Track; where a regression is due, it is updated in place.
    scaled : Array
        The sample, rad and V, (m,).
    due : bool
        Whether to regress on it.
    before : tuple
        An SF1State.
    constants : tuple
        An SF1Constants.
    reading : Array
        Becomes the innovation and its standard deviation in rad and m/m, (2, m).

    Returns
    -------
    tuple
        The mean square of their ratio, and the new SF1State.

    """
    track, known, given = Track(*predicted), SF1State(*before), SF1Constants(*constants)
    innovation = scaled - np.dot(given.output, track.state)
    variance = _innovation_variance(track.joint, track.part[1], track.doubt,
                                    known.lag * known.lag + known.spread, given.output, given.rows,
                                    given.sensors)
    reading[0], reading[1] = innovation / given.scale, np.sqrt(variance) / given.scale
    surprise = np.dot(innovation, innovation / variance) / len(scaled)
    level = known.level + given.passing * (surprise - known.level)
    if due:
        known = _regress(track, scaled, known, given, level)
    return surprise, (known.mass, known.p, known.variance, known.excitation, known.lag,
                      known.spread, level, known.misfit)


@compiled
def _innovation_variance(joint: Array, slope: Array, doubt: Array, lags: float, output: Array,
                         rows: Array, sensors: Array) -> Array:
    """
    Return the variance of the innovation, rad^2 and V^2, (m,), from Track and SF1Constants.

    The variance that the doubt contributes is multiplied by `lags`, the lag's second moment.
    """
    n = slope.size
    image, shown = np.dot(rows, joint), np.dot(output, slope)
    # The payload's error also acts through what it has added to the state since the last
    # regression, see `take_slope`.
    variance = (row_products(image, rows) + shown * (2.0 * image[:, n] + joint[n, n] * shown)
                + sensors)
    # Once a model has diverged, no digit of its covariance is left.
    variance = np.where(variance > 0.0, variance, np.nan)
    # The joint covariance holds the doubt once; replace that part by its second moment.
    swung = (times(rows, doubt) + shown * doubt[n])**2
    return np.maximum(variance - swung, sensors) + lags * swung


@compiled
def predict_and_take_sample(
        prediction: tuple[Any, ...], scaled: Array, due: bool, before: tuple[float, ...],
        constants: tuple[Any, ...], reading: Array) -> tuple[float, tuple[float, ...]]:
    """Call joint.moved with the arguments `prediction`, then `take_sample`: saves one call."""
    moved(*prediction)
    return take_sample(prediction[1], scaled, due, before, constants, reading)


@compiled
def _regress(track: Track, scaled: Array, known: SF1State, given: SF1Constants, present: float
             ) -> SF1State:
    """Update payload, state and their covariance by one regression; return the new SF1State."""
    n, before = len(track.state), track.joint[-1, -1]
    excess = _excitation_ratio(track, given.row[:n])
    # Bounded, so that it has decayed one MEMORY after the arm has come to rest.
    excitation = min((1.0 - given.fading) * known.excitation + given.fading * excess,
                     math.e * SIGNIFICANT)
    shown = excitation > SIGNIFICANT or excess > EVIDENT
    mass, p, gain, innovation, true = _sf1_update(track, scaled, known, given, shown, excess)
    slope, change = _apply_payload_change(track.state, track.part, true, gain, mass - known.mass,
                                          given.resolvent)
    lag, spread = known.lag, known.spread
    if shown and lag == 0.0 and spread == 1.0:
        # The first regression that shows the payload. The stated variance was 1 / level of that of
        # the innovations: only this share of the state's error is what the doubt did to it. The
        # rest has lost its phase.
        level = max(known.level, 1.0) if given.resolvent else 1.0
        add(track.doubt[:n], level**-0.5 - 1.0, track.doubt[:n])
    seen, noise = _update_covariance(track, slope, change, given)
    if shown and given.resolvent:
        lag, spread = update_lag(lag, spread, innovation, seen, noise, 1.0 - given.fading)
    with_noise = _add_noise(track.joint, track.start, change, given.noise)
    track.noisy[:] = 0.0
    add_outer(track.noisy, -change, given.weights)
    if mass + lag * track.doubt[n] < 0.0:
        # A negative payload: so far off, errors are not linear, and what they showed is forgotten.
        lag, spread = 0.0, 1.0
    doubt = track.doubt[n]**2
    misfit = known.misfit + told_share(before, with_noise, given.prior) * (present - known.misfit)
    # Birge's ratio accounts for noise above the robot file's and for a wrong model. It does not
    # scale the lag, which is a mean.
    ratio = max(misfit, 1.0) if given.resolvent else 1.0
    variance = ratio * (max(with_noise - doubt, 0.0) + spread * doubt) + lag * lag * doubt
    return SF1State(mass, p, variance, excitation, lag, spread, known.level, misfit)


@compiled
def _sf1_update(track: Track, scaled: Array, known: SF1State, given: SF1Constants, shown: bool,
                ratio: float) -> tuple[float, float, float, float, float]:
    """
    Return mass, P and gain of (29), the composite innovation, rad, and the share `true` of phi^2.

    Only that share, which noise does not explain, carries the payload's error.
    """
    row, part, part_0 = given.row[:len(track.state)], track.part[0], track.state.copy()
    add(part_0, -known.mass, part)
    psi, phi = regression(row, np.dot(given.weights, scaled), part_0, part)
    innovation, weight = psi - phi * known.mass, 1.0
    if given.resolvent:
        weight = given.reference / (np.dot(row, times(track.covariance, row)) + given.tuned)
        phi = phi if shown else 0.0
    true = 1.0 if phi == 0.0 else max(1.0 - 1.0 / ratio, 0.0) if shown else 0.0
    free, p, gain = sf1_step(known.mass, known.p, psi, phi, weight, given.alpha_0, given.alpha_1)
    mass = min(max(free, 0.0), given.payload_max)
    if mass != free:
        # A payload that stops at its limit takes only a part of the gain, and so does its error.
        gain *= (mass - known.mass) / (free - known.mass)
    return mass, p, gain, innovation, true


@compiled
def _apply_payload_change(state: Array, part: Array, true: float, gain: float, change: float,
                          carry: bool) -> tuple[Array, Array]:
    """
    Move the state by a change of the payload, kg, (24), if `carry`; return slope and gain.

    Both are those of the errors (xi, epsilon), (n + 1,), as `take_slope` and `take_gain` want
    them. `true` is the share of phi^2 that noise does not explain, `gain` is SF1's kappa.
    """
    n = state.size
    slope, gains = np.zeros(n + 1), np.zeros(n + 1)
    add(slope[:n], true, part[1])
    gains[n] = gain
    if carry:
        add(gains[:n], gain, part[0])
        add(state, change, part[0])
    return slope, gains


@compiled
def _add_noise(joint: Array, start: Array, change: Array, noise: float) -> float:
    """
    Return the payload's variance after a regression with the sensors' noise in it, kg^2.

    The covariance of xi at a known payload is written to `start`; `joint` stays without the noise,
    which acts again in the next prediction.
    """
    noisy = joint.copy()
    add_symmetric(noisy, change, change * (0.5 * noise))
    variance = float(noisy[-1, -1])
    put_matrix(start, at_known_payload(noisy))
    return variance


@compiled
def _update_covariance(track: Track, slope: Array, change: Array, given: SF1Constants
                       ) -> tuple[float, float]:
    """
    Update joint covariance and doubt by a regression.

    Return the doubt's contribution to the composite innovation, rad, and the variance of the rest,
    rad^2.
    """
    take_slope(track.joint, slope)
    add(track.doubt, track.doubt[-1], slope)
    beside = times(track.joint, given.row)
    seen, square = np.dot(given.row, track.doubt), np.dot(given.row, beside)
    take_gain(track.joint, beside, square, change)
    add(track.doubt, -seen, change)
    return float(seen), float(max(square - seen * seen, 0.0) + given.noise)


@compiled
def _excitation_ratio(track: Track, row: Array) -> float:
    """Return phi^2 over the variance that state errors at the last regression alone give phi."""
    swayed = np.dot(row, track.sway)
    swaying = np.dot(times(track.start, swayed), swayed)
    return float(np.dot(row, track.part[0])**2 / max(swaying, TINY))


@compiled
def update_lag(lag: float, spread: float, innovation: float, seen: float, noise: float,
               kept: float) -> tuple[float, float]:
    """
    Return SF1State.lag and its variance after one more composite innovation.

    Large errors are not linear, so Track.doubt is valid for about one MEMORY only: the part of
    the lag that is forgotten is added to its variance, so that their second moment stays.

    Parameters
    ----------
    lag, spread : float
        Lag and variance before.
    innovation, seen, noise : float
        The composite innovation, rad, what a lag of 1 contributes to it, rad, and the variance of
        the rest, rad^2.
    kept : float
        Share that is not forgotten.

    """
    spread += (1.0 - kept * kept) * lag * lag
    gain = spread * seen / (seen * seen * spread + noise)
    return kept * lag + gain * (innovation - seen * kept * lag), spread * (1.0 - gain * seen)
