"""Base sliding: the arm's base shifts on its mounting."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect, Motion, one_hot
from flex_plant_sim.effects.mechanics.elastic_root import root_moment
from flex_plant_sim.effects.mechanics.kinematics import (
    elbow_state,
    is_energy_form,
    link_columns,
    lower_rows,
    root_row,
    with_coordinates,
)
from flex_plant_sim.effects.parameter import Parameter
from flex_plant_sim.effects.structure.base_compliance import MOUNTING_DAMPING
import numpy as np

# Compliance, m/N, below which the mounting counts as rigid and gets no coordinate.
RIGID_MOUNTING = 1e-9
ACROSS, ALONG = 'slide_base', 'slide_base_along'


class BaseSliding(Effect):
    """
    A base with mass on damped springs, alike across and along the upper link.

    Its displacement in axes that turn with the upper link's root, at the rate w, is u across and v
    along the link. It accelerates by u'' + 2 w v' + w' v - w^2 u across and by
    v'' - 2 w u' - w' u - w^2 v along, and the arm feels that as a uniform field: its share across
    the lower link is cos(theta_2) of the first less sin(theta_2) of the second. The coupling of u
    is in the mass matrix. All that goes with v or with w is a force, as the mass matrix has no
    sin(theta_2). CoriolisCentripetal, of the elbow's velocity, has the part of -2 w u' that
    belongs to it. The paper's rows balance only the beams; in its form the upper link's root
    shear acts on the base, which shifts across alone.
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
    inertial = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the base's shifts as its last coordinates."""
        if self['compliance_m_per_n'] < RIGID_MOUNTING:
            return form
        wide = self._across(form, robot)
        return self._along(wide, robot) if is_energy_form(form) else wide

    def _across(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        wide = with_coordinates(form, (ACROSS,))
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
        """Return the form with v, which only `force` couples."""
        wide = with_coordinates(form, (ALONG,))
        wide.mass[0, -1, -1] = self['mass_kg'] + _carried_mass(robot)
        wide.payload_mass[0, -1, -1] = 1.0
        wide.damping[-1, -1] = self._damping
        wide.stiffness[0, -1, -1] = 1.0 / self['compliance_m_per_n']
        return wide

    def pushed_by(self, motion: Motion) -> Sequence[Any] | None:
        """Return all that `force` depends on; None where the base does not shift along."""
        form = motion.form
        return (self['mass_kg'], self._damping, motion.payload, form.field, root_row(form, 0),
                root_row(form, 1), form.elbow_angle, motion.position, motion.velocity,
                motion.change) if ALONG in form.names else None

    def force(self, motion: Motion) -> Array | float:
        """Return the generalised force, (…, N)."""
        form, position, rate = motion.form, motion.position, motion.velocity
        if ALONG not in form.names:
            return 0.0
        gained = motion.acceleration
        upper, lower = form.field[:, 0] + motion.payload * form.field[:, 1]
        cosine, sine = elbow_state(form, position)
        turning, w_2 = ((rate @ root_row(form, k))[..., None] for k in (0, 1))
        faster = (gained @ root_row(form, 0))[..., None]
        across, along = (_one_hot(form, name) for name in (ACROSS, ALONG))
        u, v, u_rate, v_rate = ((of @ row)[..., None] for of in (position, rate)
                                for row in (across, along))
        turned_across = 2.0 * turning * v_rate + faster * v - turning**2 * u
        turned_along = -2.0 * turning * u_rate - faster * u - turning**2 * v
        mass, brake = upper @ across + self['mass_kg'], self._damping * turning
        # Of the field along, CoriolisCentripetal has -w u'.
        field_along = (gained @ along)[..., None] + turned_along + turning * u_rate
        return np.asarray(
            -turned_across * (upper + self['mass_kg'] * across + cosine * lower)
            + sine * field_along * lower - brake * v * across
            + (brake * u - mass * turned_along + turning * ((rate @ upper)[..., None]
                                                            - upper @ across * u_rate)
               + sine * (gained @ lower)[..., None]
               + cosine * w_2 * (rate @ lower)[..., None]) * along)

    def inertia(self, motion: Motion) -> Array | float:
        """Return the mass matrix of the force's part with p'', (…, N, N), without w'."""
        form = motion.form
        if ALONG not in form.names:
            return 0.0
        lower = form.field[1, 0] + motion.payload * form.field[1, 1]
        coupling = np.outer(lower, _one_hot(form, ALONG))
        return np.asarray(-elbow_state(form, motion.position)[1][..., None]
                          * (coupling + coupling.T))

    @property
    def _damping(self) -> float:
        """Return the mounting's damping, N s/m."""
        return float(2.0 * self['damping_ratio']
                     * np.sqrt(self['mass_kg'] / self['compliance_m_per_n']))


def _carried_mass(robot: Robot) -> float:
    """Return the mass that the base carries without the payload, kg."""
    return robot.links[0].mass + robot.elbow_mass + robot.links[1].mass


def _one_hot(form: SecondOrderForm, name: str) -> Array:
    """Return the row of a coordinate, (N,)."""
    return one_hot(form.names.index(name), form.order)
