"""Motor lag: a drive builds up its torque with a delay of first order."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.mechanics.extra_states import with_states

NO_LAG = 1e-5


class MotorLag(Effect):
    """z' = (u - z) / tau between one command and its drive."""

    identifier = 'motor_lag'
    family = 'drive and timing'
    explanation = 'The drive of {site} builds up its torque slowly (a lag of first order).'
    parameters = (
        # A third of the reference sample time.
        Parameter('time_constant_s', 's', 0.0, 0.0, 1.0, (0.01, 0.03, 0.1), 0.003, 0.05),)
    sites = 'joint'
    structural = True

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with the lagged command as its last state."""
        lag = self['time_constant_s']
        if lag < NO_LAG:
            return plant
        wider = with_states(plant, 1)
        a, b = wider.a, wider.b
        a[..., :-1, -1], a[..., -1, -1] = b[..., :-1, self.index], -1.0 / lag
        b[..., :, self.index] = 0.0
        b[..., -1, self.index] = 1.0 / lag
        return wider
