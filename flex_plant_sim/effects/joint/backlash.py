"""Backlash: the gear lets the link move freely within a gap."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect, GAP, Motion
from flex_plant_sim.effects.mechanics.elastic_root import (
    root_moment,
    SENSOR_BEHIND_GEAR,
    with_elastic_root,
)
from flex_plant_sim.effects.mechanics.kinematics import momentum_rows, with_step_coordinate
from flex_plant_sim.effects.parameter import Parameter
from flex_plant_sim.tiny import TINY
import numpy as np


class Backlash(Effect):
    """
    A gap between rotor and link; the joint coordinate is that of the link's side.

    While the teeth touch, rotor and link move as one and the arm's equations hold. They part when
    the teeth would have to pull. Then the drive acts on the rotor alone, and the arm keeps
    hub_share of the joint's inertia, that of the gear's output and the hub. Both motions are
    linear and sampled exactly. If a step would end beyond the gap, the teeth meet within the
    step, at the time given by a parabola through lead and slip, and do not rebound. A contact is
    thus resolved once per step, like dry friction; it needs no stiff spring and is stable at any
    step length.

    Teeth that are elastic in contact (contact_compliance) are a gear compliance in series.

    The coordinate gap_joint_j is the lead of the link over the rotor, rad, at most half the gap
    in magnitude. The sensor measures the link if sensor_behind_gear = 1, and the rotor if 0.
    """

    identifier = 'backlash'
    family = 'joint and gear'
    explanation = 'The gear of {site} has backlash: the link moves freely within a gap.'
    parameters = (
        # Strain-wave gears have 1', the smallest that matters; other gears some tens of minutes.
        Parameter('gap_rad', 'rad', 0.0, 0.0, 0.3, (0.0008, 0.0025, 0.008, 0.025, 0.08), 3e-4,
                  0.015),
        SENSOR_BEHIND_GEAR,
        Parameter('hub_share', '', 0.0, 0.0, 0.9, (0.05, 0.3), np.inf, 0.3),
        Parameter('contact_compliance_rad_per_n_m', 'rad/(N m)', 0.0, 0.0, 0.05, (0.0,), np.inf,
                  0.001, optional=True))
    sites = 'joint'
    contact = GAP
    structural = True

    @property
    def coordinate(self) -> str:
        """Return the name of the coordinate of the link's lead."""
        return f'gap_{self.site}'

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the lead as a coordinate that only `on_step` changes."""
        j, compliance = self.index, self['contact_compliance_rad_per_n_m']
        moment = root_moment(form, robot, j, robot.links[j].hub_radius)
        wide = with_step_coordinate(with_elastic_root(form, robot, j, compliance, moment),
                                    self.coordinate)
        angle = wide.angle.copy()
        angle[j, :-1] += self['sensor_behind_gear'] * compliance * moment
        angle[j, -1] = self['sensor_behind_gear'] - 1.0
        return replace(wide, angle=angle)

    def open_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form without the joint's rotor and drive: theta_j is that of the link."""
        j = self.index
        mass, payload = momentum_rows(form, robot, j)
        opened = replace(form, mass=form.mass.copy(), payload_mass=form.payload_mass.copy(),
                         damping=form.damping.copy(), stiffness=form.stiffness.copy(),
                         input_matrix=form.input_matrix.copy())
        opened.mass[:, j], opened.payload_mass[:, j] = mass, payload
        opened.mass[0, j, j] += self['hub_share'] * robot.drives[j].inertia
        opened.damping[j, j] -= robot.drives[j].damping
        opened.stiffness[:, j] = 0.0
        opened.input_matrix[j] = 0.0
        return opened

    def on_step(self, after: Array, parted: Array, state: Array, impulse: Array,
                motion: Motion) -> Array:
        """Return the state with rotor and link apart, or in contact at an end of the gap."""
        n, j = motion.form.order, self.index
        k = motion.form.names.index(self.coordinate)
        drive, half = motion.robot.drives[j], 0.5 * self['gap_rad']
        angle, speed, lead, slip = (state[..., i:i + 1] for i in (j, n + j, k, n + k))
        inertia, damping, step, mean, end = self.rotor(motion.robot, motion.step)
        steady = drive.torque_gain * motion.command[..., j:j + 1] / damping
        away = speed - slip - steady
        turn, rate = step * (steady + away * mean), steady + away * end
        apart = lead + parted[..., j:j + 1] - angle - turn
        left = parted[..., n + j:n + j + 1] - rate
        is_open = np.abs(apart) < half
        met = _contact_time(lead, step * slip, apart, half)
        # The effect of the contact torque that was absent until the teeth met, and the momentum
        # that the rotor takes over at the impact.
        share = np.where(np.arange(state.shape[-1]) < n, met * (2.0 - met), met)
        early, late = impulse[..., j], impulse[..., 2 + j]
        joined = (after + share * (parted - after)
                  - (early + met * (late - early)) * inertia * (slip + met * (left - slip)))
        result = np.where(is_open, parted, joined)
        result[..., k:k + 1] = np.clip(apart, -half, half)
        result[..., n + k:n + k + 1] = np.where(is_open, left, 0.0)
        return result

    def rotor(self, robot: Robot, step: float) -> tuple[float, float, float, float, float]:
        """
        Return inertia, damping and step of the rotor alone, and the decay of its speed.

        The last two values are the mean over a step and the end value of a speed that starts at
        1; they are exact for a constant torque.
        """
        drive = robot.drives[self.index]
        inertia = (1.0 - self['hub_share']) * drive.inertia
        damping = max(drive.damping, 1e-6 * inertia / step)
        decay = damping * step / inertia
        return (inertia, damping, step, float(-np.expm1(-decay) / decay), float(np.exp(-decay)))


def _contact_time(lead: Array, drift: Array, apart: Array, half: float) -> Array:
    """
    Return when the teeth meet, as a share s of the step: lead + drift s + bend s^2 = +-half.

    Zero if they touch from the start.
    """
    side = np.sign(apart)
    room, drift = np.maximum(half - side * lead, 0.0), side * drift
    bend = side * (apart - lead) - drift
    pace = drift + np.sqrt(np.maximum(drift**2 + 4.0 * bend * room, 0.0))
    return np.asarray(2.0 * room / np.maximum(pace, 2.0 * room + TINY))
