"""Inner loops: whether they are compiled yet, and that the tools say so."""

from __future__ import annotations

from importlib import import_module
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

from flex_payload_estimator.tools import compile as flex_compile
from flex_plant_sim.compiled import cold, COMPILED
from flex_plant_sim.tools.command_line import COMPILING
import pytest

if COMPILED:
    from numba.core.dispatcher import Dispatcher

SOURCE = """
from flex_plant_sim.compiled import compiled
from flex_plant_sim.tools.command_line import say_if_compiling

@compiled
def double(x):
    return 2.0 * x

say_if_compiling(double)
print(double(3.0))
"""


@pytest.mark.skipif(not COMPILED, reason='Numba is not installed')
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


@pytest.mark.skipif(not COMPILED, reason='Numba is not installed')
def test_flex_compile_leaves_nothing_to_compile(repository: Path) -> None:
    found = loops(repository)
    assert len(found) > 20
    # The environment has run it; since then a source may have been edited.
    if any(map(cold, found.values())):
        subprocess.run([sys.executable, '-m', 'flex_payload_estimator.tools.compile'], check=True)
    assert {name for name, function in found.items() if cold(function)} == set()


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
            if '\n@compiled\n' in path.read_text(encoding='utf-8'):
                name = '.'.join(path.relative_to(repository).with_suffix('').parts)
                found.update({f'{name}.{key}': value
                              for key, value in vars(import_module(name)).items()
                              if isinstance(value, Dispatcher)})
    return found
