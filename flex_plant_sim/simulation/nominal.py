"""
The nominal model, which every tool uses by default, and the joint speed it was checked for.

It decides which effects are added to those of the robot file before the arm is built.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flex_plant_sim.arm.models import DEFAULT_MODEL
from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import effects_of
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.structure.coriolis_centripetal import (
    coriolis_words,
    CoriolisCentripetal,
)
from flex_plant_sim.effects.structure.foreshortening import Foreshortening
import numpy as np

# Models with Coriolis and centripetal forces by default. The paper's equations do not have them,
# and the paper's models are kept as printed.
WITH_CORIOLIS = ('assumed_modes',)
# Joint speed up to which the model was compared with finite elements, rad/s. The commands of
# 1 rad/s in the table of docs/simulator.md turn the joints at up to 1.46 and 1.54 rad/s.
CHECKED_SPEED = 1.5
# Time over which a speed is taken, s: long enough that sensor noise and encoder steps are not
# mistaken for motion.
SPEED_INTERVAL = 0.05


def nominal_robot(robot: Robot, model: str = DEFAULT_MODEL, coriolis: bool = True) -> Robot:
    """
    Return the robot with Coriolis and centripetal forces if its model has them by default.

    Effects that the robot already has are kept.

    Parameters
    ----------
    robot : Robot
        The robot as in its file.
    model : str
        A key of models.MODELS; the paper's models do not have these forces.
    coriolis : bool
        Whether to add the forces.

    """
    if not coriolis or model not in WITH_CORIOLIS:
        return robot
    return _with_all_of(robot, CoriolisCentripetal.identifier)


def nominal_effects(robot: Robot, model: str = DEFAULT_MODEL, coriolis: bool = True
                    ) -> tuple[Effect, ...]:
    """Return the effects of nominal_robot, ready for an ExtendedArm."""
    return effects_of(nominal_robot(robot, model, coriolis))


def with_bent_links(robot: Robot, model: str) -> Robot:
    """Return the robot with the forces of bent links, if its model can have them."""
    return _with_all_of(robot, Foreshortening.identifier) if model in WITH_CORIOLIS else robot


def _with_all_of(robot: Robot, name: str) -> Robot:
    """Return the robot with all of a force of motion, unless it says itself how much of it."""
    if any(effect.name == name for effect in robot.effects):
        return robot
    return replace(robot, effects=(*robot.effects, EffectSpec(name, 'arm', {'share': 1.0})))


def has_coriolis(effects: Sequence[Effect]) -> bool:
    """Return whether Coriolis and centripetal forces are among the effects."""
    return any(e['share'] != 0.0 for e in effects if isinstance(e, CoriolisCentripetal))


def model_words(name: str, model: str, modes: int, coriolis: bool | None) -> str:
    """Return a short text of the model in use; coriolis is None if the forces are estimated."""
    return f'{name}, {model}, {modes} modes, {coriolis_words(coriolis)}'


def beyond_checked(time: Array, joint: Array) -> str:
    """
    Return a one-line warning if a record is faster than the model was checked for, else ''.

    Parameters
    ----------
    time : Array
        s, (N,).
    joint : Array
        rad, (N, 2).

    """
    if len(time) < 2:
        return ''
    samples = round(SPEED_INTERVAL * (len(time) - 1) / (time[-1] - time[0]))
    lag = min(max(samples, 1), len(time) - 1)
    speed = np.abs(joint[lag:] - joint[:-lag]) / (time[lag:] - time[:-lag])[:, None]
    row, k = np.unravel_index(int(np.argmax(speed)), speed.shape)
    if not speed[row, k] > CHECKED_SPEED:
        return ''
    return (f'joint_{k + 1} turns at up to {speed[row, k]:.3g} rad/s, at {time[row]:.6g} s: the '
            f'models are checked up to {CHECKED_SPEED:g} rad/s; their errors grow with its square')
