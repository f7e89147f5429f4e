"""The table of keys against the parser: template, reference page and what may be left out."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

from flex_plant_sim.arm.file_section import PLAUSIBLE
from flex_plant_sim.arm.robot import Tolerances
from flex_plant_sim.arm.robot_file import DRIVE_KINDS, parse_robot
from flex_plant_sim.arm.robot_keys import Key, KEY_GROUPS, TOLERANCES
from flex_plant_sim.commissioning.template import reference_page, template
from msg_config.errors import InputError
import pytest
import yaml

EACH_KEY = [(place, key) for group in KEY_GROUPS for place in group.places
            for key in group.keys
            if not group.kind or group.kind == 'velocity_loop']


def data() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(template())
    return found


def without(place: str, key: Key) -> str:
    """Return the template without one key."""
    found = data()
    group = found
    for name in filter(None, place.split('.')):
        group = group[name]
    del group[key.name]
    return yaml.safe_dump(found)


def test_the_template_loads_as_it_is() -> None:
    assert parse_robot(template(), 'template').name == 'my_arm'
    assert all(len(line) < 100 for line in template().splitlines())


@pytest.mark.parametrize('place, key', EACH_KEY, ids=lambda item: getattr(item, 'name', item))
def test_a_key_without_a_default_must_be_there(place: str, key: Key) -> None:
    text = without(place, key)
    if key.default:
        parse_robot(text, 'robot.yaml')
        return
    with pytest.raises(InputError, match=f'{key.name}: expected a value, the key is missing'):
        parse_robot(text, 'robot.yaml')


@pytest.mark.parametrize('kind', sorted(DRIVE_KINDS))
def test_every_kind_of_drive_is_described_as_the_parser_reads_it(kind: str) -> None:
    group = next(group for group in KEY_GROUPS if group.kind == kind)
    found = data()
    for joint, name in enumerate(('shoulder', 'elbow')):
        found['drives'][name] = {'kind': kind, **{
            key.name: yaml.safe_load(key.examples[joint]) for key in group.keys}}
    parse_robot(yaml.safe_dump(found), 'robot.yaml')
    for key in group.keys:
        if not key.default:
            lacking = yaml.safe_load(yaml.safe_dump(found))
            del lacking['drives']['elbow'][key.name]
            with pytest.raises(InputError, match=f'elbow.{key.name}: expected a value'):
                parse_robot(yaml.safe_dump(lacking), 'robot.yaml')


def test_a_geared_motor_without_a_tacho_runs_at_its_back_emf() -> None:
    """Unloaded and without friction: theta' = u k_p / (N k_t)."""
    found = data()
    found['drives']['elbow'] = {
        'kind': 'dc_motor', 'resistance_ohm': 2.0, 'torque_constant_n_m_per_a': 0.03,
        'gear_ratio': 30, 'rotor_inertia_kg_m2': 2e-5, 'amplifier_gain': 12.0}
    drive = parse_robot(yaml.safe_dump(found), 'robot.yaml').drives[1]
    assert drive.torque_gain / drive.damping == pytest.approx(12.0 / (30 * 0.03))
    assert drive.inertia == pytest.approx(30**2 * 2e-5)
    assert drive.torque_gain == pytest.approx(30 * 0.03 / 2.0 * 12.0)
    assert not drive.closed_loop


@pytest.mark.parametrize('kind', sorted(DRIVE_KINDS))
def test_zero_is_accepted_where_the_page_says_so(kind: str) -> None:
    page = reference_page()
    groups = [group for group in KEY_GROUPS if group.kind in ('', kind)]
    for group in groups:
        table = page.partition(f'\n## {group.title}\n')[2].partition('\n## ')[0]
        for key in group.keys:
            told = table.partition(f'| `{key.name}` |')[2].partition('\n')[0].split(' | ')[3]
            if '…' not in told:
                continue
            found = data()
            found['drives']['elbow'] = {'kind': kind, **{
                other.name: yaml.safe_load(other.examples[1]) for other in next(
                    group for group in KEY_GROUPS if group.kind == kind).keys}}
            section = found
            for name in filter(None, group.places[-1].split('.')):
                section = section[name]
            section[key.name] = 0
            try:
                parse_robot(yaml.safe_dump(found), 'robot.yaml')
                assert told.startswith('0, or '), (group.title, key.name)
            except InputError as error:
                assert not told.startswith('0, or '), str(error)


def test_no_key_of_the_parser_is_undocumented() -> None:
    described = {key.name for group in KEY_GROUPS for key in group.keys}
    described |= {f'tolerances.{name}' for name in TOLERANCES}
    assert set(PLAUSIBLE) <= described
    assert set(TOLERANCES) == {field.name for field in fields(Tolerances)}


def test_the_reference_page_is_the_one_in_the_docs(repository: Path) -> None:
    page = (repository / 'docs/robot_file.md').read_text(encoding='utf-8')
    assert page == reference_page(), 'flex_robot reference > docs/robot_file.md'
