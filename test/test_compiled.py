"""Inner loops: whether they are compiled yet, and that the tools say so."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys

from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.tools.command_line import COMPILING
import pytest

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
