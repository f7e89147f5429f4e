"""Base compliance: the arm's base turns on its mounting."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import SecondOrderForm
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.elastic_root import RIGID_RAD_PER_N_M, root_moment
from flex_plant_sim.effects.mechanics.kinematics import (
    is_energy_form,
    with_coordinates,
    with_root_turn,
)
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Damping ratio of the base alone on its mounting: steel has 0.03 and less, rubber up to 0.3.
MOUNTING_DAMPING = Parameter('damping_ratio', '', 0.03, 0.0, 2.0, (0.03,), np.inf, 0.15,
                             optional=True)


class BaseCompliance(Effect):
    """
    A base with inertia on a damped torsion spring; theta_1 is measured relative to it.

    The upper link's root turns by theta_1 + psi. The rotor's inertia acts on theta_1 alone, as
    with a high gear ratio, so the upper link's root moment acts on the base.
    """

    identifier = 'base_compliance'
    family = 'links and structure'
    explanation = ('The base turns on its mounting when the arm pushes against it; angle and '
                   'rotor of joint_1 count from the turned base.')
    parameters = (
        Parameter('compliance_rad_per_n_m', 'rad/(N m)', 0.0, 0.0, 1.0,
                  (0.001, 0.003, 0.01), 3e-4, 0.005),
        Parameter('inertia_kg_m2', 'kg m^2', 0.2, 0.01, 100.0, (0.1, 0.5), np.inf, 0.3),
        MOUNTING_DAMPING)
    sites = 'arm'
    structural = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the base's angle as its last coordinate."""
        if self['compliance_rad_per_n_m'] < RIGID_RAD_PER_N_M:
            return form
        wide = with_coordinates(form, ('psi_base',))
        wide = with_root_turn(wide, robot, 0, np.eye(wide.order)[-1])
        stiffness, inertia = 1.0 / self['compliance_rad_per_n_m'], self['inertia_kg_m2']
        wide.mass[0, -1, -1] += inertia
        wide.damping[-1, -1] += 2.0 * self['damping_ratio'] * np.sqrt(stiffness * inertia)
        wide.stiffness[0, -1, -1] += stiffness
        if not is_energy_form(form):
            wide.stiffness[0, -1] -= root_moment(wide, robot, 0, robot.links[0].hub_radius)
        return wide
