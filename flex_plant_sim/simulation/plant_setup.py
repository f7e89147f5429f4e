"""The simulator that the parameters of plant_sim describe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.effects import build, parse
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import nominal_effects
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.simulator import Noise, Simulator
from msg_config.errors import InputError

# The value of a parameter that stands for the robot file's.
UNTOLD = -1.0


def robot_of(values: Mapping[str, Any]) -> Robot:
    """Return the robot of the parameters robot and sample_time (s; 0: the robot's own)."""
    robot = load_robot(values['robot'])
    return replace(robot, sample_time=values['sample_time'] or robot.sample_time)


def simulator_of(values: Mapping[str, Any]) -> Simulator:
    """
    Return the simulator of a checked table plant_sim.

    Effects of the robot file come first, then those of the parameters; see nominal_robot for
    what is added.

    Raises
    ------
    InputError
        Naming the parameter, what was expected and what came.

    """
    robot = robot_of(values)
    added = tuple(parse(text) for text in values['effects'])
    # What is wrong with these is no fault of the robot file's.
    for spec in added:
        build(spec, robot)
    effects = nominal_effects(replace(robot, effects=(*robot.effects, *added)),
                              values['model'], values['coriolis'])
    payload = _told(values, 'payload', robot.payload_mass)
    arm = ExtendedArm(robot, values['model'], values['modes'], payload, effects,
                      step=robot.sample_time / values['substeps'])
    noise = Noise(_told(values, 'angle_noise', robot.angle_noise),
                  _told(values, 'strain_noise', robot.strain_noise), values['process_noise'])
    return Simulator(arm, profile_of(payload, values['payload_schedule']), noise, values['seed'])


def _told(values: Mapping[str, Any], name: str, own: float) -> float:
    """Return a parameter, or the robot file's number where it is UNTOLD."""
    value: float = values[name]
    if value == UNTOLD:
        return own
    if value < 0.0:
        raise InputError(f"{name}: expected at least 0, or {UNTOLD:g} for the robot file's, "
                         f'got {value:g}')
    return value


def profile_of(mass: float, schedule: tuple[float, ...]) -> PayloadProfile:
    """Return the payload that starts with a mass, kg, and passes the pairs (s, kg)."""
    if len(schedule) % 2:
        raise InputError('payload_schedule: expected pairs time, mass, got '
                         f'{len(schedule)} numbers')
    return PayloadProfile.of_pairs((0.0, mass, *schedule))
