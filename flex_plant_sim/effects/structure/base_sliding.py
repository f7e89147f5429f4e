"""Base sliding: the arm's base shifts on its mounting."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import SecondOrderForm
from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.mechanics.elastic_root import root_moment
from flex_plant_sim.effects.mechanics.kinematics import (
    is_energy_form,
    link_columns,
    lower_rows,
    with_coordinates,
)
from flex_plant_sim.effects.structure.base_compliance import DAMPING_RATIO
import numpy as np

# Compliance, m/N, below which the mounting counts as rigid and gets no coordinate.
RIGID = 1e-9


class BaseSliding(Effect):
    """
    A base with mass on a lightly damped spring across the upper link.

    The coordinate is the base's displacement across the upper link, m, in axes that turn with the
    link; the other component moves the upper link only along itself. The coupling is that of a
    uniform acceleration field across the upper link, whose share across the lower link is
    cos(theta_2). The paper's rows balance only the beams; in its form the upper link's root shear
    acts on the base.
    """

    identifier = 'base_sliding'
    family = 'links and structure'
    explanation = 'The base shifts on its mounting when the arm pushes against it.'
    parameters = (
        # The tip of the reference robot's upper link deflects by 9 mm per newton.
        Parameter('compliance_m_per_n', 'm/N', 0.0, 0.0, 0.1, (2e-4, 1e-3, 4e-3), 5e-5, 1e-3),
        Parameter('mass_kg', 'kg', 5.0, 0.1, 500.0, (2.0, 10.0), np.inf, 5.0))
    sites = 'arm'
    structural = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the base's shift as its last coordinate."""
        if self['compliance_m_per_n'] < RIGID:
            return form
        wide = with_coordinates(form, ('slide_base',))
        upper, lower = wide.field.copy()
        moving = robot.links[0].mass + robot.elbow_mass + robot.links[1].mass
        along = (robot.links[1].mass * upper[1], upper[1])
        wide.field[0, :, -1] = moving, 1.0
        for k, mass in enumerate((wide.mass, wide.payload_mass)):
            if is_energy_form(form):
                mass[0, -1], mass[1, -1] = upper[k], lower[k]
                mass[0, :, -1], mass[1, :, -1] = upper[k], lower[k]
                mass[0, -1, -1] = (moving, 1.0)[k]
            else:
                mass[0, :, -1] = link_columns(wide, 0) * upper[k]
                mass[1, :, -1] = lower_rows(wide) * lower[k]
                mass[2, :, -1] = -1.0 * link_columns(wide, 0) * along[k]
        if not is_energy_form(form):
            # E I w''' at the root: the root moment at radius 0 less that at radius 1 m.
            wide.stiffness[0, -1] += (root_moment(wide, robot, 0, 0.0)
                                      - root_moment(wide, robot, 0, 1.0))
        stiffness = 1.0 / self['compliance_m_per_n']
        wide.mass[0, -1, -1] += self['mass_kg']
        wide.damping[-1, -1] += 2.0 * DAMPING_RATIO * np.sqrt(stiffness * self['mass_kg'])
        wide.stiffness[0, -1, -1] += stiffness
        return wide
