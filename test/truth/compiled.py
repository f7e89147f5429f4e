"""The equations of `equations.py` as loops for Numba; without Numba the NumPy form is used."""

from __future__ import annotations

from collections.abc import Callable
import os
from typing import Any, cast, TypeVar

import numpy as np

from truth import equations
from truth.beam_elements import Array
from truth.equations import LinkTerms

# Numba's own switch; without compilation the loops would be far slower than NumPy.
HAVE_NUMBA = os.environ.get('NUMBA_DISABLE_JIT', '0') == '0'
try:
    if HAVE_NUMBA:
        import numba
except ImportError:
    HAVE_NUMBA = False

Function = TypeVar('Function', bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile `function` where Numba is installed."""
    return cast(Function, numba.njit(cache=True)(function)) if HAVE_NUMBA else function


@compiled
def solve_symmetric(matrix: Array, right: Array) -> Array:
    """Solve in place by Cholesky factors; returns `right` overwritten."""
    n = right.size
    for j in range(n):
        for i in range(j, n):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                matrix[j, j] = np.sqrt(total)
            else:
                matrix[i, j] = total / matrix[j, j]
    for i in range(n):
        total = right[i]
        for k in range(i):
            total -= matrix[i, k] * right[k]
        right[i] = total / matrix[i, i]
    for i in range(n - 1, -1, -1):
        total = right[i]
        for k in range(i + 1, n):
            total -= matrix[k, i] * right[k]
        right[i] = total / matrix[i, i]
    return right


@compiled
def dot(x: Array, y: Array) -> float:
    """Return the inner product."""
    total = 0.0
    for i in range(x.size):
        total += x[i] * y[i]
    return total


@compiled
def link_terms(link: LinkTerms, q: Array, dq: Array, rate: float, rigid: Array,
               coupling: Array, velocity: Array, elastic: Array) -> None:
    """Fill G's blocks, the velocity terms and the elastic forces (less stiffness, damping)."""
    n = q.size
    aq, adq, qaq, qadq, dqadq, qcq, qcdq = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        a_q, a_dq, c_q, spring = 0.0, 0.0, 0.0, 0.0
        for j in range(n):
            a_q += link.shortening[i, j] * q[j]
            a_dq += link.shortening[i, j] * dq[j]
            c_q += link.centrifugal[i, j] * q[j]
            spring += link.stiffness[i, j] * q[j] + link.damping[i, j] * dq[j]
        coupling[0, i], coupling[1, i], coupling[2, i] = -a_q, link.a[i], link.b[i]
        elastic[i] = -rate * rate * c_q + spring
        aq += link.a[i] * q[i]
        adq += link.a[i] * dq[i]
        qaq += q[i] * a_q
        qadq += q[i] * a_dq
        dqadq += dq[i] * a_dq
        qcq += q[i] * c_q
        qcdq += dq[i] * c_q
    c = link.moments[1] - 0.5 * qaq
    rigid[0, 0] = rigid[1, 1] = link.moments[0]
    rigid[0, 2] = rigid[2, 0] = -aq
    rigid[1, 2] = rigid[2, 1] = c
    rigid[2, 2] = link.moments[2] + qcq
    velocity[0] = -2.0 * rate * adq - dqadq - c * rate * rate
    velocity[1] = -2.0 * rate * qadq - rate * rate * aq
    velocity[2] = 2.0 * rate * qcdq


@compiled
def point_terms(link: LinkTerms, q: Array, dq: Array, rate: float, rigid: Array,
                coupling: Array, velocity: Array, elastic: Array, shapes: Array) -> None:
    """Add the terms of third and fourth order, point by point."""
    n = q.size
    s_q = np.zeros(n)
    for k in range(link.point_mass.size):
        m = link.point_mass[k]
        s, ds, dds, w, dw, slope, bend = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            row_q, row_dq = 0.0, 0.0
            for j in range(n):
                row_q += link.point_shortening[k, i, j] * q[j]
                row_dq += link.point_shortening[k, i, j] * dq[j]
            s_q[i] = row_q
            s += 0.5 * row_q * q[i]
            ds += row_q * dq[i]
            dds += row_dq * dq[i]
            w += link.point_rows[k, i] * q[i]
            dw += link.point_rows[k, i] * dq[i]
            slope += link.point_slope[k, i] * q[i]
            bend += link.point_curvature[k, i] * q[i]
        stiff = link.point_stiffness[k]
        rigid[2, 2] += m * s * s
        velocity[2] += m * (w * dds + 2.0 * rate * s * ds)
        pull, drift = m * (dds + 2.0 * rate * dw - rate * rate * s), 2.0 * rate * m * ds
        for i in range(n):
            phi = link.point_rows[k, i]
            coupling[2, i] += m * (w * s_q[i] - s * phi)
            elastic[i] += pull * s_q[i] - drift * phi + stiff * (
                bend * slope * slope * link.point_curvature[k, i]
                + bend * bend * slope * link.point_slope[k, i])
            for j in range(n):
                shapes[i, j] += m * s_q[i] * s_q[j]


@compiled
def elbow_rows(upper: LinkTerms, q: Array, dq: Array, theta_2: float, rate: float,
               gravity_x: float, gravity_y: float, w: Array, bias: Array) -> float:
    """Fill `w` (3, 2 + n1) and `bias` (3,) of `equations.ElbowMotion`; return the tip's rate."""
    n = q.size
    qsq, qsdq, dqsdq, deflection, speed = 0.0, 0.0, 0.0, 0.0, 0.0
    slope, slope_speed = dot(upper.tip_slope, q), dot(upper.tip_slope, dq)
    stretch = 1.0 + 0.5 * slope * slope
    for i in range(n):
        s_q, s_dq = 0.0, 0.0
        for j in range(n):
            s_q += upper.tip_shortening[i, j] * q[j]
            s_dq += upper.tip_shortening[i, j] * dq[j]
        w[0, 2 + i], w[1, 2 + i] = -s_q, upper.tip[i]
        w[2, 2 + i] = stretch * upper.tip_slope[i]
        qsq += q[i] * s_q
        qsdq += q[i] * s_dq
        dqsdq += dq[i] * s_dq
        deflection += upper.tip[i] * q[i]
        speed += upper.tip[i] * dq[i]
    arm = upper.tip_arm - 0.5 * qsq
    w[0, 0], w[1, 0], w[2, 0] = -deflection, arm, 1.0
    w[0, 1], w[1, 1], w[2, 1] = 0.0, 0.0, 1.0
    x = -dqsdq - 2.0 * rate * speed - rate * rate * arm - gravity_x
    y = -2.0 * rate * qsdq - rate * rate * deflection - gravity_y
    angle = theta_2 + slope + slope**3 / 6.0
    c, s = np.cos(angle), np.sin(angle)
    for i in range(2 + n):
        w0, w1 = w[0, i], w[1, i]
        w[0, i], w[1, i] = c * w0 + s * w1, -s * w0 + c * w1
    bias[0], bias[1], bias[2] = c * x + s * y, -s * x + c * y, slope * slope_speed**2
    return stretch * slope_speed


@compiled
def add_lower(mass: Array, rest: Array, w: Array, rigid: Array, coupling: Array,
              velocity: Array, elastic: Array, bias: Array, shapes: Array) -> None:
    """Add the lower link's inertia, carried by the rows `w`, to `mass` and to `-rest`."""
    m, n = w.shape[1], elastic.size
    for i in range(m):
        g0 = rigid[0, 0] * w[0, i] + rigid[0, 2] * w[2, i]
        g1 = rigid[1, 1] * w[1, i] + rigid[1, 2] * w[2, i]
        g2 = rigid[2, 0] * w[0, i] + rigid[2, 1] * w[1, i] + rigid[2, 2] * w[2, i]
        for j in range(i + 1):
            value = g0 * w[0, j] + g1 * w[1, j] + g2 * w[2, j]
            mass[i, j] += value
            if i != j:
                mass[j, i] += value
        for j in range(n):
            value = (w[0, i] * coupling[0, j] + w[1, i] * coupling[1, j]
                     + w[2, i] * coupling[2, j])
            mass[m + j, i] += value
            mass[i, m + j] += value
        rest[i] -= (g0 * bias[0] + g1 * bias[1] + g2 * bias[2] + w[0, i] * velocity[0]
                    + w[1, i] * velocity[1] + w[2, i] * velocity[2])
    for i in range(n):
        rest[m + i] -= elastic[i]
        for j in range(3):
            rest[m + i] -= coupling[j, i] * bias[j]
        for j in range(n):
            mass[m + i, m + j] += shapes[i, j]


@compiled
def loop_acceleration(p: Array, v: Array, forces: Array, gravity: Array, upper: LinkTerms,
                      lower: LinkTerms, constant_mass: Array) -> Array:
    """Return ddp (N,); the same equations as `equations.acceleration`."""
    n1, n2 = upper.a.size, lower.a.size
    size, last = p.size, 2 + n1 + n2
    q1, d1, q2, d2 = p[2:2 + n1], v[2:2 + n1], p[2 + n1:last], v[2 + n1:last]
    angle, rate = p[0], v[0]
    if size > last:
        angle, rate = angle + p[last], rate + v[last]
    gx = np.cos(angle) * gravity[0] + np.sin(angle) * gravity[1]
    gy = -np.sin(angle) * gravity[0] + np.cos(angle) * gravity[1]
    w, rigid, velocity = np.zeros((3, 2 + n1)), np.zeros((3, 3)), np.zeros(3)
    bias = np.zeros(3)
    coupling, elastic, shapes = np.zeros((3, n1)), np.zeros(n1), upper.mass.copy()
    rate_2 = rate + v[1] + elbow_rows(upper, q1, d1, p[1], rate, gx, gy, w, bias)

    mass, rest = np.zeros((size, size)), forces.copy()
    link_terms(upper, q1, d1, rate, rigid, coupling, velocity, elastic)
    point_terms(upper, q1, d1, rate, rigid, coupling, velocity, elastic, shapes)
    mass[0, 0] = rigid[2, 2]
    rest[0] -= velocity[2] - rigid[2, 0] * gx - rigid[2, 1] * gy
    for i in range(n1):
        mass[0, 2 + i] = mass[2 + i, 0] = coupling[2, i]
        rest[2 + i] -= elastic[i] - coupling[0, i] * gx - coupling[1, i] * gy
        for j in range(n1):
            mass[2 + i, 2 + j] = shapes[i, j]
    coupling, elastic, shapes = np.zeros((3, n2)), np.zeros(n2), lower.mass.copy()
    link_terms(lower, q2, d2, rate_2, rigid, coupling, velocity, elastic)
    point_terms(lower, q2, d2, rate_2, rigid, coupling, velocity, elastic, shapes)
    add_lower(mass, rest, w, rigid, coupling, velocity, elastic, bias, shapes)
    if size > last:
        for i in range(last):
            mass[last, i] = mass[i, last] = mass[0, i]
        mass[last, last] = mass[0, 0]
        rest[last] += rest[0] - forces[0]
    for i in range(size):
        for j in range(size):
            mass[i, j] += constant_mass[i, j]
    return solve_symmetric(mass, rest)


acceleration = loop_acceleration if HAVE_NUMBA else equations.acceleration
