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

from flex_payload_estimator.kalman.riccati import lyapunov_step, riccati_step
from flex_payload_estimator.model.delta import series
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
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
        What errors of the state at the last regression, or one sample on, do to x^m, (n, n).
    reach : Array
        What they do to the state, (n, n).
    covariance : Array
        P of (23), (n, n).
    joint : Array
        Covariance of (xi, epsilon) without what the last noise v did, (n + 1, n + 1).
    noisy : Array
        What v did to them, (n + 1, m).
    start : Array
        Covariance of xi then, at a known payload, (n, n).

    """

    state: Array
    part: Array
    sway: Array
    reach: Array
    covariance: Array
    joint: Array
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
    joint[:2] = 0.0
    joint[:, :2] = 0.0
    noisy[:2, :2] = -np.eye(2)
    start = joint[:n, :n].copy()
    start[:2, :2] = np.diag(noise[:2])
    return Track(state, np.zeros((2, n)), np.zeros((n, n)), np.eye(n), covariance.copy(), joint,
                 noisy, start)


@compiled
def at_known_payload(joint: Array, noisy: Array, noise: Array) -> Array:
    """Return the covariance of xi were epsilon known, (n, n): the part that noise alone made."""
    n = len(joint) - 1
    whole = joint + np.dot(noisy * noise, noisy.T)
    if whole[n, n] > 0.0:
        whole -= np.outer(whole[n], whole[n] / whole[n, n])
    return np.ascontiguousarray(whole[:n, :n])


@compiled
def moved(track: Track, after: Track, since: int, a: Array, a_m: Array, rates: Array,
          measured: Array, columns: Array, process: Array, measurement: Array, noise: Array,
          room: tuple[Any, ...], step: float) -> None:
    """
    Write the track one sample on: Omega of (19), the gain of (23), (25), and what they do.

    Parameters
    ----------
    track, after : Track
        Before, and where to write.
    since : int
        Samples since the last regression.
    a, a_m, rates : Array
        A and A^m (n, n), and the rows A x + B u, A^m x + B^m u, A' x + B' u, (3, n).
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
    n = len(a)
    big = series(a, *room)
    a_bar = np.dot(big, a)
    found = step * np.dot(rates, big.T)
    after.state[:] = track.state + found[0]
    if measured.size > 0:
        gain, covariance, closed = riccati_step(a_bar.T, columns, process, measurement,
                                                track.covariance, step)
        after.covariance[:] = covariance
        onward = _onward(closed.T, step)
        after.state[:] += step * np.dot(measured - np.dot(track.state, columns), gain)
        whole = _whole(onward)
        noisy = np.dot(whole, track.noisy)
        noisy[:n] -= step * gain.T
        after.joint[:] = np.dot(np.dot(whole, track.joint), whole.T)
        after.joint[:] += np.dot(noisy * noise, noisy.T)
    else:
        after.covariance[:] = lyapunov_step(a_bar.T, process, track.covariance, step)
        onward = _onward(a_bar, step)
        whole = _whole(onward)
        after.joint[:] = np.dot(np.dot(whole, track.joint), whole.T)
    after.noisy[:] = 0.0
    after.part[:], after.sway[:] = found[1:], step * np.dot(big, a_m)
    if since > 0:
        after.part[:] += np.dot(track.part, onward.T)
    if since > 1:
        after.sway[:] = np.dot(onward, track.sway) + np.dot(after.sway, track.reach)
        onward = np.dot(onward, track.reach)
    after.reach[:] = onward
    # The measurement has been taken in: what it leaves of the errors sways the rest.
    after.start[:] = at_known_payload(track.joint, track.noisy, noise) if since == 1 \
        else track.start


@compiled
def _onward(rate: Array, step: float) -> Array:
    """Return I + T A, (n, n)."""
    onward = np.empty(rate.shape)
    onward[:] = step * rate
    for i in range(len(onward)):
        onward[i, i] += 1.0
    return onward


@compiled
def _whole(onward: Array) -> Array:
    """Return the same for (xi, epsilon): the payload stays, (n + 1, n + 1)."""
    n = len(onward)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[n, n] = onward, 1.0
    return whole


@compiled
def with_slope(joint: Array, slope: Array) -> Array:
    """Return the joint covariance after xi += slope epsilon, slope (n + 1,) ending in 0."""
    beside = joint[len(joint) - 1] + 0.5 * joint[len(joint) - 1, len(joint) - 1] * slope
    product = np.outer(slope, beside)
    return joint + product + product.T


@compiled
def with_gain(joint: Array, row: Array, change: Array) -> Array:
    """Return the joint covariance after (xi, epsilon) -= change (row xi), both (n + 1,)."""
    beside = np.dot(joint, row)
    product = np.outer(change, 0.5 * np.dot(beside, row) * change - beside)
    return joint + product + product.T
