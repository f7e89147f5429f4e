"""
The arithmetic of one step of the joint posterior of state, payload and parts, on plain arrays.

Friedland's factored form of the augmented Kalman filter (IEEE Trans. Autom. Control 14, 1969):
P is the state's covariance for known parameters beta, s = dx/dbeta, V the covariance of beta; the
joint covariance is [P + s V s', s V; V s', V]. Columns of s: payload, share of the forces of
motion, bias of each gauge; then, where parts count, what forces last, each part and the gain of
each gauge.
The same code runs with and without Numba.
"""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.forces import (
    forces_of_motion,
    scheduling_row,
    tip_force,
)
from flex_payload_estimator.estimators.rpe.products import (
    applied,
    combined,
    inner,
    inverse_column,
    product,
    squared,
    whitener,
)
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# Columns of s before the gauges' biases.
MASS, CORIOLIS, FIRST_BIAS = 0, 1, 2
# Columns of what lasts, between biases and parts: a force at the tip along the world's axes, N,
# and a bias of each drive, in the command's unit.
FORCES = 4
# P's diagonal grows by this share a sample, above what rounding takes: a memory of 1e12 samples.
JITTER = 1e-12


@compiled
def _first_part(size: int, count: int) -> int:
    """Return the first column of so many parts, of so many columns in all."""
    return FIRST_BIAS + FORCES + (size - FIRST_BIAS - count - FORCES) // 2


@compiled
def _off_nominal(parts: Array, anchor: Array, drive: Array, moved: Array, jacobian: Array
                 ) -> Array:
    """Write d(M d)/d(part); add what the parts' deviations add to M, and return that to M d."""
    n, held, count = len(moved), len(moved) + 2, len(parts)
    first = _first_part(anchor.size, count)
    over = applied(parts.reshape(-1, held), drive[:held]).reshape(-1, n).T
    moved[:, first:first + count] = over
    deviations = anchor[first:first + count].copy()
    if not deviations.any():
        return np.zeros(n)
    off = combined(deviations, parts).reshape(n, held)
    jacobian += off[:, :n]
    return applied(off, drive[:held])


@compiled
def _at(angle: float, series: Array, away: float) -> tuple[Array, Array, Array]:
    """Return M and its derivatives over the angle and over the payload, all flat."""
    order, width = np.arange(float(len(series))), series.shape[1] // 3
    waves = np.empty((2, order.size))
    waves[0], waves[1] = np.cos(angle * order), -order * np.sin(angle * order)
    found = product(waves, series)
    flat, over_m = found[0, :width], found[0, width:2 * width]
    if away != 0.0:
        bend = away * found[0, 2 * width:]
        flat, over_m = flat + away * (over_m + 0.5 * bend), over_m + bend
    return flat, found[1, :width], over_m


@compiled
def _stepped(x: Array, anchor: Array, series: Array, parts: Array, away: float,
             command: Array, motion: Array) -> tuple[Array, Array, Array, Array]:
    """Return M d, its derivatives over state and parameters, and what of M commands meet."""
    n, moves, share = x.size, len(motion) > 0, anchor[CORIOLIS]
    lean = scheduling_row(motion, n) if moves else np.zeros(n)
    if len(parts) > 0:
        last = _first_part(anchor.size, len(parts))
        command = command + anchor[last - 2:last]
    beyond = inner(lean, x)
    flat, flat_angle, flat_m = _at(x[1] + share * beyond, series, away)
    held = flat.size // n
    matrix, drive = flat.reshape(n, held), np.zeros(held)
    drive[:n], drive[n:n + 2] = x, command
    moved, jacobian = np.zeros((n, anchor.size)), matrix[:, :n].copy()
    increment = applied(matrix, drive)
    if len(parts) > 0:
        increment = increment + _off_nominal(parts, anchor, drive, moved, jacobian)
        last = _first_part(anchor.size, len(parts))
        moved[:, last - 2:last] = matrix[:, n:n + 2]
        if moves:
            blown, turned_by, moved[:, last - 4:last - 2] = tip_force(
                motion, x, anchor[last - 4:last - 2], matrix[:, n + 2:].copy())
            increment = increment + blown
            jacobian += turned_by
    push = share * matrix[:, n + 2:]
    over_x = over_after = np.zeros((0, n))
    over_mass = np.zeros(0)
    if moves:
        force, over_x, over_after, over_mass = forces_of_motion(
            motion, anchor[MASS], x, x + increment, push)
        increment = increment + applied(push, force)
        drive[n + 2:] = share * force
        moved[:, CORIOLIS] = applied(matrix[:, n + 2:].copy(), force)
    moved[:, MASS] += applied(flat_m.reshape(n, held), drive)
    turned = applied(flat_angle.reshape(n, held), drive)
    moved[:, CORIOLIS] += beyond * turned
    lean *= share
    lean[1] += 1.0
    jacobian += turned.reshape(-1, 1) * lean
    if moves:
        # What changes the step changes the forces over it.
        over_x = over_x + over_after + product(over_after, jacobian)
        moved += product(push, product(over_after, moved))
        moved[:, MASS] += applied(push, over_mass)
        jacobian += product(push, over_x)
    return increment, jacobian, moved, matrix[:, n:n + 2]


@compiled
def _carried(jacobian: Array, cov: Array, noise: Array) -> Array:
    """Return (I + J) P (I + J)' + Q."""
    half = product(jacobian, cov)
    return cov + half + half.T + squared(half, jacobian) + noise


@compiled
def _composed(jacobian: Array, given: Array, noise: Array, steps: int
              ) -> tuple[Array, Array, Array]:
    """
    Return J, the columns added and Q of many equal steps that follow each other.

    A step takes x to (1 + J) x + given, and P to (1 + J) P (1 + J)' + Q. By doubling: two steps
    have J1 + J2 + J2 J1, in which a small J keeps its digits.
    """
    far, added, spread = np.zeros_like(jacobian), np.zeros_like(given), np.zeros_like(noise)
    while True:
        if steps % 2 == 1:
            added = added + given + product(jacobian, added)
            spread = _carried(jacobian, spread, noise)
            far = far + jacobian + product(jacobian, far)
        steps //= 2
        if steps == 0:
            return far, added, spread
        given = 2.0 * given + product(jacobian, given)
        noise = _carried(jacobian, noise, noise)
        jacobian = 2.0 * jacobian + product(jacobian, jacobian)


@compiled
def predict(x: Array, cov: Array, sens: Array, anchor: Array, series: Array, parts: Array,
            away: float, command: Array, motion: Array, torque: Array, steps: int
            ) -> tuple[Array, Array, Array]:
    """
    Return state, covariance and sensitivity so many samples later, delta form.

    x+ = x + M d with d = (x, u, forces of motion) and M = sum_k cos(k angle) M_k(m) + parts' dM,
    s+ = s + J s + dM/dbeta d, P+ = (I + J) P (I + J)' + Q, J = d(M d)/dx. Several samples go by
    with the same J, command and derivatives.

    Parameters
    ----------
    x, cov, sens, anchor : Array
        (n,), (n, n), (n, B) and the parameters that the model is evaluated at, (B,).
    series : Array
        See PayloadSlice.
    parts : Array
        dM/d(part) of states and commands at this angle, (p, n (n + 2)), p = 0 for exact parts.
    away : float
        m - slice payload, kg.
    command : Array
        u held over the sample, (2,).
    motion : Array
        See forces.motion_rows; (0, N) without forces of motion.
    torque : Array
        Standard deviation of the command's disturbance, in its unit, (2,).
    steps : int
        How many samples.

    """
    increment, jacobian, moved, given = _stepped(x, anchor, series, parts, away, command,
                                                 motion)
    given = given * torque
    noise = squared(given, given)
    if steps > 1:
        columns = np.column_stack((increment, moved))
        jacobian, columns, noise = _composed(jacobian, columns, noise, steps)
        increment, moved = columns[:, 0].copy(), columns[:, 1:].copy()
    return (x + increment, _carried(jacobian, cov, noise),
            sens + product(jacobian, sens) + moved)


@compiled
def walk(cov: Array, sens: Array, spread: Array, variance: float
         ) -> tuple[Array, Array, Array]:
    """
    Return P, s and V after the payload walked at random by `variance`, kg^2, since the sample.

    Exact for the joint covariance: of what x was thought to owe to the payload, the part that
    the walk makes doubtful goes to P.
    """
    row = inverse_column(spread)
    share = variance / (1.0 + variance * row[MASS])
    column = sens[:, MASS].copy()
    cov = cov + share * (column.reshape(-1, 1) * column)
    sens = sens - share * (column.reshape(-1, 1) * row)
    spread = spread.copy()
    spread[MASS, MASS] += variance
    return cov, sens, spread


@compiled
def _seen(x: Array, sens: Array, anchor: Array, offset: Array, output: Array, gains: int
          ) -> tuple[Array, Array, Array]:
    """Return what is expected of the outputs at the anchor, its slopes over x and over beta."""
    size, gauges, seen = anchor.size, len(output) - 2, output
    expected = applied(output, x) + offset
    base = expected
    if gains > 0:
        factor = np.ones(len(output))
        factor[2:] += anchor[size - gains:]
        expected, seen = base * factor, output * factor.reshape(-1, 1)
    psi = product(seen, sens)
    for g in range(gauges):
        psi[2 + g, FIRST_BIAS + g] += 1.0
        if gains > 0:
            psi[2 + g, size - gains + g] += base[2 + g]
    expected[2:] += anchor[FIRST_BIAS:FIRST_BIAS + gauges]
    return expected, seen, psi


@compiled
def _gain(projected: Array, known: Array, noise: Array) -> Array:
    """Return the gain for known parameters, (n, m), of P C', C P C' and the noise's variances."""
    inverse = whitener(known + np.diag(noise))
    return product(squared(projected, inverse), inverse)


@compiled
def _shorter(cov: Array, gain: Array, seen: Array, noise: Array) -> Array:
    """Return P after a measurement, in Joseph's form."""
    keep = np.eye(len(cov)) - product(gain, seen)
    cov = squared(product(keep, cov), keep) + squared(gain * noise, gain)
    cov = 0.5 * (cov + cov.T)
    for i in range(len(cov)):
        cov[i, i] *= 1.0 + JITTER
    return cov


@compiled
def _learn(x: Array, cov: Array, sens: Array, beta: Array, spread: Array, anchor: Array,
           held: bool, alone: Array, innovation: Array, seen: Array, psi: Array,
           projected: Array, known: Array, learnt: Array, white: Array, noise: Array,
           heaviest: float) -> tuple[Array, Array, Array, Array, Array]:
    """Return x, P, s, beta and V after a measurement; L^-1 of Sigma is `white`."""
    gain, learnt = _gain(projected, known, noise), squared(learnt, white)
    after = beta + applied(learnt, applied(white, innovation))
    after[MASS] = min(max(after[MASS], 0.0), heaviest)
    spread, sens = spread - squared(learnt, learnt), sens - product(gain, psi)
    x = x + applied(gain, alone)
    if not held:
        x = x + applied(sens, after - anchor)
    return x, _shorter(cov, gain, seen, noise), sens, after, 0.5 * (spread + spread.T)


@compiled
def correct(x: Array, cov: Array, sens: Array, beta: Array, spread: Array, anchor: Array,
            held: bool, measured: Array, offset: Array, output: Array, noise: Array, gains: int,
            gate: float, heaviest: float
            ) -> tuple[tuple[Array, Array, Array, Array, Array], Array, Array, Array, float]:
    """
    Return the posterior after a measurement, and what the measurement says of the model.

    That is x, P, s, beta, V; the innovation e; the variances of its channels; L^-1 e with L L' =
    Sigma before the gate, (m,); ln |Sigma| as it was used, NaN where the state is lost.

    Parameters
    ----------
    x, cov, sens, beta, spread : Array
        (n,), (n, n), (n, B), (B,) and V (B, B).
    anchor, held : Array, bool
        Parameters that all is linearised about, (B,), for which x is the state; it is x + s (beta
        - anchor) for beta. Where it is not held, the anchor follows beta, and x is taken there.
    measured, offset, output : Array
        y, and what y is beyond C x without gains and biases, (m,); C, (m, n).
    noise, gains : Array, int
        Variance of each channel, (m,); gauges whose gain is among beta: the last of its columns.
    gate : float
        Where e' Sigma^-1 e is beyond, the noise counts as large as makes it the gate: one
        absurd sample moves nothing, and many in a row are believed (Huber's influence).
    heaviest : float
        The payload stays in [0, heaviest], kg.

    """
    expected, seen, psi = _seen(x, sens, anchor, offset, output, gains)
    alone = measured - expected
    innovation = alone - applied(psi, beta - anchor) if held else alone
    projected, learnt = squared(cov, seen), squared(spread, psi)
    known = product(seen, projected)
    total = known + product(psi, learnt) + np.diag(noise)
    white, variances = whitener(total), np.diag(total).copy()
    scores = applied(white, innovation)
    misfit = inner(scores, scores)
    if not misfit >= 0.0:
        return (x, cov, sens, beta, spread), innovation, variances, scores, np.nan
    if misfit > gate:
        more = (misfit / gate - 1.0) * variances
        noise = noise + more
        white = whitener(total + np.diag(more))
    found = _learn(x, cov, sens, beta, spread, anchor, held, alone, innovation, seen, psi,
                   projected, known, learnt, white, noise, heaviest)
    return found, innovation, variances, scores, -2.0 * np.log(np.diag(white)).sum()
