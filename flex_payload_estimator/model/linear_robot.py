"""What a model that is linear in state and command takes of a robot file's effects."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.effects import as_built, effects_of
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.payload.payload_change import PayloadChange
from flex_plant_sim.effects.payload.payload_mass import PayloadMass

# What these say is the payload, which is estimated: an estimator is neither told nor lacks it.
OF_THE_PAYLOAD = PayloadChange, PayloadMass


def _others(robot: Robot) -> list[Effect]:
    return [effect for effect in effects_of(robot) if not isinstance(effect, OF_THE_PAYLOAD)]


def linear_robot(robot: Robot) -> Robot:
    """
    Return the robot with the parameters that the effects in its file say, and no effects left.

    Raises
    ------
    InputError
        An effect of the file does not fit.

    """
    return replace(as_built(robot, _others(robot)), effects=())


def left_out(robot: Robot) -> str:
    """Return the effects in the robot's file that `linear_robot` lacks, to end a line, or ''."""
    lacking = [f'{effect.identifier}:{effect.site}' for effect in _others(robot)
               if type(effect).on_robot is Effect.on_robot]
    return f'; of the robot file it leaves out {", ".join(lacking)}' if lacking else ''
