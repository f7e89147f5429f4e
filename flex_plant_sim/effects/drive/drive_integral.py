"""Drive integral: a velocity loop that integrates its error, as most servo drives do."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.mechanics.extra_states import with_states


class DriveIntegral(Effect):
    """
    PI in place of P: the loop's torque is d (e + w z), z' = e, with its error e = g/d u - theta'.

    g is the drive's torque gain, d its damping without friction, which is no part of the loop, and
    w one over the integral time. Gravity, springs and friction leave a P loop an error, a PI loop
    none. The integrator starts from zero and has no limit. A lag of the motor acts on the integral
    as well.
    """

    identifier = 'drive_integral'
    family = 'drive and timing'
    explanation = 'The velocity loop of {site} has an integrator: its speed loses less to loads.'
    parameters = (
        # Slower than 10 s hardly acts within a move; servo drives come with 10 to 100 ms.
        Parameter('integral_rate_per_s', '1/s', 0.0, 0.0, 500.0, (0.5, 3.0, 20.0, 80.0), 0.1,
                  20.0),)
    sites = 'velocity_loop'
    structural = True
    needs_rates = True

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with the integral of the error, rad, as its last state."""
        if self['integral_rate_per_s'] == 0.0:
            return plant
        drive, j = robot.drives[self.index], self.index
        damping = drive.damping - drive.friction
        wider = with_states(plant, 1)
        wider.a[..., :-1, -1] = (
            self['integral_rate_per_s'] * damping * plant.e[..., j])
        wider.a[..., -1, plant.e.shape[-1] + j] = -1.0
        wider.b[..., -1, j] = drive.torque_gain / damping
        return wider
