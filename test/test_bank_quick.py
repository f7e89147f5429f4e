"""A handful of cases of the bank, one of them with all that flex_diagnose writes."""

from __future__ import annotations

import json
from pathlib import Path
import re
from typing import Any

from bank import score
from bank.cases import BankCase, CHAIN
from bank.records import write_record
from bank.run import run_case
from bank.sizes import read_limits
from bank.terms import hidden_terms
from flex_payload_estimator.tools.diagnose import main
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.effects import catalogue
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.simulation.replay import replay
import pytest
from truth.records import HAVE_MUJOCO, NO_MUJOCO

FRICTION = BankCase('one', ('coulomb_friction',), 'reference', 1000, seconds=16.0)
# The full catalogue takes the bank's time; these are friction's likeliest rivals.
RIVALS = ('coulomb_friction', 'viscous_friction', 'actuator_gain', 'actuator_dead_zone',
          'motor_lag', 'link_stiffness', 'strain_gain')


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a record that hides friction, and all that the tool made of it."""
    folder = tmp_path_factory.mktemp('friction')
    truth = FRICTION.truth()
    write_record(FRICTION, truth, folder / 'record.csv')
    others = [f'--exclude={name}' for name in catalogue() if name not in RIVALS]
    code = main([str(folder / 'record.csv'), *others, '--jobs', '1',
                 '--payload', f'{truth.payload_told:.9g}',
                 '--json', str(folder / 'answer.json'), '--report', str(folder / 'report'),
                 '--extended', str(folder / 'robot.yaml')])
    assert code == 0
    return folder


def answer_of(folder: Path) -> dict[str, Any]:
    """Return the tool's answer."""
    found: dict[str, Any] = json.loads((folder / 'answer.json').read_text(encoding='utf-8'))
    return found


def test_friction_is_named_at_its_joint_with_its_size(folder: Path) -> None:
    term, = hidden_terms(FRICTION.truth())[:1]
    cause = answer_of(folder)['causes'][0]
    assert (cause['name'], cause['site']) == (term.name, term.site)
    size = cause['parameters']['level_n_m']
    assert size['value'] == pytest.approx(term.values['level_n_m'], rel=0.1)
    assert size['unit'] == 'N m'


def test_gain_is_measured_and_sure(folder: Path) -> None:
    term, = hidden_terms(FRICTION.truth())[:1]
    row = answer_of(folder)['gain'][term.site]
    k = row['horizon_s'].index(1.0)
    assert row['after'][k] < 0.25 * row['before'][k]
    assert row['ratio_high'][k] < 0.5


def test_extended_robot_replays_the_record_better(folder: Path) -> None:
    joint = int(hidden_terms(FRICTION.truth())[0].site[-1]) - 1
    payload = FRICTION.truth().payload_told
    errors = []
    for name in ('reference', str(folder / 'robot.yaml')):
        robot = load_robot(name)
        log = read_log(folder / 'record.csv', robot)
        errors.append(float(replay(log, robot, payload=payload).rmse[joint]))
    assert errors[1] < 0.25 * errors[0]


def test_report_holds_sentence_and_pictures(folder: Path) -> None:
    text = (folder / 'report' / 'report.html').read_text(encoding='utf-8')
    assert answer_of(folder)['sentence'].split('.')[0] in text
    shown = re.findall(r'<img src="data:image/svg\+xml;base64,[^"]+" alt="([^":]*)', text)
    channels = load_robot('reference').output_names
    assert {name: shown.count(name) for name in channels} == dict.fromkeys(channels, 4)
    # Latent torques come first, each over all that it may depend on.
    for joint in ('joint_1', 'joint_2'):
        over = {f'{joint} over {name}' for name in ('speed', 'angle', 'load', 'command', 'time')}
        assert over <= set(shown[:10])


def test_clean_arm_with_tolerances_and_distractors_is_left_alone() -> None:
    case = BankCase('clean', (), 'reference', 1001, seconds=16.0)
    line = run_case(case, read_limits()['reference'])
    assert line['code'] == 0
    assert score.named(line) == []


@pytest.mark.skipif(not HAVE_MUJOCO, reason=NO_MUJOCO)
def test_an_arm_that_its_own_controller_does_not_hold_makes_no_case() -> None:
    """A drive of 1.4 times its gain: the bank says so, and goes on."""
    case = BankCase('one', ('actuator_gain',), 'quanser_2dsfl', 5710, CHAIN)
    line = run_case(case, read_limits()['quanser_2dsfl'])
    assert line['unmade'].startswith('unstable at') and 'verdict' not in line
