"""Drive integral: a velocity loop that integrates its error, as most servo drives do."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import SecondOrderForm
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.extra_states import with_states
from flex_plant_sim.effects.parameter import Parameter
import numpy as np


class DriveIntegral(Effect):
    """
    PI in place of P: the loop's torque is d (e + w z), z' = e, with its error e = g/d u - theta'.

    g is the drive's torque gain, d its damping without friction, which is no part of the loop, and
    w one over the integral time. Springs and friction leave a P loop an error, a PI loop none. The
    integrator starts from zero and has no limit. A lag of the motor acts on the integral as well.
    """

    identifier = 'drive_integral'
    family = 'drive and timing'
    explanation = 'The velocity loop of {site} integrates its error, so that loads slow it less.'
    parameters = (
        # In ten seconds or more it hardly acts within a move; drives come with 10 ms to 1 s.
        Parameter('integral_rate_per_s', '1/s', 0.0, 0.0, 500.0, (0.3, 1.0, 5.0, 20.0, 80.0), 0.1,
                  20.0),)
    sites = 'velocity_loop'
    structural = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form as it is; models without one, and thus without speeds, are refused."""
        return form

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with the integral of the error, rad, as its last state."""
        if self['integral_rate_per_s'] == 0.0:
            return plant
        drive, j, n = robot.drives[self.index], self.index, plant.e.shape[-1]
        damping = drive.damping - drive.friction
        gain, wider = drive.torque_gain / damping, with_states(plant, 1)
        a, b = wider.a, wider.b
        a[..., :-1, -1] = self['integral_rate_per_s'] * damping * plant.e[..., j]
        a[..., -1, n + j], b[..., -1, j] = -1.0, gain
        # A lag that has taken the command before holds what the loop sees, the speed's share, too.
        for lag in 2 * n + np.flatnonzero(b.reshape(-1, *b.shape[-2:])[0, 2 * n:-1, j]):
            b[..., -1, j], a[..., -1, lag] = 0.0, gain
            a[..., -1, n + j] -= gain * a[..., lag, n + j] / b[..., lag, j]
        return wider
