"""
Calibrate the watch of the gauges on finite-element arms in closed loop, sensors right and wrong.

`python benchmarks/sensor_faults.py` drives the arms of `test/truth`, parts drawn from their
tolerances, under the controller with the payload of `rpe`. Printed, for each case, is the largest
error that `GaugeWatch` finds for a gauge, and that gauge; then the gap between the arms whose
sensors are right and the others, in which WRONG must be. `--set FORCE=1` tries another constant.
`--payloads` prints instead by how much right arms with a payload that is not known err more than
`unknown_payload_error` says, on the reference and the Quanser arm, which MARGIN must hold.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
import math
from typing import Any

import _truths  # noqa: F401
from controller_elements import ESTIMATED_MODES, MODEL
from flex_payload_estimator.control import gauge_watch
from flex_payload_estimator.control.arm_watch import ArmWatch
from flex_payload_estimator.control.lqg import LQGController, LQGSettings
from flex_payload_estimator.control.set_points import square
from flex_payload_estimator.estimators.base import largest_payload
from flex_payload_estimator.estimators.factory import make_estimator
from flex_plant_sim.arm.parts import drawn
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
import numpy as np
from sampled_arm import Elements, elements_of
from truth.configuration import Arm

# Largest command; begin of a fault and end of a run, s.
LIMIT, START, END = 5.0, 3.0, 9.0
# Arms for payloads that are not known.
PAYLOAD_SEEDS = range(3, 7)
Spoil = Callable[[Array], None]
Push = Callable[[Elements, float], None]


def arm_of(seed: int, payload: float, joint: int | None = None, soft: float = 1.0,
           name: str = 'reference', **changes: float) -> Arm:
    """Return an arm with drawn parts, softer links, and imperfections of a joint."""
    arm = elements_of(drawn(load_robot(name), np.random.default_rng([seed, 3])), payload)
    links = [replace(link, youngs_modulus=soft * link.youngs_modulus) for link in arm.links]
    joints = list(arm.joints)
    if joint is not None:
        joints[joint] = replace(joints[joint], **changes)  # type: ignore[arg-type]
    return replace(arm, links=(links[0], links[1]), joints=(joints[0], joints[1]))


def wall(joint: int, angle: float) -> Push:
    """Return a mechanical stop."""
    def push(plant: Elements, _: float) -> None:
        if plant.state[0, joint] > angle:
            plant.state[0, joint] = angle
            plant.state[1, joint] = min(0.0, plant.state[1, joint])
    return push


def kick(joint: int, speed: float, count: int) -> Push:
    """Return a push that adds to a joint's speed, rad/s, in so many samples after START."""
    def push(plant: Elements, time: float) -> None:
        if START <= time < START + 0.01 * count - 1e-6:
            plant.state[1, joint] += speed
    return push


def add(index: int, size: float) -> Spoil:
    """Return an offset of an output."""
    def spoil(output: Array) -> None:
        output[index] += size
    return spoil


def scaled(index: int, factor: float) -> Spoil:
    """Return a factor of an output."""
    def spoil(output: Array) -> None:
        output[index] *= factor
    return spoil


def exchanged(one: int, other: int) -> Spoil:
    """Return two outputs that change places."""
    def spoil(output: Array) -> None:
        output[[one, other]] = output[[other, one]]
    return spoil


def right() -> dict[str, dict[str, Any]]:
    """Return arms whose sensors are right."""
    told: dict[str, Any] = {'adapt': False}
    return {
        'no payload': {'arm': arm_of(3, 0.0)}, '0.1 kg': {'arm': arm_of(1, 0.1)},
        '0.3 kg': {'arm': arm_of(2, 0.3)}, '0 kg told for 0.3': {**told, 'arm': arm_of(4, 0.3)},
        '0.3 kg told for 0': {**told, 'arm': arm_of(5, 0.0), 'mass': 0.3},
        'links 30 % softer': {'arm': arm_of(6, 0.2, soft=0.7)},
        'friction 1.5 N m, elbow': {
            'arm': arm_of(1, 0.1, 1, coulomb_forward=1.5, coulomb_backward=1.5)},
        'friction 10 N m, shoulder': {
            'arm': arm_of(1, 0.1, 0, coulomb_forward=10.0, coulomb_backward=10.0)},
        'drive lags 20 ms': {'arm': arm_of(1, 0.1, 0, lag=0.02)},
        'backlash 10 mrad': {'arm': arm_of(1, 0.1, 1, backlash=0.01)},
        'dead zone 0.3': {'arm': arm_of(1, 0.1, 1, dead_zone=0.3)},
        'wall, shoulder': {'arm': arm_of(1, 0.1), 'push': wall(0, 0.3)},
        'wall, elbow': {'arm': arm_of(1, 0.1), 'push': wall(1, 0.3)},
        'kick, shoulder': {'arm': arm_of(1, 0.1), 'push': kick(0, 2.0, 1)},
        'push of 0.2 s, elbow': {'arm': arm_of(1, 0.1), 'push': kick(1, 2.0, 20)},
        'steps of 1 s': {'arm': arm_of(7, 0.1), 'target': square(0.5, 1.0)},
        'gauge 1a off by 2e-5': {'arm': arm_of(1, 0.1), 'spoil': add(2, 2e-5)},
        'steps of 3 rad': {'arm': arm_of(7, 0.3), 'target': square(1.5, 3.0)}}


def wrong() -> dict[str, dict[str, Any]]:
    """Return the same arm with sensors that go wrong."""
    names, found = ('encoder 1', 'encoder 2', '1a', '1b', '2a', '2b'), {}
    for k in range(2, 6):
        found[f'{names[k]} dead'] = scaled(k, 0.0)
        found[f'{names[k]} inverted'] = scaled(k, -1.0)
    for one, other in ((2, 3), (2, 4), (4, 5), (3, 5)):
        found[f'{names[one]}, {names[other]} exchanged'] = exchanged(one, other)
    return {name: {'arm': arm_of(1, 0.1), 'spoil': spoil} for name, spoil in found.items()}


def largest_error(case: dict[str, Any], modes: int, robot_name: str = 'reference'
                  ) -> tuple[float, str]:
    """Return the largest error of a gauge in a run, and the gauge."""
    robot, adapt = load_robot(robot_name), case.get('adapt', True)
    mass, target = case.get('mass', 0.0), case.get('target', square(0.5, 4.0))
    controller = LQGController(robot, MODEL, modes, LQGSettings(
        adapt=adapt, mass_0=mass, payload_max=largest_payload(robot, None), integrator=True,
        command_limit=LIMIT))
    estimator = make_estimator('rpe', robot, MODEL, ESTIMATED_MODES) if adapt else None
    watch, plant = ArmWatch(robot, controller, LIMIT), Elements(case['arm'], robot, 0)
    sent, worst, name = np.zeros(2), 0.0, ''
    for k in range(round(END / robot.sample_time)):
        time, output = k * robot.sample_time, plant.measure()
        if 'push' in case:
            case['push'](plant, time)
        if 'spoil' in case and time >= START:
            case['spoil'](output)
        if estimator is not None:
            mass = estimator.update(time, output, sent).mass
        command = controller.command(time, output, sent, mass, target(time))
        watch(time, output, (np.nan, np.nan), sent, sent, END)
        sent = command
        plant.step(sent)
        for gauge, error in watch.gauge_errors.items():
            worst, name = max((worst, name), (error, gauge))
    return worst, name


def payload_errors(name: str, modes: int, seed: int) -> tuple[float, float]:
    """Return a right arm's error with the largest payload untold, and with it told for none."""
    largest = largest_payload(load_robot(name), None)
    untold, told = ({'arm': arm_of(seed, carried, name=name), 'adapt': False, 'mass': believed}
                    for believed, carried in ((0.0, largest), (largest, 0.0)))
    return largest_error(untold, modes, name)[0], largest_error(told, modes, name)[0]


def print_payloads() -> None:
    """Print the errors of right arms with a payload that is not known, and what is expected."""
    for name, modes in (('reference', 2), ('reference', 3), ('quanser_2dsfl', 2),
                        ('quanser_2dsfl', 3)):
        robot = load_robot(name)
        controller = LQGController(robot, MODEL, modes, LQGSettings(
            payload_max=largest_payload(robot, None), integrator=False, command_limit=LIMIT))
        watch = ArmWatch(robot, controller, LIMIT).gauges
        expected = math.nan if watch is None else watch.payload_error
        found = np.array([payload_errors(name, modes, seed) for seed in PAYLOAD_SEEDS]).max(0)
        print(f'{name:14s} {modes} modes: expected {expected:.2f}, found {found[0]:.2f} untold, '
              f'{found[1]:.2f} told for none', flush=True)


def main() -> None:
    """Print a line per case, and the gap."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--modes', type=int, default=3)
    parser.add_argument('--set', nargs='*', default=[], metavar='NAME=VALUE',
                        help='other constants of gauge_watch')
    parser.add_argument('--payloads', action='store_true', help='payloads that are not known')
    given = parser.parse_args()
    for pair in given.set:
        name, value = pair.split('=')
        setattr(gauge_watch, name, type(getattr(gauge_watch, name))(value))
    if given.payloads:
        print_payloads()
        return
    found = {}
    for kind, cases in (('right', right()), ('wrong', wrong())):
        for name, case in cases.items():
            error, gauge = largest_error(case, given.modes)
            found[name] = kind, error
            print(f'{kind:6s}{name:28s}{error:6.2f} {gauge}', flush=True)
    for kind, extreme in (('right', max), ('wrong', min)):
        print(f'{kind}: {extreme(error for of, error in found.values() if of == kind):.2f}')


if __name__ == '__main__':
    main()
