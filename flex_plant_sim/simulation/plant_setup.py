"""Builds the simulator from the parameters of the node plant_sim and the robot file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from flex_plant_sim.arm.file_section import PLAUSIBLE
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.effects import as_built, build, parse
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import nominal_effects
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.simulator import Noise, Simulator
from msg_config.errors import InputError

# Value of a parameter that means: take the number of the robot file.
FROM_ROBOT_FILE = -1.0


def robot_of(values: Mapping[str, Any]) -> Robot:
    """Return the robot of the parameters robot and sample_time (s; 0: that of the robot file)."""
    robot = load_robot(values['robot'])
    return replace(robot, sample_time=values['sample_time'] or robot.sample_time)


def simulator_of(values: Mapping[str, Any]) -> Simulator:
    """
    Return the simulator of a checked table of parameters of plant_sim.

    The effects of the robot file come first, then those of the parameters; nominal_robot may add
    one.

    Raises
    ------
    InputError
        Names the parameter, what was expected and what was found.

    """
    robot = robot_of(values)
    added = tuple(parse(text) for text in values['effects'])
    # Built here on their own, so that an error does not point to the robot file.
    for spec in added:
        build(spec, robot)
    effects = nominal_effects(replace(robot, effects=(*robot.effects, *added)),
                              values['model'], values['coriolis'])
    payload = _parameter(values, 'payload', robot.payload_mass)
    arm = ExtendedArm(robot, values['model'], values['modes'], payload, effects,
                      step=robot.sample_time / values['substeps'])
    noise = Noise(_parameter(values, 'angle_noise', robot.angle_noise),
                  _parameter(values, 'strain_noise', robot.strain_noise), values['process_noise'])
    told = profile_of(payload, values['payload_schedule'])
    carried = PayloadProfile(told.times, tuple(_carried(mass, arm) for mass in told.masses))
    return Simulator(arm, carried, noise, values['seed'])


def _carried(told: float, arm: ExtendedArm) -> float:
    """Return the payload that an arm carries where it is told another one, kg."""
    return as_built(replace(arm.robot, payload_mass=told), arm.effects).payload_mass


def _parameter(values: Mapping[str, Any], name: str, own: float) -> float:
    """Return the value of a parameter, or the robot file's number if it is FROM_ROBOT_FILE."""
    value: float = values[name]
    return own if value == FROM_ROBOT_FILE else value


def profile_of(mass: float, schedule: tuple[float, ...]) -> PayloadProfile:
    """Return the payload that starts with a mass, kg, and follows pairs of time, s, and mass."""
    if len(schedule) % 2:
        raise InputError('payload_schedule: expected pairs time, mass, got '
                         f'{len(schedule)} numbers')
    times, masses = schedule[::2], schedule[1::2]
    if any(b < a for a, b in zip((0.0, *times), times)):
        raise InputError('payload_schedule: expected times from 0 on that do not decrease, got '
                         f'{", ".join(f"{t:g}" for t in times)}')
    largest = PLAUSIBLE['mass_kg'][1]
    if not all(0.0 <= m <= largest for m in masses):
        raise InputError(f'payload_schedule: expected masses from 0 to {largest:g} kg, got '
                         f'{", ".join(f"{m:g}" for m in masses)}')
    return PayloadProfile.of_pairs((0.0, mass, *schedule))
