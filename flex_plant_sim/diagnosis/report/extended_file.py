"""Writes the extended robot: the user's file with what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.arm.robot_file import parse_robot, robot_text
from flex_plant_sim.arm.robot_text import with_numbers
from flex_plant_sim.atomic_file import whole_file
from flex_plant_sim.effects.base import Effect


def specs(effects: Sequence[Effect]) -> tuple[EffectSpec, ...]:
    """Return effects in the form in which a robot file holds them."""
    return tuple(EffectSpec(e.identifier, e.site, e.written()) for e in effects)


def write_extended(path: str | Path, source: str | Path, robot: Robot,
                   effects: Sequence[Effect]) -> None:
    """
    Write an extended robot, whole or not at all, with the comments and order of its source.

    It has no mark of these tools, because people go on editing it: nothing replaces it.

    Parameters
    ----------
    path : str or Path
        File to write.
    source : str or Path
        Built-in robot or file that was extended.
    robot : Robot
        Robot with the parameters to write; its effects are ignored.
    effects : sequence of Effect
        All effects, including those of the user's file.

    Raises
    ------
    InputError
        Nothing can be written there, the source cannot be read, or no robot file may say so.

    """
    text = with_numbers(robot_text(source), replace(robot, effects=specs(effects)))
    parse_robot(text, f'{path}: extended robot, not written')
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding='utf-8')
