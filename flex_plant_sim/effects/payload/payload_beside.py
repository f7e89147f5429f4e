"""Payload beside: the payload's centre is beside the lower link's axis."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

from flex_plant_sim.arm.robot import Link, Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect, Motion
from flex_plant_sim.effects.mechanics.bending import link_terms
from flex_plant_sim.effects.mechanics.kinematics import (
    end_rotations,
    is_energy_form,
    link_columns,
    root_row,
)
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class PayloadBeside(Effect):
    """
    Distance d of the payload's centre from the lower link's axis, on the side of positive angles.

    Where the link's end turns at the rate sigma = s p', the payload's acceleration is that on the
    axis less d sigma' along the link's end and d sigma^2 across it. With the rows l and c of the
    velocity on the axis along and across the end, and the acceleration a there along it,
    d'Alembert's forces of the distance are

        m_p d (sigma' l + sigma^2 c + a s) - m_p d^2 sigma' s.

    The last is an inertia. The others depend on sin(theta_2), which the mass matrix cannot. They
    are those of bent links: with those of straight ones a joint's angle misses up to 60 % of what
    the distance changes. The paper's form has only the inertia. Gravity on a tilted base acts as
    on the axis.
    """

    identifier = 'payload_beside'
    family = 'payload'
    explanation = 'The payload is held beside the axis of the lower link, not on it.'
    parameters = (
        Parameter('beside_m', 'm', 0.0, -1.0, 1.0, (-0.1, -0.03, 0.03, 0.1), 0.005, 0.05),)
    sites = 'arm'
    structural = True
    inertial = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the inertia of the payload's distance from the axis."""
        turn, payload_mass = root_row(form, 1) + end_rotations(form, robot)[1], form.payload_mass
        inertia = self['beside_m']**2 * np.outer(turn, turn)
        if not is_energy_form(form):
            inertia[~link_columns(form, 1)] = 0.0
        return replace(form, payload_mass=payload_mass + inertia * np.eye(3, 1)[..., None])

    def force(self, motion: Motion) -> Array | float:
        """Return the generalised force, (…, N)."""
        if not is_energy_form(motion.form):
            return 0.0
        rate, gained, terms = motion.velocity, motion.acceleration, _terms_of(motion)
        rows, acceleration = terms.end(motion.position, rate, gained)
        return np.asarray(self._moment(motion) * (
            _times(gained, terms.turn) * rows.real
            + _times(rate, terms.turn)**2 * rows.imag + acceleration.real * terms.turn))

    def inertia(self, motion: Motion) -> Array | float:
        """Return the mass matrix of the force's part with p'', (…, N, N)."""
        if not is_energy_form(motion.form):
            return 0.0
        terms, still = _terms_of(motion), 0.0 * motion.velocity
        along = terms.end(motion.position, still, still)[0].real
        return np.asarray(-self._moment(motion) * (
            along[..., :, None] * terms.turn + terms.turn[:, None] * along[..., None, :]))

    def _moment(self, motion: Motion) -> float:
        return float(motion.payload * self['beside_m'])


class EndTerms(NamedTuple):
    """
    The place of the lower link's end over the coordinates.

    Attributes
    ----------
    turn : Array
        Row s of the rate at which it turns, (N,).
    angles : Array
        Rows of the angle from each link's root to it, (2, N).
    roots : Array
        Rows of the rotation rate of each link's root, (2, N).
    bent : Array
        Rows of the deflection of each link's end, m, (2, N).
    shortening : Array
        Matrices of twice the shortening of each link, 1/m, (2, N, N).
    reach : Array
        Length of each straight link from its joint, m, (2,).

    """

    turn: Array
    angles: Array
    roots: Array
    bent: Array
    shortening: Array
    reach: Array

    def end(self, position: Array, velocity: Array, gained: Array) -> tuple[Any, Any]:
        """
        Return how the end moves: in complex numbers along itself + i across itself.

        Parameters
        ----------
        position, velocity, gained : Array
            p, p' and p'', (…, N).

        Returns
        -------
        tuple of Array
            The rows of its velocity, (…, N), and its acceleration, m/s^2, (…, 1).

        """
        rows: Any = 0.0
        acceleration: Any = 0.0
        for angle, root, bent, shortening, reach in zip(*self[1:]):
            shorter, turning = position @ shortening, _times(velocity, root)
            place = (reach - 0.5 * np.sum(position * shorter, axis=-1, keepdims=True)
                     + 1j * _times(position, bent))
            # In axes that turn with the link's root: the velocity and its change along the path.
            moved = np.sum(velocity * (1j * bent - shorter), axis=-1, keepdims=True)
            curved = -np.sum(velocity * (velocity @ shortening), axis=-1, keepdims=True)
            seen = np.exp(-1j * _times(position, angle))
            rows = rows + seen * (1j * bent - shorter + 1j * place * root)
            acceleration = acceleration + seen * (
                curved + 2j * turning * moved - turning**2 * place)
        return rows, acceleration + np.sum(gained * rows, axis=-1, keepdims=True)


def _terms_of(motion: Motion) -> EndTerms:
    return end_terms(motion.form, motion.robot.links, motion.robot.payload_offset)


@lru_cache(maxsize=64)
def end_terms(form: SecondOrderForm, links: tuple[Link, Link], beyond_tip: float) -> EndTerms:
    """Return the terms of an energy form whose lower link goes on rigidly, m beyond its tip."""
    slope, shortening = np.zeros(form.order), np.zeros((2, form.order, form.order))
    for j, (link, beyond) in enumerate(zip(links, (0.0, beyond_tip))):
        q = link_columns(form, j)
        bending = link_terms(link, int(q.sum()), beyond)
        shortening[j][np.ix_(q, q)] = bending.tip_shortening
        slope[q] = bending.tip_slope if j == 1 else 0.0
    roots, across = np.array([root_row(form, 0), root_row(form, 1)]), form.field[:, 1]
    reach = across[[0, 1], [0, 1]]
    return EndTerms(roots[1] + slope, np.array([form.elbow_angle + slope, slope]), roots,
                    across - reach[:, None] * roots, shortening, reach)


def _times(vector: Array, row: Array) -> Array:
    return np.asarray((vector @ row)[..., None])
