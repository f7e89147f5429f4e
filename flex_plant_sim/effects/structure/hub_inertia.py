"""Hub inertia: a part at a joint turns with the links and is missing in the robot file."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import SecondOrderForm
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.kinematics import is_energy_form, root_row
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class HubInertia(Effect):
    """
    Rotary inertia at the root of a link (joint_1, joint_2) or at the upper link's end (elbow).

    At joint 1 it acts like additional rotor inertia.
    """

    identifier = 'hub_inertia'
    family = 'links and structure'
    explanation = 'Something at {site} has more rotary inertia than its data sheet says.'
    parameters = (
        Parameter('inertia_kg_m2', 'kg m^2', 0.0, 0.0, 1.0, (0.003, 0.01, 0.04, 0.16),
                  0.002, 0.02),)
    sites = 'hub'
    structural = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the hub's inertia; the paper's row of theta_1 is the rotor's."""
        row = root_row(form, 0 if self.site == 'joint_1' else 1)
        if self.site == 'elbow':
            row = row - np.eye(form.order)[1]
        left = row.copy()
        if self.site != 'joint_1' and not is_energy_form(form):
            left[0] = 0.0
        mass = form.mass.copy()
        mass[0] += self['inertia_kg_m2'] * np.outer(left, row)
        return replace(form, mass=mass)
