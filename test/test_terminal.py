"""What a terminal shows of a diagnosis."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.parts import in_velocity_loop, robot_parts
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import robot_text
from flex_plant_sim.arm.robot_text import with_numbers
from flex_plant_sim.diagnosis.report.terminal import answer_text, CEILING
from flex_plant_sim.diagnosis.verdict.results import DetectionLimit, Diagnosis, PartEstimate
from flex_plant_sim.diagnosis.verdict.wording import part_text
import pytest
from simulated_records import REFERENCE
from test_diagnose_report import GAIN, PAYLOAD, report
import yaml

TEXT = robot_text('reference')
FAR = PartEstimate('drive_damping_1', '', 0.2, 0.405, 0.017, 'time_constant_s times 0.667')
NEAR = PartEstimate('stiffness_1', '', 0.03, 0.05, 0.01)
PARTS = '  parts beyond their tolerance: '
INTERVALS = '± and ranges are 95 % intervals'


def test_terminal_text_is_short_and_complete() -> None:
    text = answer_text(report().diagnosis, [GAIN], [PAYLOAD])
    assert len(text.splitlines()) < 12
    for expected in ('coulomb friction, joint 2', '97 %', 'cannot tell it from stribeck',
                     '3.73 -> 0.0378', '+35.0 %'):
        assert expected in text


def test_what_cannot_be_told_from_a_cause_stands_beside_it_with_its_size() -> None:
    diagnosis = report().diagnosis
    cause, (own, *_) = diagnosis.causes[0], diagnosis.rounds[0]
    rivals = (own, replace(own, name='stribeck_friction', probability=0.26),
              replace(own, name='backlash', probability=0.12))
    lines = answer_text(replace(diagnosis, causes=(replace(
        cause, look_alikes=('stribeck_friction',)),), rounds=(rivals,)), [], []).splitlines()
    named, rival = (next(line for line in lines if start in line)
                    for start in ('  coulomb friction, j', '    or stribeck friction, j'))
    assert '26 %' in rival and rival.index('%') == named.index('%')
    assert rival.split('%')[1] == named.split('%')[1]
    assert not any('backlash' in line for line in lines)


def test_a_channel_that_is_predicted_worse_at_all_horizons_is_told() -> None:
    worse = [replace(GAIN, horizon=h, after=2.0 * GAIN.before, ratio_low=1.6, ratio_high=2.4)
             for h in (0.2, 1.0)]
    told = 'joint_2: the robot file as it is predicts better'
    assert told in answer_text(report().diagnosis, worse, [])
    assert told not in answer_text(report().diagnosis, [worse[0], GAIN], [])


def test_parts_beyond_their_tolerance_stand_beside_a_cause_too() -> None:
    text = answer_text(replace(report().diagnosis, parts=(FAR, NEAR)), [GAIN], [])
    assert f'{PARTS}{part_text(FAR)}\n' in text and 'stiffness' not in text
    said = replace(report().diagnosis, parts=(FAR,), sentence=f'Far: {part_text(FAR)}.')
    assert PARTS not in answer_text(said, [GAIN], []) and INTERVALS in answer_text(said, [], [])


def test_intervals_and_the_ceiling_of_names_are_said_where_they_are_shown() -> None:
    diagnosis = report().diagnosis
    assert answer_text(diagnosis, [GAIN], []).count(INTERVALS) == 1
    assert 'no name is stated above' not in answer_text(diagnosis, [GAIN], [])
    at_ceiling = replace(diagnosis, causes=(replace(diagnosis.causes[0], probability=CEILING),))
    assert 'no name is stated above 88 %' in answer_text(at_ceiling, [GAIN], [])
    assert INTERVALS not in answer_text(Diagnosis('nothing_wrong', 'Nothing.'), [GAIN], [])


def test_nothing_wrong_says_what_would_have_shown_and_what_parts_alone_gain() -> None:
    limits = {'payload_mass:arm': DetectionLimit(0.0106, 'kg', 0.0106),
              'coulomb_friction:joint_2': DetectionLimit(0.0712, 'N m', 0.0712),
              'backlash:joint_1': DetectionLimit(6e-4, 'rad', 5e-4)}
    nothing = Diagnosis('nothing_wrong', 'Nothing.', detection_limits=limits)
    text = answer_text(nothing, [GAIN], [])
    assert ('detection limits: payload mass 0.0106 kg; coulomb friction, joint 2 0.0712 N·m;'
            ) in text and 'backlash' not in text
    assert '-> is with the parts as estimated: no cause is added' in text
    alike = answer_text(nothing, [replace(GAIN, after=GAIN.before)], [])
    assert 'parts as estimated' not in alike
    cause = answer_text(replace(report().diagnosis, detection_limits=limits), [GAIN], [])
    assert 'detection limits' not in cause and 'parts as estimated' not in cause


def test_nothing_wrong_says_how_probable_it_is_and_what_may_be() -> None:
    sets = ((), 0.602), (('motor_lag:joint_1',), 0.218), (('unknown',), 0.03)
    nothing = Diagnosis('nothing_wrong', 'Nothing.', sets=sets)
    lines = [line.split() for line in answer_text(nothing, [GAIN], []).splitlines()]
    assert ['nothing', 'wrong', '60', '%'] in lines
    assert ['or', 'motor', 'lag,', 'joint', '1', '22', '%'] in lines
    assert not any('unknown' in line for line in lines)


@pytest.mark.parametrize('name', ['drive_damping_1', 'drive_inertia_2'])
def test_a_part_of_a_velocity_loop_is_said_as_its_file_is_changed(name: str) -> None:
    part, = (part for part in robot_parts(REFERENCE) if part.name == name)
    place = ('shoulder', 'elbow')[int(name[-1]) - 1]

    def drive(robot: Robot) -> dict[str, float]:
        found: dict[str, float] = yaml.safe_load(with_numbers(TEXT, robot))['drives'][place]
        return found

    told, changed = drive(REFERENCE), drive(part.change(REFERENCE, 0.2))
    times = {key: changed[key] / told[key] for key in told if key != 'kind'
             and changed[key] != pytest.approx(told[key])}
    text = in_velocity_loop(REFERENCE, name, 0.2)
    assert text == f'{" and ".join(times)} times {times["time_constant_s"]:.3g}'
    assert 'of the velocity loop: time_constant_s times 0.667)' in part_text(FAR)
    current = REFERENCE.with_drive(int(name[-1]) - 1, closed_loop=False)
    assert in_velocity_loop(current, name, 0.2) == in_velocity_loop(REFERENCE, 'stiffness_1', 1) \
        == ''
