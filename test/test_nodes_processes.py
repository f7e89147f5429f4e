"""The nodes as processes: how they end, and what a bad parameter says."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rclpy.context import Context

PROGRAMS = {
    'plant_sim': ('flex_plant_sim.nodes.start',),
    'payload_estimator': ('flex_payload_estimator.nodes.start', 'payload_estimator'),
    'lqg_controller': ('flex_payload_estimator.nodes.start', 'lqg_controller')}
# How each is asked to end, and what it may answer.
ENDS = {'plant_sim': (signal.SIGTERM, (0,)), 'payload_estimator': (signal.SIGINT, (130,)),
        'lqg_controller': (signal.SIGTERM, (0,))}

pytestmark = pytest.mark.ros


def start(domain_id: int, node: str, *arguments: str) -> subprocess.Popen[str]:
    """Start a node as a process in a ROS domain of its own."""
    parameters = [item for text in arguments for item in ('-p', text)]
    return subprocess.Popen(
        [sys.executable, '-m', *PROGRAMS[node], '--ros-args', *parameters],
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain_id),
             'PYTHONPATH': str(Path(__file__).resolve().parents[1])},
        text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


@pytest.mark.parametrize(('node', 'parameter', 'text'), [
    ('plant_sim', 'modes:=two', 'plant_sim: '),
    ('payload_estimator', 'estimator:=oracle', 'payload_estimator: estimator: expected '),
    ('lqg_controller', 'payload_initial', 'payload_initial'),
    ('payload_estimator', 'use_sim_time:=3', 'use_sim_time'),
])
def test_a_bad_parameter_is_one_line_with_code_2(
    domain_id: int, node: str, parameter: str, text: str,
) -> None:
    process = start(domain_id, node, parameter)
    _, error = process.communicate(timeout=60.0)
    assert process.returncode == 2, error
    assert text in error
    assert parameter.partition(':=')[0] in error
    own = [line for line in error.splitlines() if '[rcl]' not in line]
    assert len(own) == 1, error


@pytest.mark.parametrize(('node', 'parameters', 'text'), [
    ('payload_estimator', ('estimator:=sf1', 'modes:=2', 'payload_initial:=1.0'),
     'payload_initial: expected at most the largest payload, 0.731976 kg, got 1'),
    ('lqg_controller', ('model:=paper_reduced', 'payload_initial:=1000.0', 'q_2:=1e-12',
                        'n_prime:=8'), 'the iteration does not settle')])
def test_parameters_that_do_not_go_together_are_one_line_with_code_2(
    domain_id: int, node: str, parameters: tuple[str, ...], text: str,
) -> None:
    process = start(domain_id, node, *parameters)
    _, error = process.communicate(timeout=60.0)
    assert process.returncode == 2, error
    assert f'{node}: ' in error and text in error
    assert len([line for line in error.splitlines() if '[rcl]' not in line]) == 1, error


@pytest.mark.parametrize('asked', [(), ('estimator',)])
def test_a_node_that_is_none_is_one_line_with_code_2(asked: tuple[str, ...]) -> None:
    done = subprocess.run([sys.executable, '-m', PROGRAMS['payload_estimator'][0], *asked],
                          text=True, capture_output=True, timeout=60.0)
    assert done.returncode == 2
    assert done.stderr == ('error: NODE: expected payload_estimator or lqg_controller, got '
                           f'{asked[0] if asked else "none"}\n')


@pytest.mark.parametrize(('argument', 'code', 'text'), [
    ('--robot', 2, '--robot: expected arguments of ROS alone, as --ros-args -p robot:=FILE'),
    ('robot:=my_arm.yaml', 2, 'robot:=my_arm.yaml: expected arguments of ROS alone'),
    ('--help', 0, 'usage: ')])
def test_an_argument_that_is_not_of_ros_starts_no_node(
        domain_id: int, argument: str, code: int, text: str) -> None:
    done = subprocess.run([sys.executable, '-m', *PROGRAMS['payload_estimator'], argument],
                          env={**os.environ, 'ROS_DOMAIN_ID': str(domain_id)}, text=True,
                          capture_output=True, timeout=60.0)
    assert done.returncode == code
    said = done.stderr if code else done.stdout
    assert text in said and len(said.splitlines()) == (1 if code else 2)


def test_closed_standard_streams_stop_no_node(domain_id: int) -> None:
    make = ('from msg_config.quiet_start import open_what_is_closed; open_what_is_closed(); '
            'import rclpy; rclpy.init(); from msg_config.node_process import make_executor; '
            'make_executor().shutdown(); import os; os._exit(7)')
    process = subprocess.run(['bash', '-c', 'exec "$@" <&- >&- 2>&-', '_', sys.executable, '-c',
                              make], env={**os.environ, 'ROS_DOMAIN_ID': str(domain_id)},
                             cwd=Path(__file__).resolve().parents[1], check=False, timeout=60.0)
    assert process.returncode == 7


def test_a_quality_of_service_that_is_none_is_named(domain_id: int) -> None:
    process = start(domain_id, 'plant_sim', 'qos_overrides./strain.publisher.reliability:=good')
    _, error = process.communicate(timeout=60.0)
    assert process.returncode == 2, error
    assert 'plant_sim: qos_overrides of strain: ' in error
    assert 'Traceback' not in error


@pytest.mark.parametrize(('delay', 'number'), [(0.7, signal.SIGINT), (1.2, signal.SIGTERM)])
def test_a_signal_during_the_start_ends_quietly(
    domain_id: int, delay: float, number: signal.Signals,
) -> None:
    from faults.start_signals import attack

    found = attack('lqg_controller', number, delay, domain_id)
    assert found.clean, found


BUSY = """
import sys
from flex_plant_sim.nodes.plant_sim_node import PlantSim
from msg_config.node_process import run

def busy():
    print('busy', flush=True)
    sum(range(5_000_000))

def make():
    node = PlantSim()
    node.create_timer(0.01, busy)
    return node

sys.exit(run(make, []))
"""


def test_a_signal_in_any_callback_ends_quietly(domain_id: int) -> None:
    process = subprocess.Popen(
        [sys.executable, '-c', BUSY], cwd=Path(__file__).resolve().parents[1], text=True,
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain_id)}, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == 'busy\n'
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=20.0)
    assert process.returncode == 130
    assert all('[INFO]' in line for line in error.splitlines()), error


def test_three_processes_in_lock_step_take_any_start_order_and_end_cleanly(
    ros_context: Context, domain_id: int,
) -> None:
    from ros_loop import RosLoop

    loop = RosLoop(ros_context)
    inertia = loop.record('payload/inertia')
    common = ('model:=paper_reduced', 'modes:=2')
    processes = {node: start(domain_id, node, *common, *own) for node, own in (
        ('lqg_controller', ()), ('plant_sim', ()), ('payload_estimator', ('estimator:=sf1',)))}
    try:
        loop.until(lambda: len(inertia.stamps) >= 350)
        assert inertia[-1].inertia.m == pytest.approx(0.1, rel=0.05)
        stamps = sorted(inertia.stamps)
        assert {b - a for a, b in zip(stamps, stamps[1:])} == {10_000_000}
        for node, (number, codes) in ENDS.items():
            processes[node].send_signal(number)
            _, error = processes[node].communicate(timeout=20.0)
            assert processes[node].returncode in codes, f'{node}: {error}'
            assert 'Traceback' not in error, f'{node}: {error}'
    finally:
        for process in processes.values():
            process.kill()
            process.communicate()
        loop.close()
