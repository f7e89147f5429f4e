"""
The kinetic energy of second order in the deflections, which the linear equations leave out.

The effect `foreshortening` and the simulator take its forces from here.

A point of a bent link is at (x - s, w), s = int w'^2 dx / 2, in axes that turn with its root. With
e p' = epsilon, s p' = sigma and the root rates w_1, w_2 of CoriolisCentripetal, eta the angle
between the links, the elbow's deflection tau = t p, alpha = int w dm of the lower link, the
elbow's shortening P and beta = int s dm of the lower link, and C = int (w^2 - 2 x s) dm, the
energy gains

    M_2 (w_1^2 tau^2 / 2 - epsilon w_1 P) + w_1^2 C_1 / 2 + w_2^2 C_2 / 2
    + sin(eta) ((w_1 tau + P') sigma - epsilon (w_2 alpha + beta'))
    + cos(eta) (w_1 w_2 tau alpha - w_1 P sigma - epsilon w_2 beta),

with M_2 the mass beyond the elbow. The terms are centrifugal stiffening and spin softening, and
the upper tip's motion along the lower link and along its own. Third order in (q, q') is left out.
A payload that is held loosely counts where it swings to, across the tip.
The forces here are Lagrange's forces of that energy, and those of the linear equations' own M(eta)
that CoriolisCentripetal does not have: sin(eta) (w_2 epsilon s - w_1 sigma e - epsilon sigma h),
h the row of eta, which vanish for rigid links.

These forces are of first order. A link that bends by a third of its length is beyond their range,
and beyond any elastic strain. The forces fade there; otherwise they would grow without bound.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

from flex_plant_sim.arm.robot import Link, Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.mechanics.bending_factors import (
    field_factors,
    momentum_factors,
    remaining,
)
from flex_plant_sim.effects.mechanics.kinematics import link_columns, link_shapes, root_row
import numpy as np
from numpy.typing import NDArray

# The forces have faded to a half at a shortening of FADE_SHORTENING times the link's length, with
# FADE_EXPONENT the power of the shortening in the fading factor. A tip deflected by 0.37 of the
# length shortens the link by 0.08 of it (0.6 w^2 / L, Euler and Bernoulli's beam under a tip
# load). From about there on, an energy of second order makes the mass matrix of heavily loaded
# links indefinite.
FADE_SHORTENING = 0.08
# Relative difference of numbers that are equal but for rounding.
ROUNDING = 1e-9


class BendingTerms(NamedTuple):
    """
    The terms of the energy as rows and matrices over the coordinates.

    Attributes
    ----------
    over_position : Array
        Rows over p, (3 + 2 N, N): tau, alpha, eta, the matrix of 2 P on the upper link's
        deflections and of 2 beta on the lower one's, and that of C_1 and C_2.
    over_velocity : Array
        Rows over p', (4 + N, N): w_1, w_2, epsilon, sigma, and the first of those matrices.
    upper : Array
        1 for the upper link's deflections, else 0, (N,).
    carried : float
        M_2, kg.
    most : tuple of float
        P and beta at which the forces have faded to a half, m and kg m.

    """

    over_position: Array
    over_velocity: Array
    upper: Array
    carried: float
    most: tuple[float, float]

    @classmethod
    def none(cls, form: SecondOrderForm) -> BendingTerms:
        """Return the terms of links without mass, which give no force."""
        n = form.order
        return cls(np.zeros((3 + 2 * n, n)), np.zeros((4 + n, n)), np.zeros(n), 0.0, (1.0, 1.0))


class LinkTerms(NamedTuple):
    """
    Integrals over one link, n shapes.

    Attributes
    ----------
    moment : Array
        int phi dm, kg, (n,).
    shortening, own : Array
        int S dm with S(x) = int_0^x phi' phi'' dx, and int (phi phi' - x S) dm, (n, n).
    tip, tip_slope : Array
        phi and phi' at the end of the link, (n,).
    tip_shortening : Array
        S there, 1/m, (n, n).
    reach : float
        Distance from the joint axis to it, m.

    """

    moment: Array
    shortening: Array
    own: Array
    tip: Array
    tip_slope: Array
    tip_shortening: Array
    reach: float

    def centrifugal(self, mass: float) -> Array:
        """Return int (phi phi' - x S) dm with a mass, kg, at the tip, (n, n)."""
        return self.own + mass * (np.outer(self.tip, self.tip)
                                  - self.reach * self.tip_shortening)


# Its eigenvalues took three quarters of the time of a link's terms.
_gauss_legendre = lru_cache(maxsize=16)(np.polynomial.legendre.leggauss)


@lru_cache(maxsize=16)
def link_terms(link: Link, modes: int, beyond_tip: float = 0.0) -> LinkTerms:
    """Return the integrals of a link in Ritz shapes that ends rigidly, m beyond its tip."""
    shapes = link_shapes(link, modes, True)
    points, weights = _gauss_legendre(40 + 4 * modes)
    length, radius = link.length, link.hub_radius
    x, w = 0.5 * length * (points + 1.0), 0.5 * length * weights
    slope, density, rest = shapes.shape(x, 1), link.mass / length, length - x
    # A slope at x shortens the link for all mass beyond x.
    carried = density * rest
    moments = density * (radius * rest + 0.5 * (length**2 - x**2))
    tip, tip_slope = (np.asarray(shapes.shape(length, k), dtype=float) for k in (0, 1))
    return LinkTerms(
        -shapes.modal_mass * shapes.beta, (slope.T * (w * carried)) @ slope,
        shapes.modal_mass * np.eye(modes) - (slope.T * (w * moments)) @ slope,
        tip + beyond_tip * tip_slope, tip_slope,
        (slope.T * w) @ slope + beyond_tip * np.outer(tip_slope, tip_slope),
        radius + length + beyond_tip)


def bending_terms(form: SecondOrderForm, robot: Robot, payload: float) -> BendingTerms:
    """Return the terms of an energy form with a payload, kg."""
    return _terms(_Kinematics(form), robot.links, robot.elbow_mass, robot.payload_offset, payload)


class _Kinematics:
    """A form, equal to others of the same kinematics: drives and damping are not in the terms."""

    def __init__(self, form: SecondOrderForm):
        self.form = form
        self._key = form.names, form.elbow_angle.tobytes(), form.field.tobytes()

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Kinematics) and self._key == other._key


@lru_cache(maxsize=64)
def _terms(kinematics: _Kinematics, links: tuple[Link, Link], elbow_mass: float, offset: float,
           payload: float) -> BendingTerms:
    form = kinematics.form
    q_1, q_2 = (link_columns(form, index) for index in (0, 1))
    upper, lower = (link_terms(link, int(q.sum()), beyond)
                    for link, q, beyond in zip(links, (q_1, q_2), (0.0, offset)))
    bent, n = np.zeros((3, form.order)), form.order
    swing = _payload_swing(form, lower, q_2)
    slope, tip = np.zeros((2, n))
    slope[q_2], tip[q_2] = lower.tip_slope, lower.tip
    bent[0, q_1], bent[1, q_2] = upper.tip, lower.moment
    bent[1] += payload * (tip + swing)
    bent[2] = form.elbow_angle
    shortening, centrifugal = np.zeros((n, n)), np.zeros((n, n))
    shortening[np.ix_(q_1, q_1)] = upper.tip_shortening
    shortening[np.ix_(q_2, q_2)] = lower.shortening + payload * lower.tip_shortening
    # The payload swings across the tip: a slope there tilts its way towards the elbow.
    shortening += payload * (np.outer(swing, slope) + np.outer(slope, swing))
    centrifugal[np.ix_(q_1, q_1)] = upper.centrifugal(elbow_mass)
    centrifugal[np.ix_(q_2, q_2)] = lower.centrifugal(payload)
    centrifugal += payload * (np.outer(tip + swing, tip + swing) - np.outer(tip, tip))
    turning = np.array([root_row(form, 0), root_row(form, 1), form.field[0, 1],
                        form.field[1, 0] + payload * form.field[1, 1]])
    return BendingTerms(np.vstack([bent, shortening, centrifugal]),
                        np.vstack([turning, shortening]), q_1.astype(np.float64),
                        links[1].mass + payload,
                        (FADE_SHORTENING * links[0].length,
                         FADE_SHORTENING * links[1].length * (links[1].mass / 3.0 + payload)))


def _payload_swing(form: SecondOrderForm, lower: LinkTerms, q_2: NDArray[np.bool_]) -> Array:
    """Return the row of the payload's motion across the tip where it is held loosely, (N,)."""
    across = form.field[1, 1] - lower.reach * root_row(form, 1)
    return np.where(q_2 | (np.abs(across) < ROUNDING * lower.reach), 0.0, across)


def bending_force(terms: BendingTerms, position: Array, velocity: Array, change: Array,
                  step: float) -> Array:
    """
    Return dL/dp - d/dt dL/dp' of the energy of second order: the mean over a step, (…, N).

    Parameters
    ----------
    terms : BendingTerms
        Terms of the energy.
    position, velocity : Array
        p and p' at the middle of the step, (…, N).
    change : Array
        Change of (p, p') over the step, (…, 2 N).
    step : float
        Length of the step, s.

    """
    n = len(terms.upper)
    half, half_rate = 0.5 * change[..., :n], 0.5 * change[..., n:]
    gained = (_momentum(terms, position + half, velocity + half_rate)
              - _momentum(terms, position - half, velocity - half_rate))
    return _slopes(terms, position, velocity) - gained / step


def bending_mass(terms: BendingTerms, position: Array) -> Array:
    """Return the contribution of the energy to the mass matrix, (…, N, N)."""
    return _momentum(terms, position[..., None, :], np.eye(len(terms.upper)))


def _scalars(terms: BendingTerms, position: Array, velocity: Array) -> tuple[Any, ...]:
    """
    Return rate, bent and short of momentum_factors, then S p, C p and S p'.

    S is the matrix of 2 P and 2 beta, and C that of C_1 and C_2.
    """
    n, upper = len(terms.upper), terms.upper
    over_p, over_v = position @ terms.over_position.T, velocity @ terms.over_velocity.T
    rate = tuple(np.moveaxis(over_v[..., :4], -1, 0)[..., None])
    tau, alpha, eta = np.moveaxis(over_p[..., :3], -1, 0)[..., None]
    shorter, spun = over_p[..., 3:3 + n], over_p[..., 3 + n:]

    def along(a: Array, b: Array) -> Array:
        return np.sum(a * b, axis=-1, keepdims=True)

    short = tuple(along(part * link, image)
                  for link in (upper, 1.0 - upper)
                  for part, image in ((0.5 * position, shorter), (velocity, shorter),
                                      (position, spun)))
    return rate, (tau, alpha, np.sin(eta), np.cos(eta)), short, shorter, spun, over_v[..., 4:]


def _momentum(terms: BendingTerms, position: Array, velocity: Array) -> Array:
    rate, bent, short, shorter, *_ = _scalars(terms, position, velocity)
    *along, of_p, of_beta = momentum_factors(rate, bent, short, terms.carried)
    return remaining(short, terms.most) * (
        sum(factor * row for factor, row in zip(along, terms.over_velocity))
        + (of_p * terms.upper + of_beta * (1.0 - terms.upper)) * shorter)


def _slopes(terms: BendingTerms, position: Array, velocity: Array) -> Array:
    rate, bent, short, shorter, spun, turned = _scalars(terms, position, velocity)
    *along, of_p, of_beta, elbow, across = field_factors(rate, bent, short, terms.carried)
    upper, lower = terms.upper, 1.0 - terms.upper
    return remaining(short, terms.most) * (
        sum(factor * row for factor, row in zip(along, terms.over_position))
        + elbow * terms.over_velocity[2] + across * terms.over_velocity[3]
        + (of_p * upper + of_beta * lower) * shorter
        + bent[2] * (rate[3] * upper - rate[2] * lower) * turned
        + (rate[0]**2 * upper + rate[1]**2 * lower) * spun)
