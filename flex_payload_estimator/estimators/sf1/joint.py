"""
The errors of state and payload together: what the variance of SF1's estimate is.

With xi = x - x^, epsilon = m_p - m^, kappa SF1's gain, L = T K-bar, s what a kilogram adds to the
state since the last regression and v the sensors' noise:

    xi- = (F - L C) xi + s epsilon - L v,          (23) against the arm
    epsilon+ = epsilon - kappa (C' xi- + w v),     (29), y' = w y
    xi+ = xi- + x^m (epsilon+ - epsilon),          (24)

so that an old error of the payload, which still sits in the state, is not forgotten. The gains are
those of (30), tuned; the noise is the sensors' own. One noise v acts twice, in the regression and
in the next prediction: it is carried apart in between.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from flex_payload_estimator.kalman.in_place import add, add_matrix, put, put_matrix, scaled
from flex_payload_estimator.kalman.riccati import lyapunov_step, riccati_step
from flex_payload_estimator.model.delta import series
from flex_payload_estimator.model.split import rates_at
from flex_payload_estimator.model.tabulated import Tables, times
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
import numpy as np


class Track(NamedTuple):
    """
    Between two samples; its arrays are written in place.

    Attributes
    ----------
    state : Array
        x^, (n,).
    part : Array
        Rows, (2, n): x^m of (25) and s, rad/kg…, grown since the last regression.
    sway : Array
        What errors of the state at the last regression do to x^m, (n, n).
    held : Array
        The state then, (n,): (25) takes one step of it, in however many samples.
    covariance : Array
        P of (23), (n, n).
    joint : Array
        Covariance of (xi, epsilon) without what the last noise v did, (n + 1, n + 1).
    doubt : Array
        What of them one standard deviation of the payload's prior has become, (n + 1,).
    noisy : Array
        What v did to them, (n + 1, m).
    start : Array
        Covariance of xi then, at a known payload, (n, n).

    """

    state: Array
    part: Array
    sway: Array
    held: Array
    covariance: Array
    joint: Array
    doubt: Array
    noisy: Array
    start: Array


def at_start(scaled: Array, noise: Array, covariance: Array, variance: float) -> Track:
    """
    Return the track of an arm that was measured once.

    Parameters
    ----------
    scaled : Array
        The sample, rad and V, (m,): its angles are taken over.
    noise : Array
        Variances of v, (m,).
    covariance : Array
        Of the state, (n, n), but for those angles.
    variance : float
        Of the payload, kg^2.

    """
    n, m = len(covariance), len(noise)
    state, joint, noisy = np.zeros(n), np.zeros((n + 1, n + 1)), np.zeros((n + 1, m))
    state[:2] = scaled[:2]
    joint[:n, :n], joint[n, n] = covariance, variance
    doubt = np.zeros(n + 1)
    doubt[n] = variance**0.5
    joint[:2] = 0.0
    joint[:, :2] = 0.0
    noisy[:2, :2] = -np.eye(2)
    start = joint[:n, :n].copy()
    start[:2, :2] = np.diag(noise[:2])
    return Track(state, np.zeros((2, n)), np.zeros((n, n)), state.copy(), covariance.copy(), joint,
                 doubt, noisy, start)


@compiled
def carried(onward: Array, covariance: Array) -> Array:
    """Return F P F'."""
    return np.dot(np.dot(onward, covariance), onward.T)


@compiled
def _symmetric_by_loops(matrix: Array, x: Array, y: Array) -> None:
    for i in range(len(x)):
        for j in range(len(y)):
            matrix[i, j] += x[i] * y[j] + y[i] * x[j]


def _symmetric_by_outer(matrix: Array, x: Array, y: Array) -> None:
    product = x[:, None] * y
    matrix += product
    matrix += product.T


# matrix += x y' + y x'.
add_symmetric = _symmetric_by_loops if COMPILED else _symmetric_by_outer


@compiled
def at_known_payload(whole: Array) -> Array:
    """Return the covariance of xi were epsilon known, (n, n), of that of both, overwritten."""
    n = len(whole) - 1
    if whole[n, n] > 0.0:
        beside = whole[n].copy()
        add_symmetric(whole, beside, beside * (-0.5 / beside[n]))
    return whole[:n, :n]


@compiled
def moved(before: tuple[Any, ...], ahead: tuple[Any, ...], since: int, cosine: float,
          tables: Tables, mass: float, other: float, as_printed: bool, command: Array,
          measured: Array, columns: Array, process: Array, measurement: Array,
          noise: Array, room: tuple[Any, ...], step: float) -> None:
    """
    Write the track one sample on: Omega of (19), the gain of (23), (25), and what they do.

    Parameters
    ----------
    before, ahead : tuple
        A Track, and the one to write, as plain tuples: Numba takes a microsecond to see what a
        named one is.
    since : int
        Samples since the last regression.
    cosine, tables, mass, other, as_printed
        See split.rates_at.
    command : Array
        u, (2,).
    measured : Array
        y of x, (m,), or (0,) where there is none.
    columns, process, measurement : Array
        C-bar' (n, m), R_1 / T (n, n), T R_2 (m, m).
    noise : Array
        Variances of v, (m,).
    room : tuple
        See DeltaOperator.
    step : float
        T, s.

    """
    track, after = Track(*before), Track(*ahead)
    put(after.held, track.held if since > 0 else track.state)
    a, a_m, rates = rates_at(cosine, tables, mass, other, after.held, command, as_printed)
    add(rates[0], 1.0, times(a, track.state - after.held))
    big = series(a, *room)
    found = np.dot(rates, big.T) * step
    put(after.state, track.state)
    add(after.state, 1.0, found[0])
    onward = _corrected(track, after, np.dot(big, a), measured, columns, process, measurement,
                        noise, step)
    put_matrix(after.part, found[1:])
    put_matrix(after.sway, np.dot(big, a_m) * step)
    if since > 0:
        _grow(after.part, after.sway, track.part, track.sway, onward)


@compiled
def _grow(part: Array, sway: Array, part_before: Array, sway_before: Array, onward: Array) -> None:
    """Add to x^m and s, and to what errors do to x^m, what those of a sample ago have become."""
    add_matrix(part, 1.0, np.dot(part_before, onward.T))
    add_matrix(sway, 1.0, np.dot(onward, sway_before))


@compiled
def _corrected(track: Track, after: Track, a_bar: Array, measured: Array, columns: Array,
               process: Array, measurement: Array, noise: Array, step: float) -> Array:
    """Correct the state by a measurement, if there is one; write each P; return F - T K C."""
    noisy = track.noisy
    if measured.size > 0:
        gain, covariance, closed = riccati_step(a_bar.T, columns, process, measurement,
                                                track.covariance, step)
        onward = _onward(closed.T, step)
        innovation = measured - np.dot(track.state, columns)
        add(after.state, step, np.dot(innovation, gain))
        whole = _whole(onward)
        noisy = np.dot(whole, noisy)
        add_matrix(noisy[:len(a_bar)], -step, gain.T)
    else:
        covariance = lyapunov_step(a_bar.T, process, track.covariance, step)
        onward = _onward(a_bar, step)
        whole = _whole(onward)
    put_matrix(after.start, track.start)
    put_matrix(after.covariance, covariance)
    put_matrix(after.joint, carried(whole, track.joint))
    put(after.doubt, times(whole, track.doubt))
    add_matrix(after.joint, 1.0, np.dot(scaled(noisy, noise), noisy.T))
    after.noisy[:] = 0.0
    return onward


@compiled
def _onward(rate: Array, step: float) -> Array:
    """Return I + T A, (n, n)."""
    onward = np.zeros(rate.shape)
    add_matrix(onward, step, rate)
    for i in range(len(onward)):
        onward[i, i] += 1.0
    return onward


@compiled
def _whole(onward: Array) -> Array:
    """Return the same for (xi, epsilon): the payload stays, (n + 1, n + 1)."""
    n = len(onward)
    whole = np.zeros((n + 1, n + 1))
    put_matrix(whole[:n, :n], onward)
    whole[n, n] = 1.0
    return whole


@compiled
def take_slope(joint: Array, slope: Array) -> None:
    """Change the joint covariance by xi += slope epsilon, slope (n + 1,) ending in 0."""
    last = joint[len(joint) - 1]
    add_symmetric(joint, slope, last + slope * (0.5 * last[len(last) - 1]))


@compiled
def take_gain(joint: Array, beside: Array, square: float, change: Array) -> None:
    """Change the joint covariance J by (xi, epsilon) -= change (row xi), of J row, row' J row."""
    add_symmetric(joint, change, change * (0.5 * square) - beside)
