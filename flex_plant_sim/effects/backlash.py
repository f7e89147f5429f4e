"""Backlash: the gear lets the link move freely within a gap."""

from __future__ import annotations

from flex_plant_sim.arm_model import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect, Motion, Parameter
from flex_plant_sim.effects.kinematics import extended
from flex_plant_sim.robot import Robot
import numpy as np


class Backlash(Effect):
    """
    A gap between rotor and link; the joint's coordinate is the link's side.

    While the teeth touch, rotor and link are one and the arm's equations hold exactly. They part
    when the teeth would have to pull. Apart, the rotor obeys its drive alone; the arm, whose
    equations include the rotor, gets the torque that leaves the link no impulse over the step.
    Where a step would end beyond the gap the teeth meet and do not rebound. So a contact is
    decided once a step, like the dry friction, needs no stiff spring and is stable at any step.

    The coordinate gap_joint_j is the link's lead over the rotor, rad, within half the gap. With
    sensor_behind_gear = 1 the sensor sees the link, with 0 the rotor.
    """

    identifier = 'backlash'
    family = 'joint and gear'
    explanation = 'The gear of {site} has backlash: the link moves freely within a gap.'
    parameters = (
        Parameter('gap_rad', 'rad', 0.0, 0.0, 0.3, (0.006, 0.012, 0.025), 0.002),
        Parameter('sensor_behind_gear', '', 1.0, -0.5, 1.5, (1.0, 0.0), np.inf))
    sites = 'joint'
    structural = True

    @property
    def coordinate(self) -> str:
        """Return the name of the coordinate that holds the link's lead."""
        return f'gap_{self.site}'

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the lead as a coordinate that only `on_step` moves."""
        wide = extended(form, (self.coordinate,))
        # Stable by itself, so that a predictor has nothing to observe there.
        wide.mass[0, -1, -1] = 1.0
        wide.damping[-1, -1], wide.stiffness[0, -1, -1] = 20.0, 100.0
        wide.angle[self.index, -1] = self['sensor_behind_gear'] - 1.0
        return wide

    def on_step(self, after: Array, state: Array, response: Array, motion: Motion) -> Array:
        """Return the state with rotor and link parted, or joined after a gap."""
        n, j = motion.form.order, self.index
        k = motion.form.names.index(self.coordinate)
        drive, step, half = motion.robot.drives[j], motion.step, 0.5 * self['gap_rad']
        speed, lead, slip = (state[..., i:i + 1] for i in (n + j, k, n + k))
        turned = after[..., j:j + 1] - state[..., j:j + 1]
        sped = after[..., n + j:n + j + 1] - speed
        column = response[..., j]
        turn, kick = column[..., j:j + 1], column[..., n + j:n + j + 1]
        motor = drive.torque_gain * motion.command[..., j:j + 1]
        taken = step * motor - drive.inertia * sped - drive.damping * turned
        freeing = -taken / (step - drive.inertia * kick - drive.damping * turn)
        rotor_turn, rotor_speed = _rotor(drive.inertia, drive.damping, motor, speed - slip, step)
        apart = lead + turned + turn * freeing - rotor_turn
        open_gap = np.abs(apart) < half
        met = np.clip(apart, -half, half)
        joining = (drive.damping * (met - lead) - drive.inertia * slip) / step
        result = after + column * np.where(open_gap, freeing, joining)
        parting = speed + sped + kick * freeing - rotor_speed
        result[..., k:k + 1] = met
        result[..., n + k:n + k + 1] = np.where(open_gap, parting, 0.0)
        return result


def _rotor(inertia: float, damping: float, torque: Array, speed: Array,
           step: float) -> tuple[Array, Array]:
    """Return the turn and the end speed of a rotor alone, exact for a held torque."""
    damping = max(damping, 1e-6 * inertia / step)
    decay = damping * step / inertia
    steady = torque / damping
    mean = -np.expm1(-decay) / decay
    return (step * (steady + (speed - steady) * mean),
            steady + (speed - steady) * np.exp(-decay))
