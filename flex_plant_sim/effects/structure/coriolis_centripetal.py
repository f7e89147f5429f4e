"""Coriolis and centripetal forces between the links, which the linear equations leave out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect, Motion
from flex_plant_sim.effects.mechanics.kinematics import (
    elbow_state,
    is_energy_form,
    link_columns,
    lower_rows,
    root_row,
)
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class CoriolisCentripetal(Effect):
    """
    The force sin(eta) (sigma w_2 e - epsilon w_1 s), of zeroth order in the deflections.

    e is the row of the elbow's velocity epsilon = e p', s that of the lower link's and the
    payload's static moment sigma = s p', w_1 and w_2 the rotation rates of the links' roots and
    eta the angle between the links. For rigid links this is the textbook term. Its power is
    -(p' dM/dt p')/2, so energy is conserved. share = 1 is the true value.
    """

    identifier = 'coriolis_centripetal'
    family = 'links and structure'
    explanation = 'The arm moves so fast that Coriolis and centripetal forces matter.'
    parameters = (Parameter('share', '', 0.0, -1.0, 3.0, (1.0,), 0.3, 1.0),)
    sites = 'arm'

    def rows(self, form: SecondOrderForm, payload: float) -> Array | None:
        """Return share e, s, and the rows of w_1 and w_2, (4, N); None for the paper's form."""
        if not is_energy_form(form):
            return None
        across = form.field[1, 0] + payload * form.field[1, 1]
        return np.array([self['share'] * form.field[0, 1], across,
                         root_row(form, 0), root_row(form, 1)])

    def pushed_by(self, motion: Motion) -> Sequence[Any] | None:
        """Return all that `force` depends on; None for the paper's form."""
        form = motion.form
        return (self['share'], motion.payload, form.field[0, 1], form.field[1], root_row(form, 0),
                root_row(form, 1), form.elbow_angle, motion.position, motion.velocity) \
            if is_energy_form(form) else None

    def force(self, motion: Motion) -> Array:
        """Return the generalised force, (…, N)."""
        form, rate = motion.form, motion.velocity
        elbow = form.field[0, 1]
        across = form.field[1, 0] + motion.payload * form.field[1, 1]
        cosine, sine = elbow_state(form, motion.position)
        w_1, w_2 = ((rate @ root_row(form, index))[..., None] for index in (0, 1))
        epsilon = (rate @ elbow)[..., None]
        if is_energy_form(form):
            sigma = (rate @ across)[..., None]
            return self['share'] * sine * (sigma * w_2 * elbow - epsilon * w_1 * across)
        link = motion.robot.links[1]
        mass = link.mass + motion.payload
        moment = (link.mass * (link.hub_radius + 0.5 * link.length)
                  + motion.payload * (link.hub_radius + link.length))
        along = moment * w_2**2 + mass * epsilon * w_1 * cosine
        return self['share'] * sine * (along * (link_columns(form, 0) * elbow)
                                       - epsilon * w_1 * (lower_rows(form) * across))


def coriolis_words(coriolis: bool | None) -> str:
    """Return in words whether Coriolis and centripetal forces act; None if they are estimated."""
    words = {True: 'with Coriolis forces', False: 'without Coriolis forces'}
    return 'Coriolis forces estimated' if coriolis is None else words[coriolis]
