"""Inner loops: whether they are compiled yet, and that the tools say so."""

from __future__ import annotations

from importlib import import_module
import os
from pathlib import Path
import subprocess
import sys
from typing import Any
from unittest.mock import Mock

from flex_payload_estimator.estimators.rpe import filter_step
from flex_payload_estimator.nodes import node_setup
from flex_payload_estimator.tools import compile as flex_compile
from flex_plant_sim.compiled import cold, COMPILED, COMPILING, HAS_LOOPS
from flex_plant_sim.diagnosis.prediction import recursion
from flex_plant_sim.diagnosis.prediction.scheduled_matrices import ScheduledMatrices
from msg_config.parameters import check_parameters
import numpy as np
import pytest

if COMPILED:
    from numba.core.dispatcher import Dispatcher

SOURCE = """
from flex_plant_sim.compiled import compiled, say_if_compiling

@compiled
def double(x):
    return 2.0 * x

say_if_compiling(double)
print(double(3.0))
"""


@pytest.mark.skipif(not COMPILED, reason='Numba is not installed')
def test_the_diagnosis_recursion_sees_one_memory_layout(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever slice of the records drives it: another one is compiled anew, for many seconds."""
    seen: list[bool] = []
    monkeypatch.setattr(recursion, '_propagate_compiled', lambda *given: seen.extend(
        item.flags.c_contiguous for group in given
        for item in (group if isinstance(group, tuple) else [group])
        if isinstance(item, np.ndarray)))
    drive = np.zeros((5, 2, 8))[:, :, ::2]
    recursion.propagate_with_gaps(
        ScheduledMatrices(np.zeros((5, 2), dtype=int), np.zeros((5, 2)), np.zeros((3, 8, 4))),
        drive, np.zeros((1, 4)), np.zeros((2, 1), dtype=int), None,
        recursion.Backlashes.none(np.zeros((2, 4))))
    assert len(seen) > 10 and all(seen)


def test_what_is_about_to_be_compiled_is_said_once_for_each_installation(tmp_path: Path) -> None:
    script = tmp_path / 'loops.py'
    script.write_text(SOURCE)
    environment = {**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path / 'cache')}
    said = []
    for source in (SOURCE, SOURCE, SOURCE.replace('2.0', '2.50')):
        if script.read_text() != source:
            script.write_text(source)
        answer = subprocess.run([sys.executable, str(script)], env=environment, text=True,
                                capture_output=True, check=True)
        said.append((answer.stdout, answer.stderr))
    # The first time, not the second, and again where the source is another.
    assert said == [('6.0\n', f'{COMPILING}\n'), ('6.0\n', ''), ('7.5\n', f'{COMPILING}\n')]


INNER = """
from flex_plant_sim.compiled import compiled

@compiled
def double(x):
    return 2.0 * x
"""
OUTER = """
from flex_plant_sim.compiled import compiled
from flex_plant_sim.inner import double

@compiled
def quadruple(x):
    return double(double(x))

print(quadruple(3.0))
"""


@pytest.mark.skipif(not COMPILED, reason='Numba is not installed')
def test_a_loop_is_compiled_anew_where_what_it_calls_has_changed(repository: Path,
                                                                 tmp_path: Path) -> None:
    package = tmp_path / 'flex_plant_sim'
    package.mkdir()
    for name in ('__init__.py', 'compiled.py'):
        (package / name).write_text((repository / 'flex_plant_sim' / name).read_text())
    (package / 'outer.py').write_text(OUTER)
    environment = {**os.environ, 'PYTHONPATH': str(tmp_path),
                   'NUMBA_CACHE_DIR': str(tmp_path / 'cache')}
    said = []
    # Of another size: within one second Python takes a file of the same size for the same.
    for source in (INNER, INNER, INNER.replace('2.0', '3.00')):
        (package / 'inner.py').write_text(source)
        said.append(subprocess.run([sys.executable, '-m', 'flex_plant_sim.outer'], text=True,
                                   env=environment, cwd=tmp_path, capture_output=True,
                                   check=True).stdout)
    assert said == ['12.0\n', '12.0\n', '27.0\n']


@pytest.mark.skipif(not COMPILED, reason='Numba is not installed')
def test_flex_compile_leaves_nothing_to_compile(repository: Path) -> None:
    found = loops(repository)
    assert len(found) > 20
    # The environment has run it; since then a source may have been edited.
    if any(map(cold, found.values())):
        subprocess.run([sys.executable, '-m', 'flex_payload_estimator.tools.compile'], check=True)
    assert {name for name, function in found.items() if cold(function)} == set()


def test_no_loop_is_of_a_source_whose_changes_go_unnoticed(repository: Path) -> None:
    # What is compiled into another source's loop stays there until the digest changes.
    for name, function in loops(repository).items():
        source = Path(function.py_func.__code__.co_filename)
        assert HAS_LOOPS.search(source.read_bytes()), (name, source.name)


def test_flex_compile_runs_what_free_parts_tell_after_a_pass(monkeypatch: pytest.MonkeyPatch
                                                             ) -> None:
    # It is called seconds after a motion begins, when nobody waits for a compiler.
    averaged = Mock(return_value=(0.0, 0.0))
    monkeypatch.setattr(filter_step, 'far_part_averaged', averaged)
    flex_compile.estimators()
    averaged.assert_called()


def test_a_bad_option_of_flex_compile_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        flex_compile.main(['everything'])
    assert ended.value.code == 2
    assert capsys.readouterr().err.splitlines()[1:] == []


def loops(repository: Path) -> dict[str, Any]:
    """Return every compiled function of the packages by name."""
    found = {}
    for package in ('flex_plant_sim', 'flex_payload_estimator'):
        for path in (repository / package).rglob('*.py'):
            if HAS_LOOPS.search(path.read_bytes()):
                name = '.'.join(path.relative_to(repository).with_suffix('').parts)
                found.update({f'{name}.{key}': value
                              for key, value in vars(import_module(name)).items()
                              if isinstance(value, Dispatcher)})
    return found


@pytest.mark.skipif(not COMPILED, reason='Numba is not installed')
@pytest.mark.parametrize(('build', 'node'), [
    ('announced_estimator', 'payload_estimator'),
    ('announced_controller', 'lqg_controller')])
def test_a_node_says_that_it_is_about_to_compile(build: str, node: str, tmp_path: Path) -> None:
    # It answers no parameter service while it does.
    source = (f'from flex_payload_estimator.nodes.node_setup import {build}\n'
              'from flex_plant_sim import compiled\n'
              'def stop(function):\n'
              '    compiled.say_if_compiling(function)\n'
              '    raise SystemExit\n'
              'import flex_payload_estimator.nodes.node_setup as node_setup\n'
              'node_setup.say_if_compiling = stop\n'
              'from msg_config.parameters import check_parameters\n'
              f'{build}(check_parameters({node!r}, {{}}))\n')
    answer = subprocess.run([sys.executable, '-c', source], text=True, capture_output=True,
                            env={**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path)}, check=True)
    assert answer.stderr == f'{COMPILING}\n'


def test_flex_compile_says_nothing_of_what_it_is_there_for(
        monkeypatch: pytest.MonkeyPatch) -> None:
    # Each of its processes said it once more.
    said: list[Any] = []
    monkeypatch.setattr(node_setup, 'say_if_compiling', said.append)
    flex_compile.regressions()
    assert not said
    node_setup.announced_controller(check_parameters('lqg_controller', {}))
    assert len(said) == 1
