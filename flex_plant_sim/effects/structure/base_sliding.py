"""Base sliding: the arm's base shifts on its mounting."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.elastic_root import root_moment
from flex_plant_sim.effects.mechanics.kinematics import (
    is_energy_form,
    link_columns,
    lower_rows,
    with_coordinates,
)
from flex_plant_sim.effects.parameter import Parameter
from flex_plant_sim.effects.structure.base_compliance import MOUNTING_DAMPING
import numpy as np

# Compliance, m/N, below which the mounting counts as rigid and gets no coordinate.
RIGID_MOUNTING = 1e-9
# Added to sin^2(theta_2) in the mass and spring of the shift along the upper link, so that they
# stay above zero. The arm's response then has its poles in cos(theta_2) far enough beyond 1 for
# the schedule's polynomials (1.05: 4e-4 with 25 nodes); of the coupling 83 % are left at 0.5 rad.
STRETCHED_SHARE = 0.1


class BaseSliding(Effect):
    """
    A base with mass on damped springs, alike across and along the upper link.

    The first coordinate is the base's displacement across the upper link, u, m, in axes that turn
    with the link. Its coupling is that of a uniform acceleration field across the upper link,
    whose share across the lower link is cos(theta_2). A displacement along the upper link, v,
    moves that link only along itself, and the lower one across by the share sin(theta_2). As the
    equations are polynomials in cos(theta_2), the second coordinate is w with
    v = sin(theta_2) w, whose mass, spring and coupling go with sin^2(theta_2); the rate of
    sin(theta_2) is left out, as is that of the axes. The paper's rows balance only the beams; in
    its form the upper link's root shear acts on the base.
    """

    identifier = 'base_sliding'
    family = 'links and structure'
    explanation = 'The base shifts on its mounting when the arm pushes against it.'
    parameters = (
        # The tip of the reference robot's upper link deflects by 9 mm per newton.
        Parameter('compliance_m_per_n', 'm/N', 0.0, 0.0, 0.1, (2e-4, 1e-3, 4e-3), 5e-5, 1e-3),
        Parameter('mass_kg', 'kg', 5.0, 0.1, 500.0, (2.0, 10.0), np.inf, 5.0),
        MOUNTING_DAMPING)
    sites = 'arm'
    structural = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the base's shifts across and along as its last coordinates."""
        if self['compliance_m_per_n'] < RIGID_MOUNTING:
            return form
        return self._along(self._across(form, robot), robot)

    def _across(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        wide = with_coordinates(form, ('slide_base',))
        upper, lower = wide.field.copy()
        moving = _carried_mass(robot)
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
        wide.mass[0, -1, -1] += self['mass_kg']
        wide.damping[-1, -1] += self._damping
        wide.stiffness[0, -1, -1] += 1.0 / self['compliance_m_per_n']
        return wide

    def _along(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with w; its row balances all that the base carries in both forms."""
        wide = with_coordinates(form, ('slide_base_along',))
        rows = np.ones(wide.order) if is_energy_form(form) else lower_rows(wide)
        last = np.eye(wide.order)[-1]
        own = np.outer(last, last)
        for mass, lower, carried in ((wide.mass, wide.field[1, 0], _carried_mass(robot)),
                                     (wide.payload_mass, wide.field[1, 1], 1.0)):
            coupling = np.outer(rows * lower, last) + np.outer(last, lower)
            _add_times_sin_squared(mass, coupling, 0.0)
            _add_times_sin_squared(mass, carried * own)
        _add_times_sin_squared(wide.mass, self['mass_kg'] * own)
        _add_times_sin_squared(wide.stiffness, own / self['compliance_m_per_n'])
        # The mean of sin^2(theta_2) over all angles.
        wide.damping[-1, -1] += 0.5 * self._damping
        return wide

    @property
    def _damping(self) -> float:
        """Return the mounting's damping, N s/m."""
        return float(2.0 * self['damping_ratio']
                     * np.sqrt(self['mass_kg'] / self['compliance_m_per_n']))


def _carried_mass(robot: Robot) -> float:
    """Return the mass that the base carries without the payload, kg."""
    return robot.links[0].mass + robot.elbow_mass + robot.links[1].mass


def _add_times_sin_squared(terms: Array, matrix: Array, least: float = STRETCHED_SHARE) -> None:
    """Add (least + sin^2(theta_2)) times a matrix to polynomials in cos(theta_2), (3, N, N)."""
    terms[0] += (1.0 + least) * matrix
    terms[2] -= matrix
