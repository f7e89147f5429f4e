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

# Effects that multiply one sensor's reading, and those that add to it.
SCALES, ZEROS = ('strain_gain', 'angle_gain'), ('strain_bias', 'angle_offset')


def specs(effects: Sequence[Effect]) -> tuple[EffectSpec, ...]:
    """Return effects in the form in which a robot file holds them."""
    return tuple(EffectSpec(e.identifier, e.site, e.written()) for e in effects)


def merged_readings(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """
    Return effects that do the same with at most one scale and one zero a sensor.

    The user's file, the parts and the causes may each have brought one. Where something else acts
    on the readings as well (a drift, crosstalk, a scale that creeps), the order of all matters and
    they stay as they are.
    """
    readings: dict[str, list[Effect]] = {}
    for effect in effects:
        if _is_scale(effect) or effect.identifier in ZEROS:
            readings.setdefault(effect.site, []).append(effect)
        elif type(effect).on_output is not Effect.on_output or effect.identifier in SCALES:
            return tuple(effects)
    found: list[Effect] = []
    for effect in effects:
        if effect not in readings.get(effect.site, ()):
            found.append(effect)
        elif effect is readings[effect.site][0]:
            found += _merged(readings[effect.site])
    return tuple(found)


def _is_scale(effect: Effect) -> bool:
    """Return whether an effect does no more to a reading than multiply it."""
    nulls = [parameter.null for parameter in effect.parameters[1:]]
    return effect.identifier in SCALES and list(effect.values[1:]) == nulls


def _merged(readings: Sequence[Effect]) -> list[Effect]:
    """Return the scale and the zero of one sensor that do what all of its effects do in turn."""
    total, found = {True: 1.0, False: 0.0}, {_is_scale(effect): effect for effect in readings}
    for effect in readings:
        if _is_scale(effect):
            total = {scale: value * effect.values[0] for scale, value in total.items()}
        else:
            total[False] += effect.values[0]
    return [replace(found[scale], values=(total[scale], *found[scale].values[1:]))
            for scale in (True, False) if scale in found]


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
    described = replace(robot, effects=specs(merged_readings(effects)))
    text = with_numbers(robot_text(source), described)
    parse_robot(text, f'{path}: extended robot, not written')
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding='utf-8')
