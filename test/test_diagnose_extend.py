"""The extended robot file: it reads back as what was written, and keeps what the user wrote."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from flex_payload_estimator.tools import diagnose
from flex_plant_sim.arm.parts import within_file_limits
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import built_in_robots, load_robot, parse_robot, robot_text
from flex_plant_sim.arm.robot_text import DIGITS, document, with_numbers
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.report.extended_file import specs, write_extended
from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.effects import build, catalogue, effects_of, parse, sites
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from msg_config.errors import InputError
import numpy as np
import pytest
from simulated_records import REFERENCE, simulated, write
from test_diagnose_report import GAIN, report
import yaml


def extended_text(source: str | Path, robot: Robot, effects: Sequence[Effect]) -> str:
    return with_numbers(robot_text(source), replace(robot, effects=specs(effects)))


def comments(text: str) -> list[str]:
    return [line[line.index('#'):] for line in text.splitlines() if '#' in line]


def some_of_each(robot: Robot) -> list[Effect]:
    """Return every effect of the catalogue once, at a value of as many digits as are written."""
    found = []
    for effect in catalogue().values():
        if not sites(effect, robot):  # a velocity loop's effect on an arm that has none
            continue
        values = tuple(
            p.starts[0] if p.discrete
            else float(f'{min(max(p.low, p.starts[0] / 3.0), p.high):.{DIGITS}g}')
            for p in effect.parameters)
        found.append(effect(sites(effect, robot)[-1], values))
    return found


@pytest.mark.parametrize('name', built_in_robots())
def test_every_effect_reads_back_exactly(name: str, tmp_path: Path) -> None:
    robot = load_robot(name)
    effects = some_of_each(robot)
    write_extended(tmp_path / 'robot.yaml', name, robot, effects)
    again = load_robot(tmp_path / 'robot.yaml')
    assert effects_of(again) == tuple(effects)
    assert replace(again, effects=()) == robot
    assert [path.name for path in tmp_path.iterdir()] == ['robot.yaml']


def test_a_link_damps_no_more_than_its_file_may_say(tmp_path: Path) -> None:
    robot = load_robot('reference')
    upper, lower = (replace(link, damping_ratio=1.8) for link in robot.links)
    far = replace(robot, links=(upper, lower))
    path = tmp_path / 'robot.yaml'
    with pytest.raises(InputError, match=r'not written: links\.upper\.damping_ratio'):
        write_extended(path, 'reference', far, [])
    assert not path.exists()
    write_extended(path, 'reference', within_file_limits(far), [])
    assert [link.damping_ratio for link in load_robot(path).links] == [0.7, 0.7]
    assert within_file_limits(robot) == robot


def test_a_channel_that_is_mapped_by_its_name_alone_is_kept() -> None:
    text = robot_text('reference') + (
        'inputs:\n  joints: {joint_1: {name: pan, unit: deg}, joint_2: forearm}\n'
        '  gauges:\n    strain_1a: gauge 1\n  commands: {joint_1: u_1}\n')
    robot = parse_robot(text, 'mapped.yaml')
    assert with_numbers(text, robot) == text
    heavier = replace(robot, elbow_mass=0.9)
    written = with_numbers(text, heavier)
    assert '    strain_1a: gauge 1\n' in written and parse_robot(written, 'written') == heavier


def test_comments_stay_and_effects_are_not_doubled(tmp_path: Path) -> None:
    robot = load_robot('reference')
    first = build(parse('coulomb_friction:joint_2:level_n_m=1e-05'), robot)
    second = build(parse('strain_drift:strain_1a:drift_per_s=-3e-07'), robot)
    path = tmp_path / 'once.yaml'
    write_extended(path, 'reference', robot, [first])
    text = extended_text(path, robot, [first, second])
    assert text.startswith('# The reference robot')
    assert text.count('effects:') == 1
    assert effects_of(parse_robot(text, 'twice')) == (first, second)


def test_a_sensor_has_one_scale_and_one_zero(tmp_path: Path) -> None:
    robot = load_robot('reference')
    # As the user's file, the parts and a cause may bring them.
    several = [build(parse(text), robot) for text in (
        'strain_gain:strain_1a:factor=0.9', 'strain_bias:strain_1a:bias=2e-6',
        'coulomb_friction:joint_2:level_n_m=0.2', 'strain_gain:strain_1a:factor=1.1',
        'strain_bias:strain_1a:bias=-1e-6', 'angle_offset:joint_2:offset_rad=0.02',
        'strain_gain:strain_2b:factor=1.05', 'angle_offset:joint_2:offset_rad=-0.005')]
    write_extended(tmp_path / 'robot.yaml', 'reference', robot, several)
    again = effects_of(load_robot(tmp_path / 'robot.yaml'))
    assert [(effect.identifier, effect.site) for effect in again] == [
        ('strain_gain', 'strain_1a'), ('strain_bias', 'strain_1a'),
        ('coulomb_friction', 'joint_2'), ('angle_offset', 'joint_2'),
        ('strain_gain', 'strain_2b')]
    true = np.linspace(-1e-4, 2e-4, 24).reshape(4, 6)
    before, after = (ExtendedArm(robot, effects=each).sense(true, 0.0)
                     for each in (tuple(several), again))
    np.testing.assert_allclose(after, before, rtol=1e-5)


@pytest.mark.parametrize('between', [
    'strain_drift:strain_1a:drift_per_s=1e-06',
    'strain_gain:strain_1a:factor=1,creep_per_s=0.001'])
def test_scales_with_a_change_over_time_between_them_stay(between: str, tmp_path: Path) -> None:
    robot = load_robot('reference')
    effects = tuple(build(parse(text), robot) for text in (
        'strain_gain:strain_1a:factor=0.9', between, 'strain_gain:strain_1a:factor=1.1'))
    write_extended(tmp_path / 'robot.yaml', 'reference', robot, effects)
    assert effects_of(load_robot(tmp_path / 'robot.yaml')) == effects


@pytest.mark.parametrize('existing', [
    'effects: [{name: coulomb_friction, site: joint_1, level_n_m: 0.2}]\n',
    'effects:\n- name: coulomb_friction\n  site: joint_1\n\n  level_n_m: 0.2\n',
    'effects:\n  - {name: coulomb_friction,\n     site: joint_1, level_n_m: 0.2}\n'])
def test_existing_effects_in_any_form_are_replaced(existing: str, tmp_path: Path) -> None:
    text = extended_text('reference', load_robot('reference'), [])
    head, tail = text.replace('effects: []\n', '').split('payload:')
    path = tmp_path / 'robot.yaml'
    path.write_text(f'{head}{existing}payload:{tail}', encoding='utf-8')
    robot = load_robot(path)
    assert len(robot.effects) == 1
    added = build(parse('input_delay:arm:delay_s=0.013'), robot)
    again = parse_robot(extended_text(path, robot, [*effects_of(robot), added]), 'again')
    assert [spec.name for spec in again.effects] == ['coulomb_friction', 'input_delay']
    assert replace(again, effects=()) == replace(robot, effects=())


@pytest.mark.parametrize('name', built_in_robots())
def test_changed_parameters_are_written_in_their_places(name: str) -> None:
    robot = load_robot(name)
    link, drive = robot.links[1], robot.drives[0]
    changed = robot.with_link(1, youngs_modulus=1.03 * link.youngs_modulus)
    changed = changed.with_drive(0, inertia=1.07 * drive.inertia)
    effect = build(parse('coulomb_friction:joint_2:level_n_m=0.43'), robot)
    text = extended_text(name, changed, [effect])
    assert comments(text) == comments(robot_text(name)) != []
    again = parse_robot(text, 'again')
    assert again.links == changed.links
    assert again.tolerances == robot.tolerances
    for found, wanted in ((again.drives[0].inertia, 1.07 * drive.inertia),
                          (again.drives[0].damping, drive.damping),
                          (again.drives[0].torque_gain, drive.torque_gain)):
        assert found == pytest.approx(wanted, rel=10.0**(1 - DIGITS))
    assert effects_of(again) == (effect,)


@pytest.mark.parametrize('name', built_in_robots())
def test_a_written_document_is_the_robot(name: str) -> None:
    robot = load_robot(name)
    assert parse_robot(yaml.safe_dump(document(robot)), name) == robot


def test_nothing_is_left_where_nothing_can_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='expected an existing folder'):
        write_extended(tmp_path / 'missing' / 'robot.yaml', 'reference',
                       load_robot('reference'), [])
    with pytest.raises(InputError, match='expected one of'):
        write_extended(tmp_path / 'robot.yaml', tmp_path / 'none.yaml',
                       load_robot('reference'), [])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(('worse', 'verdict', 'said'), [
    (True, 'cause', 'extended robot: not written, as it predicts the locked part worse than'),
    (True, 'nothing_wrong', 'extended robot: not written, as reference predicts the locked part '
                            'better as it is\n'),
    (False, 'cause', 'extended robot: {file}\n'),
    (False, 'nothing_wrong', 'extended robot: {file}, with the parts as estimated and no cause')])
def test_no_robot_is_written_that_predicts_worse(
        worse: bool, verdict: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    log, file = write(simulated(duration=2.0), tmp_path / 'log.csv'), tmp_path / 'better.yaml'
    gain = replace(GAIN, after=0.13, ratio_low=1.5, ratio_high=2.5) if worse else GAIN
    diagnosis = report().diagnosis if verdict == 'cause' else Diagnosis('nothing_wrong', 'Well.')
    found = diagnose.Findings(diagnosis, BaseModel(REFERENCE), ([], []), (gain,), (), (), {}, ())
    monkeypatch.setattr(diagnose, 'run', lambda *_: found)
    assert diagnose.main([str(log), '--extended', str(file), '--jobs', '1']) == 0
    assert said.format(file=file) in capsys.readouterr().out
    assert file.exists() is not worse
