"""The model that every tool takes unless told otherwise, and how fast it may be moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import effects_of
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.structure.coriolis_centripetal import (
    coriolis_words,
    CoriolisCentripetal,
)
import numpy as np

# The paper's equations have no Coriolis and centripetal forces, and its models stay as printed.
WITH_CORIOLIS = ('assumed_modes',)
# rad/s. The commands of 1 rad/s in the table of docs/simulator.md turn the joints at up to 1.46
# and 1.54 rad/s; nothing faster was set beside the finite elements.
CHECKED_SPEED = 1.5
# s, over which a speed is taken: sensor noise and steps of an encoder are then no motion.
SPEED_OVER = 0.05


def nominal_robot(robot: Robot, model: str = 'assumed_modes', coriolis: bool = True) -> Robot:
    """
    Return the robot with Coriolis and centripetal forces where its model has them by default.

    What the robot names among its effects, it keeps.

    Parameters
    ----------
    robot : Robot
        As its file says.
    model : str
        A key of extended_arm.MODELS; those of the paper have none.
    coriolis : bool
        False leaves them out.

    """
    name = CoriolisCentripetal.identifier
    if not coriolis or model not in WITH_CORIOLIS or any(e.name == name for e in robot.effects):
        return robot
    return replace(robot, effects=(*robot.effects, EffectSpec(name, 'arm', {'share': 1.0})))


def nominal_effects(robot: Robot, model: str = 'assumed_modes', coriolis: bool = True
                    ) -> tuple[Effect, ...]:
    """Return the effects of nominal_robot, ready for an ExtendedArm."""
    return effects_of(nominal_robot(robot, model, coriolis))


def has_coriolis(effects: Sequence[Effect]) -> bool:
    """Tell whether Coriolis and centripetal forces act among effects."""
    return any(e['share'] != 0.0 for e in effects if isinstance(e, CoriolisCentripetal))


def model_words(name: str, model: str, modes: int, coriolis: bool | None) -> str:
    """Return in a few words which model of a robot is used; None: the forces are estimated."""
    return f'{name}, {model}, {modes} modes, {coriolis_words(coriolis)}'


def beyond_checked(time: Array, joint: Array) -> str:
    """
    Return in one line where a record is faster than the model was checked for; else nothing.

    Parameters
    ----------
    time : Array
        s, (N,).
    joint : Array
        rad, (N, 2).

    """
    if len(time) < 2:
        return ''
    lag = min(max(round(SPEED_OVER * (len(time) - 1) / (time[-1] - time[0])), 1), len(time) - 1)
    speed = np.abs(joint[lag:] - joint[:-lag]) / (time[lag:] - time[:-lag])[:, None]
    k = int(np.argmax(speed.max(axis=0)))
    if not speed[:, k].max() > CHECKED_SPEED:
        return ''
    return (f'joint_{k + 1} turns at up to {speed[:, k].max():.3g} rad/s: the models are checked '
            f'up to {CHECKED_SPEED:g} rad/s, and leave out forces that bend with the links')
