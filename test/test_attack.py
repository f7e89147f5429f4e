"""A small budget of the attacks that `make attack` runs at length, and realistic disturbances."""

from __future__ import annotations

import ast
from pathlib import Path
import re
import subprocess
import sys

from flex_plant_sim.arm.robot_file import parse_robot, robot_text
from msg_config.errors import InputError
import pytest


@pytest.mark.parametrize('kind, count', [('csv', 150), ('bag', 40), ('robot', 40)])
def test_mutated_files_are_read_or_refused_in_one_line(
        repository: Path, kind: str, count: int) -> None:
    # In a process of its own, which fails on a traceback, a hang or more memory than allowed.
    run = subprocess.run([sys.executable, '-m', 'attack.run', kind, str(count), '--seed', '2026'],
                         cwd=repository / 'test', capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    counts = ast.literal_eval(re.findall(r'\{.*\}', run.stdout)[-1])
    assert sum(counts.values()) == count
    # What is left of a short log may hold one number changed that nothing contradicts.
    assert counts.get('misled', 0) <= 0.01 * count, run.stdout


REFERENCE = robot_text('reference')
BAD_ROBOTS = [
    (REFERENCE + 'name: again\n', "key 'name': expected once, got twice"),
    (REFERENCE.replace('length_m: 0.6', 'length: 0.6'),
     "links.upper.length_m: expected a value, the key is missing (is it 'length'?)"),
    (REFERENCE.replace('thickness_m: 0.003', 'thickness_m: 3'),
     'links.upper.thickness_m: expected 1e-05 to 0.2, got 3 (is the unit milli'),
    (REFERENCE.replace('length_m: 0.6', 'length_m: 600'), 'is the unit milli'),
    (REFERENCE.replace('70.0e+9', '70'), 'got 70 (is the unit mega… or giga…?)'),
    (REFERENCE.replace('0.003', '0,003'), 'decimal comma? write a point'),
    (REFERENCE.replace('0.003', '010'), "expected a number > 0, got '010'"),
    (REFERENCE.replace('0.003', '9' * 400), 'expected a number > 0, got'),
    (REFERENCE.replace('0.003', '!!python/name:os.system'), 'is not read'),
    (REFERENCE + 'effects: [' + '{name: x},' * 600 + ']', 'effects: expected at most 500'),
    (REFERENCE + 'x: ' + '[' * 400 + ']' * 400, 'expected at most 20 levels'),
    (REFERENCE + 'a: &a [1,1]\n' + ''.join(
        f'{chr(98 + k)}: &{chr(98 + k)} [{", ".join(["*" + chr(97 + k)] * 9)}]\n'
        for k in range(8)), 'expected at most 10000 values'),
    (REFERENCE.replace('kind: velocity_loop', 'kind: [velocity_loop]'), 'drives.shoulder.kind: '),
    ('x' * 70_000, 'expected at most 64000 characters'),
    (REFERENCE[:-4], "line 30: expected an end of line behind 'strain_noise: 5.0': the file may"),
]


@pytest.mark.parametrize('text, message', BAD_ROBOTS)
def test_a_robot_file_that_surprises_is_one_line(text: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        parse_robot(text, 'arm.yaml')
    assert message in str(error.value) and len(str(error.value)) <= 300


@pytest.mark.parametrize('written', ['70e9', '7.0e10', '7e+10', '70000000000'])
def test_numbers_are_read_as_people_write_them(written: str) -> None:
    robot = parse_robot(REFERENCE.replace('70.0e+9', written), 'arm.yaml')
    assert robot.links[0].youngs_modulus == 70e9


@pytest.mark.parametrize('end', ['  # per gauge, 1', '\ntolerances: {payload: 0.5}', '\r\n'])
def test_a_last_line_without_its_end_is_read_where_no_number_can_be_cut(end: str) -> None:
    assert parse_robot(REFERENCE.rstrip('\n') + end, 'arm.yaml').strain_noise == 5e-7


def test_two_links_may_share_an_anchor() -> None:
    head, tail = REFERENCE.split('  lower:\n')
    drives = tail[tail.index('drives:'):]
    text = head.replace('  upper:\n', '  upper: &link\n') + '  lower: *link\n' + drives
    robot = parse_robot(text, 'arm.yaml')
    assert robot.links[0] == robot.links[1]
