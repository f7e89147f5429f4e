"""Foreshortening: bent links are shorter, and their mass is off their axes when they turn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.effects.base import Effect, Motion
from flex_plant_sim.effects.mechanics.bending import (
    bending_force,
    bending_mass,
    bending_terms,
)
from flex_plant_sim.effects.mechanics.bending_step import step_force, step_mass
from flex_plant_sim.effects.mechanics.kinematics import is_energy_form
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class Foreshortening(Effect):
    """
    The inertial forces of first order in the deflections, beside those of CoriolisCentripetal.

    They are centrifugal stiffening, spin softening and the elbow's motion along the links; see
    mechanics/bending.py. Part of them depends on the acceleration. The paper's form, which does
    not come from an energy, has none. share = 1 is the true value.
    """

    identifier = 'foreshortening'
    family = 'links and structure'
    explanation = 'The links bend so far while they turn that they become shorter and lopsided.'
    parameters = (Parameter('share', '', 0.0, -1.0, 3.0, (1.0,), 0.3, 1.0),)
    sites = 'arm'
    # Not a cause to look for: it is too small to be told apart from the parts' tolerances.
    named = False
    inertial = True

    def pushed_by(self, motion: Motion) -> Sequence[Any] | None:
        """Return all that `force` depends on; None for the paper's form."""
        if not is_energy_form(motion.form):
            return None
        terms = bending_terms(motion.form, motion.robot, motion.payload)
        return *terms, motion.position, motion.velocity, motion.change, motion.step

    def force(self, motion: Motion) -> Array | float:
        """Return the generalised force over the step, (…, N)."""
        if not is_energy_form(motion.form):
            return 0.0
        terms = bending_terms(motion.form, motion.robot, motion.payload)
        force = step_force if COMPILED else bending_force
        change = np.broadcast_to(motion.change, motion.position.shape[:-1] + (
            2 * motion.form.order,))
        return np.asarray(self['share'] * force(terms, motion.position, motion.velocity, change,
                                                motion.step))

    def inertia(self, motion: Motion) -> Array | float:
        """Return the mass of the force's part with p'' at the end of the step, (…, N, N)."""
        if not is_energy_form(motion.form):
            return 0.0
        n = motion.form.order
        terms = bending_terms(motion.form, motion.robot, motion.payload)
        end = motion.position + 0.5 * motion.change[..., :n]
        mass = step_mass if COMPILED else bending_mass
        return np.asarray(self['share'] * mass(terms, end))
