"""Motor lag: a drive builds up its torque with a first-order lag."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.extra_states import with_states
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Time constant, s, below which there is no lag: a hundredth of a sample at 1 kHz.
NO_LAG = 1e-5


class MotorLag(Effect):
    """
    z' = (u - z) / tau between one command and its drive, or for the whole torque of the drive.

    A share inside_loop of the drive's damping d lags as well. With 1 the whole torque of a
    velocity loop lags, z' = (u - d/g theta' - z) / tau with g in N m per unit of command; with 0
    only the command does.
    """

    identifier = 'motor_lag'
    family = 'drive and timing'
    explanation = 'The drive of {site} builds up its torque slowly (a lag of first order).'
    parameters = (
        # A third of the reference sample time.
        Parameter('time_constant_s', 's', 0.0, 0.0, 1.0, (0.01, 0.03, 0.1), 0.003, 0.05),
        Parameter('inside_loop', '', 0.0, -0.5, 1.5, (0.0, 1.0), np.inf, 0.5, optional=True))
    sites = 'joint'
    structural = True

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with the lagged command as its last state."""
        lag, j = self['time_constant_s'], self.index
        if lag < NO_LAG:
            return plant
        drive, rate = robot.drives[j], plant.e.shape[-1] + j
        back = self['inside_loop'] * drive.damping / drive.torque_gain
        wider = with_states(plant, 1)
        a, b = wider.a, wider.b
        a[..., :-1, -1], a[..., -1, -1] = b[..., :-1, j], -1.0 / lag
        if back != 0.0:
            a[..., :-1, rate] += back * b[..., :-1, j]
            a[..., -1, rate] = -back / lag
        b[..., :, j] = 0.0
        b[..., -1, j] = 1.0 / lag
        return wider
