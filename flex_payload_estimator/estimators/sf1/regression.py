"""The regression (24)-(28): a composite measurement that is linear in the payload."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any, NamedTuple

from flex_payload_estimator.estimators.sf1.adaptation import sf1_step
from flex_payload_estimator.estimators.sf1.joint import (
    add_symmetric,
    at_known_payload,
    moved,
    take_gain,
    take_slope,
    Track,
)
from flex_payload_estimator.kalman.in_place import add, add_outer, put_matrix, row_products
from flex_payload_estimator.model.payload_model import PayloadModel
from flex_payload_estimator.model.rates import times
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# s; how far back noise and excitation are looked at.
MEMORY = 1.0
# The regressor shows the payload where its power is so many times what noise alone would give:
# chi-square with as few as 20 independent samples in a MEMORY goes beyond once in 2e8.
SIGNIFICANT = 4.0
# Six standard deviations in one sample: by noise alone once in 5e8, two months of (30).
EVIDENT = 36.0
# Above zero, below every square that is divided by.
TINY = 1e-300


@dataclass(frozen=True)
class CompositeMeasurement:
    """
    y' = weights y, a weighted sum of all measurements, and C-bar' = weights C-bar, (26).

    Attributes
    ----------
    weights : Array
        (m,), over the outputs in rad and V.
    row : Array
        C-bar', (n,).

    """

    weights: Array
    row: Array

    @classmethod
    def end_point(cls, model: PayloadModel) -> CompositeMeasurement:
        """
        Return theta_2e, the angle of the forearm's end-point, as the gauges show it.

        With as many gauges as modes the row is theta_2e itself. Otherwise the modes are weighted
        by what a static load would excite, omega_i^-2, and C-bar' is what the gauges then say,
        so that (26) holds for the model in any case.
        """
        output = model.output
        weighted = output * model.spread**2
        gram = weighted @ output.T
        weights = np.linalg.lstsq(gram, weighted @ model.end_point, rcond=1e-12)[0]
        return cls(np.asarray(weights, dtype=np.float64), weights @ output)


@compiled
def regression(row: Array, composite: float, predicted_0: Array,
               predicted_m: Array) -> tuple[float, float]:
    """
    Return psi_t = y'_t - C-bar' x^0_t and phi_t = C-bar' x^m_t, (28).

    Parameters
    ----------
    row : Array
        C-bar', (n,).
    composite : float
        y'_t, rad.
    predicted_0, predicted_m : Array
        x^0_t and x^m_t of (25), (n,).

    """
    return composite - np.dot(row, predicted_0), np.dot(row, predicted_m)


class Law(NamedTuple):
    """
    What stays the same from sample to sample.

    Attributes
    ----------
    weights, row : Array
        See CompositeMeasurement; the row with a 0 for the payload at its end, (n + 1,).
    output, rows : Array
        C-bar, (m, n), and the same with such a column, (m, n + 1).
    sensors : Array
        Variances of v, (m,).
    scale : Array
        From (rad, rad, m/m…) to (rad, rad, V…), (m,).
    noise : float
        w' V w of the sensors' variances V, rad^2.
    tuned, reference : float
        w' R_2 w, and the variance to which the composite innovation settles, rad^2.
    alpha_0, alpha_1, largest : float
        Of (29), and the largest payload, kg.
    fading : float
        Share of MEMORY from one regression to the next.
    passing : float
        From one sample to the next.
    resolvent : bool
        Normalise, leave alone what noise explains, carry the state on by (24), and ask the
        innovations for the lag.

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
    largest: float
    fading: float
    passing: float
    resolvent: bool


class Adapted(NamedTuple):
    """
    What SF1 knows.

    Attributes
    ----------
    mass, p, variance : float
        m_p (kg), P of (29), and the variance of the error of mass (kg^2).
    excitation : float
        Power of the regressor phi over what noise alone would give it, over MEMORY.
    lag, spread : float
        By how many of Track.doubt the payload is off, as the innovations have it, and the
        variance of that.
    level : float
        Mean square of innovations over what was stated of them, over MEMORY: Birge's ratio.

    """

    mass: float
    p: float
    variance: float
    excitation: float
    lag: float
    spread: float
    level: float


@compiled
def sampled(predicted: tuple[Any, ...], scaled: Array, due: bool, before: tuple[float, ...],
            laws: tuple[Any, ...], reading: Array) -> tuple[float, tuple[float, ...]]:
    """
    Write what (28), (29) make of a prediction and a sample.

    Named tuples come and go as plain ones, see joint.moved.

    Parameters
    ----------
    predicted : tuple
        A Track; where due, regressed on return.
    scaled : Array
        The sample, rad and V, (m,).
    due : bool
        Whether to regress on it.
    before : tuple
        An Adapted.
    laws : tuple
        A Law.
    reading : Array
        Becomes innovation and its standard deviation in rad and m/m, (2, m).

    Returns
    -------
    tuple
        The mean of their ratio's square, and what is known: an Adapted.

    """
    track, known, law = Track(*predicted), Adapted(*before), Law(*laws)
    innovation = scaled - np.dot(law.output, track.state)
    variance = _expected(track.joint, track.part[1], track.doubt,
                         known.lag * known.lag + known.spread, law.output, law.rows, law.sensors)
    reading[0], reading[1] = innovation / law.scale, np.sqrt(variance) / law.scale
    surprise = np.dot(innovation, innovation / variance) / len(scaled)
    if due:
        known = _regressed(track, scaled, known, law)
    level = known.level + law.passing * (surprise - known.level)
    return surprise, (known.mass, known.p, known.variance, known.excitation, known.lag,
                      known.spread, level)


@compiled
def _expected(joint: Array, slope: Array, doubt: Array, lags: float, output: Array, rows: Array,
              sensors: Array) -> Array:
    """Return the variance of the innovation, rad^2 and V^2, (m,), of `lags` times the doubt's."""
    n = slope.size
    image, shown = np.dot(rows, joint), np.dot(output, slope)
    # The payload's error also shows in what it has added to the state since: `take_slope`.
    variance = (row_products(image, rows) + shown * (2.0 * image[:, n] + joint[n, n] * shown)
                + sensors)
    # A model that explodes has left no digit of its covariance.
    variance = np.where(variance > 0.0, variance, np.nan)
    # Instead of what one doubt shows, what so many of them do.
    swung = (times(rows, doubt) + shown * doubt[n])**2
    return np.maximum(variance - swung, sensors) + lags * swung


@compiled
def advanced(onward: tuple[Any, ...], scaled: Array, due: bool, before: tuple[float, ...],
             laws: tuple[Any, ...], reading: Array) -> tuple[float, tuple[float, ...]]:
    """Do what joint.moved does, of the arguments `onward`, and then `sampled`: one call less."""
    moved(*onward)
    return sampled(onward[1], scaled, due, before, laws, reading)


@compiled
def _regressed(track: Track, scaled: Array, known: Adapted, law: Law) -> Adapted:
    """Regress; return what is known then."""
    n, part = len(track.state), track.part[0]
    row = law.row[:n]
    ratio = _excited(track, row, law)
    # Bounded, so that it is over one MEMORY after the arm has come to rest.
    excitation = min((1.0 - law.fading) * known.excitation + law.fading * ratio,
                     math.e * SIGNIFICANT)
    shown = excitation > SIGNIFICANT or ratio > EVIDENT
    part_0 = track.state.copy()
    add(part_0, -known.mass, part)
    psi, phi = regression(row, np.dot(law.weights, scaled), part_0, part)
    innovation, weight = psi - phi * known.mass, 1.0
    if law.resolvent:
        weight = law.reference / (np.dot(row, times(track.covariance, row)) + law.tuned)
        phi = phi if shown else 0.0
    # Of phi^2 so much is noise, of which the arm knows nothing: it tells nothing either.
    true = 1.0 if phi == 0.0 else max(1.0 - 1.0 / ratio, 0.0) if shown else 0.0
    free, p, gain = sf1_step(known.mass, known.p, psi, phi, weight, law.alpha_0, law.alpha_1)
    mass = min(max(free, 0.0), law.largest)
    if mass != free:
        # A payload at its limit has moved by a part of the gain only, and so has its error.
        gain *= (mass - known.mass) / (free - known.mass)
    slope, change = _changed(track.state, track.part, true, gain, mass - known.mass, law.resolvent)
    level = max(known.level, 1.0) if law.resolvent else 1.0
    lag, spread = known.lag, known.spread
    if shown and lag == 0.0 and spread == 1.0:
        # Nothing is learnt as yet. What was stated is 1 / level of what innovations were: no more
        # of the state's error is what the doubt did to it. The rest has lost its phase.
        add(track.doubt[:n], level**-0.5 - 1.0, track.doubt[:n])
    seen, noise = _carried(track, slope, change, law)
    if shown and law.resolvent:
        lag, spread = measured(lag, spread, innovation, seen, noise, 1.0 - law.fading)
    told = _noised(track.joint, track.start, change, law.noise)
    track.noisy[:] = 0.0
    add_outer(track.noisy, -change, law.weights)
    if mass + lag * track.doubt[n] < 0.0:
        # Less than nothing: so far off, errors are not linear, and what they told is forgotten.
        lag, spread = 0.0, 1.0
    doubt = track.doubt[n]**2
    # Birge's ratio, for noise above the file's or a model that is wrong; the lag is a mean.
    variance = level * (max(told - doubt, 0.0) + spread * doubt) + lag * lag * doubt
    return Adapted(mass, p, variance, excitation, lag, spread, known.level)


@compiled
def _changed(state: Array, part: Array, true: float, gain: float, change: float, carry: bool
             ) -> tuple[Array, Array]:
    """Carry the state on by a change of the payload; return slope and gain for (xi, epsilon)."""
    n = state.size
    slope, gains = np.zeros(n + 1), np.zeros(n + 1)
    add(slope[:n], true, part[1])
    gains[n] = gain
    if carry:
        add(gains[:n], gain, part[0])
        add(state, change, part[0])
    return slope, gains


@compiled
def _noised(joint: Array, start: Array, change: Array, noise: float) -> float:
    """Write what is known of xi after a regression; return the payload's variance, kg^2."""
    noisy = joint.copy()
    add_symmetric(noisy, change, change * (0.5 * noise))
    variance = float(noisy[-1, -1])
    put_matrix(start, at_known_payload(noisy))
    return variance


@compiled
def _carried(track: Track, slope: Array, change: Array, law: Law) -> tuple[float, float]:
    """Carry covariance and doubt through a regression; return doubt and noise of its residual."""
    take_slope(track.joint, slope)
    add(track.doubt, track.doubt[-1], slope)
    beside = times(track.joint, law.row)
    seen, square = np.dot(law.row, track.doubt), np.dot(law.row, beside)
    take_gain(track.joint, beside, square, change)
    add(track.doubt, -seen, change)
    return float(seen), float(max(square - seen * seen, 0.0) + law.noise)


@compiled
def _excited(track: Track, row: Array, law: Law) -> float:
    """Return the regressor's power over what errors at the last regression give it alone."""
    swayed = np.dot(row, track.sway)
    swaying = np.dot(times(track.start, swayed), swayed)
    return float(np.dot(row, track.part[0])**2 / max(swaying, TINY))


@compiled
def measured(lag: float, spread: float, innovation: float, seen: float, noise: float,
             kept: float) -> tuple[float, float]:
    """
    Return Adapted.lag and its variance after one more composite innovation.

    Errors that are not small are not linear, so that what the doubt has become is right for a
    MEMORY only: what is forgotten of the lag is added to its variance, their second moment stays.

    Parameters
    ----------
    lag, spread : float
        Before.
    innovation, seen, noise : float
        What one lag shows in it, and the variance of all the rest, rad and rad^2.
    kept : float
        Share that is not forgotten.

    """
    spread += (1.0 - kept * kept) * lag * lag
    gain = spread * seen / (seen * seen * spread + noise)
    return kept * lag + gain * (innovation - seen * kept * lag), spread * (1.0 - gain * seen)
