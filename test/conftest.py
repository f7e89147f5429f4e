"""Fixtures of all tests: the repository, the shared records, and a ROS 2 domain per test."""

from __future__ import annotations

from collections.abc import Iterator
import fcntl
import gc
import os
from pathlib import Path
import signal
import tempfile
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rclpy.context import Context
    from ros_loop import RosLoop

REPOSITORY = Path(__file__).resolve().parents[1]
SHARED_DATA = REPOSITORY.parent / 'shared' / 'data'
# Test files that take more than some seconds, the longest first.
LONGEST = (
    'test_style.py', 'test_laws.py', 'test_causes.py', 'test_documented_commands.py',
    'test_fleet.py', 'test_late_event.py', 'test_truth.py', 'test_command_timing.py',
    'test_nodes_processes.py', 'test_bank_quick.py', 'test_refined_fit.py',
    'test_verdict_doubt.py', 'test_outputs.py', 'test_demo.py', 'test_rpe_robust.py',
    'test_rpe_bent_arm.py', 'test_nodes_faults.py', 'test_nodes_bad_samples.py', 'test_events.py',
    'test_nodes_plant.py', 'test_constants.py', 'test_diagnose_tool.py', 'test_nodes_inputs.py',
    'test_rpe_misfit.py', 'test_nodes_lockstep.py', 'test_log_hints.py', 'test_replay.py',
    'test_robot_scale.py', 'test_effects_forms.py', 'test_bank_score.py', 'test_compiled.py',
    'test_diagnose_predictor.py', 'test_colcon_build.py', 'test_latent_forces.py',
    'test_rpe_zero.py', 'test_payload_beside.py', 'test_rpe_lost.py', 'test_attack.py',
    'test_rpe.py', 'test_rate.py', 'test_nodes_messages.py')

# As the tools do: the threads of OpenBLAS multiply the time of a plain `pytest` by five.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
# ROS reads these when a context starts, here and in the processes that a test starts.
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ.setdefault('ROS_LOG_DIR', os.path.join(tempfile.gettempdir(), 'flex_payload_log'))
# A background job of a shell starts with Ctrl-C ignored, and so would the processes of its tests.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first: a worker that got one last would keep all others waiting."""
    items.sort(key=lambda item: LONGEST.index(item.path.name)
               if item.path.name in LONGEST else len(LONGEST))


def pytest_collection_finish() -> None:
    """Keep the collected tests out of the garbage collector's way: they all stay."""
    gc.freeze()


@pytest.fixture(scope='session')
def repository() -> Path:
    """Return the repository's root."""
    return REPOSITORY


@pytest.fixture(scope='session')
def shared_data() -> Path:
    """Return the folder of shared records, beside the repository; skip where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip('the shared records are absent: expected ../shared/data')
    return SHARED_DATA


@pytest.fixture
def domain_id() -> Iterator[int]:
    """Return a ROS domain that no other test on this machine uses, locked by a file."""
    for domain in range(1, 102):
        with open(Path(tempfile.gettempdir()) / f'flex_payload_domain_{domain}', 'w') as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    pytest.fail('all ROS domains from 1 to 101 are in use')


@pytest.fixture
def ros_context(domain_id: int) -> Iterator[Context]:
    """Return an initialised rclpy context in a domain of its own; nodes must name it."""
    from msg_config.transport import avoid_shared_memory
    import rclpy
    from rclpy.context import Context

    avoid_shared_memory()
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    yield context
    rclpy.try_shutdown(context=context)


@pytest.fixture
def loop(ros_context: Context) -> Iterator[RosLoop]:
    """Return an executor in a ROS domain of its own."""
    from ros_loop import RosLoop

    loop = RosLoop(ros_context)
    yield loop
    loop.close()
