"""Robot files: what they say, and one line for every way to get them wrong."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
import subprocess
import sys
from typing import Any

from flex_plant_sim.arm.robot_file import built_in_robots, load_robot, parse_robot
from msg_config.errors import InputError
from paper_equations import constants_33
import pytest
import yaml

TEXT = (resources.files('flex_plant_sim') / 'robots' / 'reference.yaml').read_text()
DELETE = object()


def changed(path: str, value: Any) -> str:
    """Return the reference robot's file with one key changed, added or deleted."""
    data = yaml.safe_load(TEXT)
    *sections, key = path.split('.')
    section = data
    for name in sections:
        section = section[name]
    if value is DELETE:
        del section[key]
    else:
        section[key] = value
    return yaml.safe_dump(data)


FAULTS = [
    ('links.upper.length_m', DELETE, 'robot.yaml: links.upper.length_m: expected a value, '
                                     'the key is missing'),
    ('elbow.mass_kg', -0.6, 'robot.yaml: elbow.mass_kg: expected a number >= 0, got -0.6'),
    ('payload.mass_kg', -1, 'robot.yaml: payload.mass_kg: expected a number >= 0, got -1'),
    ('links.lower.thickness_m', 0, 'robot.yaml: links.lower.thickness_m: expected a number > 0, '
                                   'got 0'),
    ('links.lower.density_kg_per_m3', 'steel', 'robot.yaml: links.lower.density_kg_per_m3: '
                                               "expected a number > 0, got 'steel'"),
    ('links.upper.height_m', True, 'robot.yaml: links.upper.height_m: expected a number > 0, '
                                   'got True'),
    ('links.upper.height_m', float('nan'), 'robot.yaml: links.upper.height_m: expected a number '
                                           '> 0, got nan'),
    ('links.upper.gauge_positions_m', 0.03, 'robot.yaml: links.upper.gauge_positions_m: expected '
                                            'a list of numbers, got 0.03'),
    ('links.upper.gauge_positions_m', [0.03, 0.9], 'robot.yaml: links.upper.gauge_positions_m: '
                                                   'expected at most 0.6, got 0.9'),
    ('links.upper.colour', 'red', 'robot.yaml: links.upper.colour: unknown key'),
    ('name', 'my\x07arm', 'robot.yaml: name: expected a name of printable characters, got '
                          "'my\\x07arm'"),
    ('inputs', {'joints': {'joint_1': {'name': 'q\n1'}}},
     'robot.yaml: inputs.joints.joint_1.name: expected a name of printable characters, got '
     "'q\\n1'"),
    ('weight_kg', 3, 'robot.yaml: weight_kg: unknown key'),
    ('drives.elbow.kind', 'hydraulic', 'robot.yaml: drives.elbow.kind: expected velocity_loop or '
                                       "current or dc_motor, got 'hydraulic'"),
    ('drives', 3, 'robot.yaml: drives: expected a mapping, got 3'),
    ('effects', {'name': 'backlash'}, 'robot.yaml: effects: expected a list, got '
                                      "{'name': 'backlash'}"),
    ('tolerances', {'stiffnes': 0.1},
     "robot.yaml: tolerances.stiffnes: unknown key (is it 'stiffness'?)"),
    ('measurement.sample_time_s', 0.0, 'robot.yaml: measurement.sample_time_s: expected a number '
                                       '> 0, got 0.0'),
]


@pytest.mark.parametrize('path, value, message', FAULTS)
def test_a_fault_is_named_in_one_line(path: str, value: Any, message: str) -> None:
    with pytest.raises(InputError) as error:
        parse_robot(changed(path, value), 'robot.yaml')
    assert str(error.value) == message


@pytest.mark.parametrize('text', ['links: [1, 2', '- 1\n- 2\n', '', 'just words'])
def test_what_is_no_robot_file_is_named_in_one_line(text: str) -> None:
    with pytest.raises(InputError) as error:
        parse_robot(text, 'robot.yaml')
    assert str(error.value).startswith('robot.yaml: ')
    assert '\n' not in str(error.value)


def test_unknown_robot_names_those_that_exist() -> None:
    with pytest.raises(InputError) as error:
        load_robot('scara')
    assert str(error.value) == ('robot: expected one of quanser_2dsfl, reference or a YAML file, '
                                "got 'scara', which is no file here")


def test_a_name_that_no_file_can_bear_is_no_robot() -> None:
    with pytest.raises(InputError, match='expected one of quanser_2dsfl, reference or a YAML'):
        load_robot('x' * 10_000)


def test_a_log_is_no_robot_and_its_size_is_told(tmp_path: Path) -> None:
    (tmp_path / 'log.csv').write_text('0.1,0.2\n' * 25_000)
    with pytest.raises(InputError, match='log.csv: expected a robot file, of at most 64000 '
                                         'characters, got a file of 200000 bytes'):
        load_robot(tmp_path / 'log.csv')


def test_binary_file_is_no_robot(tmp_path: Path) -> None:
    (tmp_path / 'robot.yaml').write_bytes(b'\xff\xfe\x00')
    with pytest.raises(InputError, match='expected a readable text file'):
        load_robot(tmp_path / 'robot.yaml')


def test_built_in_robots_are_complete() -> None:
    assert built_in_robots() == ('quanser_2dsfl', 'reference')
    assert [load_robot(name).name for name in built_in_robots()] == list(built_in_robots())


def test_reference_robot_is_what_the_paper_gives() -> None:
    """(30) and the text: m_l2 = 0.133 kg, m_p = 0.1 kg, T = 0.01 s, two gauges a link."""
    robot = load_robot('reference')
    assert robot.links[1].mass == pytest.approx(0.133, rel=1e-3)
    assert (robot.payload_mass, robot.sample_time) == (0.1, 0.01)
    assert robot.gauge_names == ('strain_1a', 'strain_1b', 'strain_2a', 'strain_2b')


def test_velocity_loop_constants_of_the_design_notes() -> None:
    """k_1 = gain / tau, k_2 = 1 / J_b, k_3 = -1 / tau."""
    shoulder = load_robot('reference').drives[0]
    assert constants_33(shoulder) == pytest.approx((100.0, 5.0, -100.0))


def test_quanser_masses_add_up_to_the_vendor_s() -> None:
    """Stage 2 and its motor, 1.578 kg, on the upper link's end; stretched, 0.1704 kg m^2."""
    robot = load_robot('quanser_2dsfl')
    assert robot.gauge_names == ('strain_1', 'strain_2')
    lower = robot.links[1]
    # The nominal 0.157 kg is what the lower link's end carries.
    assert robot.elbow_mass + lower.mass + robot.payload_mass == pytest.approx(1.578, rel=1e-3)


@pytest.mark.parametrize('path, value', [
    ('elbow.mass_kg', -0.6), ('links.lower.length_m', DELETE), ('drives.elbow.kind', 'none')])
def test_tool_prints_the_line_and_exits_with_2(tmp_path: Path, path: str, value: Any) -> None:
    file = tmp_path / 'robot.yaml'
    file.write_text(changed(path, value))
    results = tmp_path / 'results.json'
    process = subprocess.run(
        [sys.executable, '-m', 'flex_plant_sim.tools.replay', 'log.csv', '--robot', str(file),
         '--json', str(results)], capture_output=True, text=True)
    assert process.returncode == 2
    assert process.stderr.startswith(f'error: {file}: {path}: ')
    assert process.stderr.count('\n') == 1
    assert process.stdout == ''
    assert list(tmp_path.iterdir()) == [file]
