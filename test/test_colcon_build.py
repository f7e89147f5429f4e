"""colcon builds the package; the three installed executables run and publish the payload."""

from __future__ import annotations

from collections.abc import Iterator
import math
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time
from typing import Any, TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rclpy.context import Context

NODES = ('plant_sim', 'payload_estimator', 'lqg_controller')
SHIPPED = ('flex_plant_sim', 'flex_payload_estimator', 'msg_config', 'launch', 'resource',
           'package.xml', 'setup.py', 'setup.cfg', 'pyproject.toml')

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture(scope='module')
def installed(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the installation folder of a colcon build of the shipped files."""
    workspace = tmp_path_factory.mktemp('workspace')
    source = workspace / 'src' / 'flex_payload'
    source.mkdir(parents=True)
    for name in SHIPPED:
        path = repository / name
        copy = shutil.copytree if path.is_dir() else shutil.copy2
        copy(path, source / name)
    result = subprocess.run(
        [sys.executable, '-m', 'colcon', 'build', '--event-handlers', 'console_direct+'],
        cwd=workspace, text=True, capture_output=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return workspace / 'install' / 'flex_payload'


def _environment(installed: Path, domain_id: int) -> dict[str, str]:
    packages = next(installed.glob('lib/python*/site-packages'))
    paths = [str(packages), *filter(None, [os.environ.get('PYTHONPATH')])]
    # A fresh installation has nothing compiled yet, and compiling outlasts the test.
    return {**os.environ, 'ROS_DOMAIN_ID': str(domain_id), 'PYTHONPATH': os.pathsep.join(paths),
            'NUMBA_DISABLE_JIT': '1'}


@pytest.fixture
def processes(
    installed: Path, domain_id: int, tmp_path: Path,
) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    """Return the three installed nodes as running processes."""
    started = {}
    for node in NODES:
        with open(tmp_path / f'{node}.log', 'wb') as log:
            started[node] = subprocess.Popen(
                [installed / 'lib/flex_payload' / node], cwd=tmp_path, stdout=log, stderr=log,
                env=_environment(installed, domain_id))
    yield started
    for process in started.values():
        process.send_signal(signal.SIGINT)
    for process in started.values():
        try:
            process.wait(timeout=10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def test_executables_are_where_ros2_run_looks(installed: Path) -> None:
    for node in NODES:
        assert os.access(installed / 'lib/flex_payload' / node, os.X_OK)
    assert (installed / 'share/ament_index/resource_index/packages/flex_payload').is_file()


def test_an_executable_imports_the_installed_package(installed: Path, tmp_path: Path) -> None:
    result = subprocess.run(
        [sys.executable, '-c', 'import flex_plant_sim; print(flex_plant_sim.__file__)'],
        cwd=tmp_path, env=_environment(installed, 1), text=True, capture_output=True, check=True)
    assert Path(result.stdout.strip()).is_relative_to(installed.resolve())


def _logs(folder: Path) -> str:
    return '\n'.join(f'== {path.name}\n{path.read_text(errors="replace")[-3000:]}'
                     for path in sorted(folder.glob('*.log')))


def test_the_installed_nodes_publish_the_payload(
    processes: dict[str, subprocess.Popen[bytes]], ros_context: Context, tmp_path: Path,
) -> None:
    from msg_config.ros import create_subscription
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.node import Node

    listener = Node('listener', context=ros_context)
    received: list[Any] = []
    create_subscription(listener, 'payload', received.append)
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(listener)
    deadline = time.monotonic() + 60.0
    while len(received) < 100 and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.1)
        stopped = [node for node, process in processes.items() if process.poll() is not None]
        assert not stopped, f'{stopped} stopped:\n{_logs(tmp_path)}'
    executor.shutdown()
    listener.destroy_node()
    assert len(received) >= 100, f'{len(received)} payload messages:\n{_logs(tmp_path)}'
    for message in received:
        mass, variance, p = message.data
        assert math.isfinite(mass)
        assert variance > 0.0
        assert p > 0.0
