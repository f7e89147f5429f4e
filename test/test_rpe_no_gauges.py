"""The default estimator on an arm whose links have no gauges: its joints alone tell."""

from __future__ import annotations

import json
import os
from pathlib import Path
import re
import subprocess
import sys
from typing import TYPE_CHECKING

from flex_plant_sim.arm.parts import drawn
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot, robot_text
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
from node_bench import Bench
import numpy as np
import pytest
from rpe_runs import estimator_of, square

if TYPE_CHECKING:
    from ros_loop import RosLoop

BARE = re.sub('gauge_positions_m: .*', 'gauge_positions_m: []', robot_text('reference'))
REST_S = 0.3


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    """Return the reference robot without gauges, from a file of its own."""
    (tmp_path / 'bare.yaml').write_text(BARE)
    found = load_robot(tmp_path / 'bare.yaml')
    assert not found.gauge_names
    return found


def recorded(robot: Robot, mass: float, seconds: float, seed: int) -> Log:
    """Return the record of an arm that rests for REST_S, and then follows square set-points."""
    simulator = Simulator(ExtendedArm(robot, 'assumed_modes', 3, mass), None,
                          Noise(robot.angle_noise, robot.strain_noise), seed)
    times, outputs, commands = [], [], []
    for _ in range(round(seconds / robot.sample_time) + 1):
        sample = simulator.measure()
        moves = sample.time > REST_S
        command = 4.0 * (square(sample.time) - sample.angle) if moves else np.zeros(2)
        times.append(sample.time)
        outputs.append(sample.output)
        commands.append(command)
        simulator.step(command)
    channels = np.array(outputs)
    return Log('run', np.array(times), np.array(commands), channels[:, :2],
               channels[:, 2:], ())


@pytest.mark.parametrize('disabled', ['0', '1'])
def test_flex_estimate_weighs_it_compiled_and_not(
        robot: Robot, tmp_path: Path, disabled: str) -> None:
    write_csv(tmp_path / 'log.csv', recorded(robot, 0.17, 1.5, seed=1))
    answer = subprocess.run(
        [sys.executable, '-W', 'error', '-m', 'flex_payload_estimator.tools.estimate',
         str(tmp_path / 'log.csv'), '--robot', str(tmp_path / 'bare.yaml'), '--modes', '2',
         '--json', str(tmp_path / 'out.json')],
        env={**os.environ, 'NUMBA_DISABLE_JIT': disabled}, text=True, capture_output=True)
    assert answer.returncode == 0 and 'illegal' not in answer.stdout + answer.stderr
    found = json.loads((tmp_path / 'out.json').read_text())
    assert abs(found['mass_kg'] - 0.17) < 3.0 * found['std_kg'] < 0.1


@pytest.mark.parametrize('seed', range(4))
def test_its_variance_is_that_of_its_error_when_parts_are_off(robot: Robot, seed: int) -> None:
    random = np.random.default_rng(seed)
    mass, estimator = random.uniform(0.03, 0.3), estimator_of(robot, modes=3)
    log, command = recorded(drawn(robot, random), mass, 3.0, seed), np.zeros(2)
    found = []
    for time, output, after in zip(log.time, log.measured, log.command):
        found.append(estimator.update(float(time), output, command))
        command = after
    errors = np.array([e.mass - mass for e in found])
    std = np.sqrt([e.variance for e in found])
    assert np.isfinite(errors).all() and (std > 0.0).all() and not estimator.events
    rest = round(REST_S / robot.sample_time)
    assert {e.status for e in found[:rest]} == {'not_excited'} and std[:rest].min() > 0.1
    # Parts of some tolerances leave at least half a percent of the payload open.
    assert found[-1].status == 'ok' and 0.005 * mass < std[-1] < 0.2 * mass
    assert (np.abs(errors[100:]) < 3.0 * std[100:]).all()


@pytest.mark.ros
def test_the_node_weighs_it_from_the_joints_alone(
        robot: Robot, tmp_path: Path, loop: RosLoop) -> None:
    log = recorded(robot, 0.17, 1.5, seed=1)
    bench = Bench(loop, 'estimator', robot=str(tmp_path / 'bare.yaml'), estimator='rpe',
                  model='assumed_modes', modes=2)
    payload = loop.record('payload_stamped')
    loop.until(lambda: bench.node.count_subscribers('payload_stamped') > 0)
    before = np.zeros(2)
    for k, (angle, command) in enumerate(zip(log.joint, log.command)):
        bench.joint_only(k, angle, before)
        before = command
    loop.until(lambda: len(payload) >= len(log.time))
    mass, variance = payload[-1].position[0], payload[-1].effort[0]
    assert abs(mass - 0.17) < 3.0 * variance**0.5 < 0.1
