"""
Equations of motion of the floating-frame arm, written with numpy arrays.

Coordinates p = (theta_1, theta_2, q_1, q_2[, base angle]); theta are the rotors' angles against
their stators. Each link is described in body axes at its joint, x along the undeformed link. With
alpha the joint's acceleration in body axes (less gravity), Omega the body rate and q the shapes'
amplitudes, a link's inertia forces are

    G(q) (alpha_x, alpha_y, dOmega/dt, ddq) + (
        -2 Omega a.dq - dq A dq - c Omega^2,
        -2 Omega q A dq - Omega^2 a.q,
        2 Omega q C dq,
        -Omega^2 C q)

with c = m1 - q A q / 2, A and C the shortening and centrifugal matrices of `component_modes`.
Terms of third and fourth order, needed when the links bend by more than 0.2 rad or so, are added
at points along the links: with s = q S q / 2 and w = phi q there, G gains s^2, w S q - s phi and
S q (S q)^T, the forces gain w dq S dq + 2 Omega s ds and
S q (dq S dq + 2 Omega dw - Omega^2 s) - 2 Omega phi ds. With the angle
asin(w') ~ w' + w'^3 / 6 of the beam's axis its curvature is w'' (1 + w'^2 / 2), and the strain
energy gains EI w''^2 w'^2 / 2 per length (inextensible beam; Crespo da Silva and Glynn 1978).
These are Lagrange's equations of one energy, so that it is conserved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from truth.beam_elements import Array


class LinkTerms(NamedTuple):
    """
    Inertia and elasticity of a link with its tip body, n shapes (see ComponentModes).

    `moments` is (mass kg, first moment kg m, second moment kg m^2) about the joint; the points
    (the tip body last) have masses (K,), stiffness EI dx (K,), rows (K, n) of w, w' and w'',
    and matrices S (K, n, n).
    """

    moments: Array
    a: Array
    b: Array
    mass: Array
    shortening: Array
    centrifugal: Array
    stiffness: Array
    damping: Array
    point_mass: Array
    point_stiffness: Array
    point_rows: Array
    point_slope: Array
    point_curvature: Array
    point_shortening: Array
    tip: Array
    tip_slope: Array
    tip_shortening: Array
    tip_arm: float


class ElbowMotion(NamedTuple):
    """
    Rows W (3, 2 + n1) and bias (3,) of the lower frame's acceleration, x, y and angular.

    `rate` rad/s is that of the lower frame against the upper one.
    """

    rows: Array
    bias: Array
    rate: float


def link_inertia(link: LinkTerms, q: Array) -> tuple[Array, Array, Array]:
    """Return G's blocks: rigid (3, 3) over (x, y, Omega), coupling (3, n), shapes (n, n)."""
    mass, first, second = link.moments
    aq = link.a @ q
    a_matrix_q = link.shortening @ q
    s_q = link.point_shortening @ q
    weighted = link.point_mass[:, None] * s_q
    s, w = 0.5 * s_q @ q, link.point_rows @ q
    c = first - 0.5 * q @ a_matrix_q
    inertia = second + q @ link.centrifugal @ q + link.point_mass @ s**2
    rigid = np.array([[mass, 0.0, -aq], [0.0, mass, c], [-aq, c, inertia]])
    turning = link.b + w @ weighted - (link.point_mass * s) @ link.point_rows
    return rigid, np.vstack([-a_matrix_q, link.a, turning]), link.mass + weighted.T @ s_q


def link_bias(link: LinkTerms, q: Array, dq: Array, rate: float) -> tuple[Array, Array]:
    """Return the velocity terms of the equations above: (3,) and (n,)."""
    c = link.moments[1] - 0.5 * q @ link.shortening @ q
    centrifugal_q = link.centrifugal @ q
    s_q, s_dq = link.point_shortening @ q, link.point_shortening @ dq
    s, ds, dds = 0.5 * s_q @ q, s_q @ dq, s_dq @ dq
    w, dw = link.point_rows @ q, link.point_rows @ dq
    rigid = np.array([
        -2.0 * rate * (link.a @ dq) - dq @ link.shortening @ dq - c * rate**2,
        -2.0 * rate * (q @ link.shortening @ dq) - rate**2 * (link.a @ q),
        2.0 * rate * (centrifugal_q @ dq)
        + link.point_mass @ (w * dds + 2.0 * rate * s * ds)])
    pull = link.point_mass * (dds + 2.0 * rate * dw - rate**2 * s)
    drift = 2.0 * rate * link.point_mass * ds
    return rigid, -rate**2 * centrifugal_q + pull @ s_q - drift @ link.point_rows


def rotate_back(angle: float, vectors: Array) -> Array:
    """Return `vectors` (2, ...) in axes turned by `angle`, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s], [-s, c]]) @ vectors


def elbow_motion(upper: LinkTerms, q: Array, dq: Array, joint: tuple[float, float], rate: float,
                 gravity: Array) -> ElbowMotion:
    """
    Return the lower frame's acceleration (less `gravity`, in upper axes) in its own axes.

    `joint` is (theta_2 rad, its rate rad/s), `rate` the upper frame's, rad/s.
    """
    s_q = upper.tip_shortening @ q
    arm = upper.tip_arm - 0.5 * q @ s_q
    deflection, slope = upper.tip @ q, upper.tip_slope @ q
    rows = np.zeros((3, 2 + q.size))
    rows[:, 0] = -deflection, arm, 1.0
    rows[2, 1] = 1.0
    stretch = 1.0 + 0.5 * slope**2
    rows[0, 2:], rows[1, 2:], rows[2, 2:] = -s_q, upper.tip, stretch * upper.tip_slope
    ds, dw, dslope = s_q @ dq, upper.tip @ dq, upper.tip_slope @ dq
    bias = np.array([-dq @ upper.tip_shortening @ dq - 2.0 * rate * dw - rate**2 * arm,
                     -2.0 * rate * ds - rate**2 * deflection]) - gravity
    angle = float(joint[0] + slope + slope**3 / 6.0)
    rows[:2] = rotate_back(angle, rows[:2])
    return ElbowMotion(rows, np.append(rotate_back(angle, bias), slope * dslope**2),
                       float(joint[1] + stretch * dslope))


def bending_stiffening(link: LinkTerms, q: Array) -> Array:
    """Return the elastic forces (n,) of the exact curvature beyond the linear ones, N."""
    slope, curvature = link.point_slope @ q, link.point_curvature @ q
    return ((link.point_stiffness * curvature * slope**2) @ link.point_curvature
            + (link.point_stiffness * curvature**2 * slope) @ link.point_slope)


def mass_and_bias(p: Array, v: Array, gravity: Array, upper: LinkTerms, lower: LinkTerms,
                  constant_mass: Array) -> tuple[Array, Array]:
    """
    Return the mass matrix (N, N) and the inertia and gravity bias (N,).

    `gravity` (2,) m/s^2 in base axes; `constant_mass` (N, N) rotors, gears and base.
    """
    n1, n2 = upper.a.size, lower.a.size
    last = 2 + n1 + n2
    has_base = p.size > last
    q1, d1, q2, d2 = p[2:2 + n1], v[2:2 + n1], p[2 + n1:last], v[2 + n1:last]
    rate_1 = v[0] + (v[-1] if has_base else 0.0)
    gravity_1 = rotate_back(p[0] + (p[-1] if has_base else 0.0), gravity)
    elbow = elbow_motion(upper, q1, d1, (p[1], v[1]), rate_1, gravity_1)
    w, rate_2 = elbow.rows, rate_1 + elbow.rate

    mass, bias = np.zeros((last, last)), np.zeros(last)
    rigid, coupling, shapes = link_inertia(upper, q1)
    velocity, elastic = link_bias(upper, q1, d1, rate_1)
    mass[0, 0] = rigid[2, 2]
    mass[0, 2:2 + n1] = mass[2:2 + n1, 0] = coupling[2]
    mass[2:2 + n1, 2:2 + n1] = shapes
    bias[0] = velocity[2] - rigid[2, :2] @ gravity_1
    bias[2:2 + n1] = elastic - gravity_1 @ coupling[:2]

    rigid, coupling, shapes = link_inertia(lower, q2)
    velocity, elastic = link_bias(lower, q2, d2, rate_2)
    mass[:2 + n1, :2 + n1] += w.T @ rigid @ w
    mass[:2 + n1, 2 + n1:] = w.T @ coupling
    mass[2 + n1:, :2 + n1] = mass[:2 + n1, 2 + n1:].T
    mass[2 + n1:, 2 + n1:] = shapes
    bias[:2 + n1] += w.T @ (rigid @ elbow.bias + velocity)
    bias[2 + n1:] = elastic + elbow.bias @ coupling
    if has_base:
        # The base turns everything that the first rotor turns, but not against its stator.
        select = np.r_[np.arange(last), 0]
        mass, bias = mass[np.ix_(select, select)], bias[select]
    return mass + constant_mass, bias


def acceleration(p: Array, v: Array, forces: Array, gravity: Array, upper: LinkTerms,
                 lower: LinkTerms, constant_mass: Array) -> Array:
    """Return ddp (N,) under the generalised `forces` (N,) and the links' own elasticity."""
    n1, n2 = upper.a.size, lower.a.size
    mass, bias = mass_and_bias(p, v, gravity, upper, lower, constant_mass)
    rest = forces - bias
    i1, i2 = slice(2, 2 + n1), slice(2 + n1, 2 + n1 + n2)
    for link, i in ((upper, i1), (lower, i2)):
        rest[i] -= link.stiffness @ p[i] + link.damping @ v[i] + bending_stiffening(link, p[i])
    return np.asarray(np.linalg.solve(mass, rest), dtype=float)
