"""Style, types and the rule that the numerical core knows no ROS."""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path
import re
import subprocess
import sys

import numpy as np
import pytest

SOURCES = ('flex_plant_sim', 'flex_payload_estimator', 'msg_config', 'test', 'benchmarks',
           'launch', 'setup.py')
PACKAGES = SOURCES[:3]
# Beside the nodes, only these use ROS.
ROS_MODULES = ('msg_config.changes', 'msg_config.node_process', 'msg_config.ros',
               'msg_config.wire', 'flex_payload_estimator.tools.demo',
               'flex_payload_estimator.nodes.topic_recorder')


# Syntax trees hold few cycles: looking for them takes a fifth of the time. mypy would begin again.
NO_CYCLES = 'import gc; gc.disable(); gc.enable = lambda: None; '
FLAKE8 = f'{NO_CYCLES}from flake8.main.cli import main; raise SystemExit(main())'
MYPY = f'{NO_CYCLES}from mypy.__main__ import console_entry; console_entry()'


def _run(repository: Path, *command: str) -> None:
    result = subprocess.run([sys.executable, *command], cwd=repository, text=True,
                            capture_output=True)
    assert result.returncode == 0, f'{command}:\n{result.stdout}{result.stderr}'


def _sources(repository: Path) -> list[str]:
    return [name for name in SOURCES if (repository / name).exists()]


def test_ruff(repository: Path) -> None:
    _run(repository, '-m', 'ruff', 'check', '--output-format', 'concise', *_sources(repository))


def test_flake8_with_pep257_as_ament_configures_them(repository: Path) -> None:
    """flake8-docstrings runs pydocstyle, which is what ament_pep257 calls."""
    _run(repository, '-c', FLAKE8, *_sources(repository))


@pytest.mark.skipif(
    tuple(map(int, np.__version__.split('.')[:2])) < (2, 3),
    reason='numpy before 2.3 (Python 3.10) annotates its results too loosely to be checked')
def test_types(repository: Path) -> None:
    _run(repository, '-c', MYPY)


def _core_modules(repository: Path) -> list[str]:
    paths = (path.relative_to(repository).with_suffix('')
             for package in PACKAGES for path in sorted((repository / package).rglob('*.py')))
    names = ('.'.join(path.parts).removesuffix('.__init__') for path in paths)
    return [name for name in names if not name.endswith('_node') and name not in ROS_MODULES]


def test_the_numerical_core_imports_neither_ros_nor_what_is_slow(repository: Path) -> None:
    modules = _core_modules(repository)
    assert {'flex_plant_sim.arm.beam', 'msg_config', 'msg_config.parameters'} < set(modules)
    # Each of scipy's would lengthen the start of every program by half a second.
    shunned = ('rclpy', 'scipy.signal', 'scipy.stats')
    code = (f'import importlib, sys\nfor name in {modules!r}:\n    importlib.import_module(name)\n'
            f'    assert not {{*{shunned!r}}} & {{*sys.modules}}, name\n')
    _run(repository, '-c', code)


@pytest.mark.parametrize('lower, upper', [
    ('msg_config', 'flex_(plant_sim|payload_estimator)'),
    ('flex_plant_sim', 'flex_payload_estimator')])
def test_nothing_is_imported_from_above(repository: Path, lower: str, upper: str) -> None:
    upward = re.compile(rf'^\s*(from|import) {upper}\b', re.MULTILINE)
    assert not [str(path) for path in (repository / lower).rglob('*.py')
                if upward.search(path.read_text(encoding='utf-8'))]


def _imported(path: Path, modules: set[str]) -> set[str]:
    """Return which of the modules a file imports, for types alone or inside a function too."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding='utf-8'))))
    found = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f'{node.module}.{alias.name}' for alias in node.names)}
    return found & modules


def test_no_module_imports_itself_by_way_of_others(repository: Path) -> None:
    paths = {'.'.join(path.relative_to(repository).with_suffix('').parts): path
             for package in PACKAGES for path in (repository / package).rglob('*.py')
             if path.name != '__init__.py'}
    graph = {name: _imported(path, set(paths)) for name, path in paths.items()}
    assert 'flex_plant_sim.arm.robot' in graph['flex_plant_sim.arm.robot_file']
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


def test_no_room_below_imports_one_above(repository: Path) -> None:
    """The rooms of flex_plant_sim stand in the order in which data pass them."""
    rooms = ('arm', 'inputs', 'effects', 'logs', 'simulation', 'diagnosis', 'commissioning')
    for k, room in enumerate(rooms):
        above = {f'flex_plant_sim.{name}' for name in rooms[k + 1:]}
        for path in (repository / 'flex_plant_sim' / room).rglob('*.py'):
            text = path.read_text(encoding='utf-8')
            assert not [name for name in above if f'{name}.' in text], path


def test_no_node_imports_a_tool(repository: Path) -> None:
    """A node has parameters, no command line: what both need stands beside the tools."""
    for package in PACKAGES:
        for path in (repository / package).rglob('nodes/*.py'):
            assert 'flex_plant_sim.tools' not in path.read_text(encoding='utf-8'), path


@pytest.mark.parametrize('name', ['flex_plant_sim', 'flex_payload_estimator'])
def test_modules_are_short(repository: Path, name: str) -> None:
    long = {str(path): lines for path in (repository / name).rglob('*.py')
            if (lines := len(path.read_text(encoding='utf-8').splitlines())) > 350}
    assert not long
