"""What a record says against `nothing_wrong`, and a locked part against the named causes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import json
from pathlib import Path
import re

from flex_payload_estimator.tools.diagnose import main
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.prior import unknown_odds
from flex_plant_sim.diagnosis.prediction.latent_view import Finding, LatentView
from flex_plant_sim.diagnosis.prediction.law import (
    cross_validate,
    LatentSeries,
    law_of,
    STRETCHES,
)
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.noisy_sensors import with_noise
from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.diagnosis.verdict.unknown import (
    LOOK_AT_RESIDUALS,
    REFUTED,
    refuted,
    sentences_of,
    with_stated_law,
    with_unknown,
)
from flex_plant_sim.effects import catalogue
from flex_plant_sim.logs.read import read_log
import numpy as np
import pytest
from test_diagnose_report import report
from truth.records import make_record, TruthCase

ROBOT = load_robot('reference')
ASKED = ('strain_gain', 'strain_bias', 'link_stiffness')


def test_a_gauge_that_is_not_linear_is_not_nothing(tmp_path: Path) -> None:
    """Its error is a law over its own strain, which no effect of the catalogue has."""
    made, answer = make_record(TruthCase(97, duration_s=18.0)), tmp_path / 'answer.json'
    made.strain[:, 0] += 300.0 * made.strain[:, 0]**2
    made.write_csv(tmp_path / 'log.csv')
    others = [f'--exclude={name}' for name in catalogue() if name not in ASKED]
    assert main([str(tmp_path / 'log.csv'), '--jobs', '1', '--modes', '2',
                 '--json', str(answer), *others]) == 0
    found = json.loads(answer.read_text())
    assert found['verdict'] == 'not_in_catalogue'
    assert 'strain 1a' in found['sentence'] and found['probabilities']['unknown'] > 0.9
    assert sum(p['probability'] for p in found['sets']) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(('share', 'verdict'), [(0.05, 'nothing_wrong'),
                                                (0.25, 'not_in_catalogue')])
def test_a_gauge_that_hears_a_drive_is_not_nothing(share: float, verdict: str, tmp_path: Path
                                                   ) -> None:
    """Its error is slow: of all samples' power, most of which is noise, it is little."""
    made, answer = make_record(TruthCase(98, duration_s=20.0)), tmp_path / 'answer.json'
    heard = made.command[:, 0] - made.command[:, 0].mean()
    made.strain[:, 0] += share * heard * made.strain[:, 0].std() / heard.std()
    made.write_csv(tmp_path / 'log.csv')
    others = [f'--exclude={name}' for name in catalogue() if name not in ASKED]
    assert main([str(tmp_path / 'log.csv'), '--jobs', '1', '--modes', '2',
                 '--json', str(answer), *others]) == 0
    found = json.loads(answer.read_text())
    assert found['verdict'] == verdict
    assert (found['probabilities']['unknown'] > 0.8) == (verdict == 'not_in_catalogue')
    assert ('strain 1a' in found['sentence'] and 'the command of joint 1' in found['sentence']) \
        == (verdict == 'not_in_catalogue')


@pytest.mark.parametrize(('shape', 'variable', 'of_no_effect'), [
    (lambda x: x, 'angle', False), (lambda x: np.sign(x) + 0.3 * x, 'speed', False),
    (np.square, 'load', True), (lambda x: x**3, 'speed', True),
    (lambda x: x + 0.01 * x**2, 'load', False),
    (lambda x: np.sin(7.3 * x + 0.5), 'angle', False),
    (lambda x: np.sin(7.3 * x + 0.5), 'load', True),
    (lambda x: 9.0 * np.maximum(x - 0.6, 0.0), 'angle', True)])
def test_lines_steps_and_ripples_are_laws_that_effects_have(
        shape: Callable[[Array], Array], variable: str, of_no_effect: bool) -> None:
    rng, count = np.random.default_rng(5), 100 * STRETCHES
    x = rng.uniform(-1.0, 1.0, count)
    series = LatentSeries('joint_1', 'N m', shape(x) + 0.01 * rng.normal(size=count),
                          np.full(count, 0.01), {variable: ('', x)},
                          np.ones(count, dtype=bool), 0.1)
    found = Finding(series, tuple(cross_validate(series)), law_of(series), None)
    assert found.law.stated and found.has_shape_of_no_effect is of_no_effect


def test_a_law_of_no_effect_has_the_odds_of_what_nothing_imitates() -> None:
    """A law that explains s of the power is as many times likelier as n samples say."""
    rng, count = np.random.default_rng(5), 100 * STRETCHES
    x = rng.uniform(-1.0, 1.0, count)
    series = LatentSeries('joint_1', 'N m', x**2 + 0.3 * rng.normal(size=count),
                          np.full(count, 0.01), {'load': ('', x)}, np.ones(count, dtype=bool), 0.1)
    law = law_of(series)
    view = LatentView((Finding(series, tuple(cross_validate(series)), law, None),), ())
    before = Diagnosis('nothing_wrong', 'Nothing.', effects={'nothing': 0.9, 'unknown': 0.1},
                       sets=(((), 0.9), (('unknown',), 0.1)))
    after = with_stated_law(before, view)
    odds = 0.9 * unknown_odds() * (1.0 - law.share)**(-STRETCHES / 2)
    assert 0.3 < law.share < 0.7 and after.verdict == 'not_in_catalogue'
    assert after.effects['nothing'] == pytest.approx(0.9 / (1.0 + odds))
    assert sum(after.effects.values()) == pytest.approx(1.0)
    assert with_stated_law(before, LatentView((), ())) is before


def test_a_force_that_may_follow_a_variable_is_never_passed_over() -> None:
    """Of a stop that a joint met now and then, 67 +- 9 % went with its angle: nothing was said."""
    rng, count = np.random.default_rng(6), 100 * STRETCHES
    angle, alike = rng.uniform(-1.0, 1.0, (2, count))
    alike = angle + 0.02 * alike
    value = np.maximum(angle, 0.0) + 0.3 * rng.normal(size=count)
    series = LatentSeries('joint_1', 'N m', value, np.full(count, 0.01), {
        'angle': ('rad', angle), 'command': ('V', alike)}, np.ones(count, dtype=bool), 0.1)
    found = Finding(series, tuple(cross_validate(series)), law_of(series), None)
    assert found.exceeds_model_error and not (found.law.stated or found.has_memory)
    view = LatentView((found,), ())
    said, = sentences_of(view)
    assert 'seems to follow its ' in said and 'its angle (' in said and 'its command (' in said
    unnamed = Diagnosis('not_in_catalogue', 'Wrong.', advice=LOOK_AT_RESIDUALS)
    assert with_unknown(unnamed, view).advice.startswith('Record joint 1 longer, and its')


@pytest.mark.parametrize('other, said', [
    ('strain_2b', 'Look at link 2 before its gauges'), ('strain_1', 'Look at strain 2a, its cab')])
def test_gauges_of_one_link_that_err_alike_point_at_the_link(other: str, said: str) -> None:
    """A link stiffer one way than the other had its first gauge's cable looked at."""
    rng, found = np.random.default_rng(8), []
    for site in ('strain_2a', other):
        strain = 1e-4 * rng.uniform(-1.0, 1.0, 100 * STRETCHES)
        series = LatentSeries(site, 'm/m', np.abs(strain), np.full(strain.size, 1e-6), {
            'strain': ('m/m', strain)}, np.ones(strain.size, dtype=bool), 1e-6)
        found.append(Finding(series, tuple(cross_validate(series)), law_of(series), None))
    unnamed = Diagnosis('not_in_catalogue', 'Wrong.', advice=LOOK_AT_RESIDUALS)
    assert with_unknown(unnamed, LatentView((), tuple(found))).advice.startswith(said)


@pytest.mark.parametrize(('factor', 'said'), [(1.0, False), (2.0, False), (5.0, True)])
def test_a_gauge_noisier_than_told_is_said(factor: float, said: bool, tmp_path: Path) -> None:
    made = make_record(TruthCase(98, duration_s=22.0))
    made.strain[:, 2] += ROBOT.strain_noise * np.sqrt(factor**2 - 1.0) \
        * np.random.default_rng(3).standard_normal(len(made.time))
    made.write_csv(tmp_path / 'log.csv')
    record = Record.of(read_log(str(tmp_path / 'log.csv'), ROBOT), 0.1)
    found = with_noise(Diagnosis('nothing_wrong', 'Nothing.'), [record], ROBOT)
    assert (re.search(r'strain 2a (4\.[89]|5)', found.sentence) is not None) == said
    assert 'strain 2b' not in found.sentence and 'joint' not in found.sentence


@pytest.mark.parametrize('shared', [False, True])
def test_what_gauges_see_alike_is_no_noise_of_theirs(shared: bool, tmp_path: Path) -> None:
    """An arm whose links chatter on the teeth of a gap was told that its gauges are noisy."""
    made = make_record(TruthCase(98, duration_s=22.0))
    jumps = np.random.default_rng(4).standard_normal((len(made.time), 4))
    made.strain[:] += 4.0 * ROBOT.strain_noise * (jumps[:, [0]] * [1.0, 0.9, -1.2, -1.0]
                                                  if shared else jumps)
    made.write_csv(tmp_path / 'log.csv')
    record = Record.of(read_log(str(tmp_path / 'log.csv'), ROBOT), 0.1)
    found = with_noise(Diagnosis('cause', 'A gap.'), [record], ROBOT).sentence
    assert ('the arm shakes, as on a gap' in found) == shared
    assert ('Sensors are noisier than' in found) != shared
    assert all(name in found for name in ('strain 1a', 'strain 1b', 'strain 2a', 'strain 2b'))


@pytest.mark.parametrize('sets', [
    ((('coulomb_friction:joint_2',), 0.6), (('coulomb_friction:joint_2', 'unknown'), 0.2),
     ((), 0.05)),
    ((('coulomb_friction:joint_2',), 0.5), (('unknown',), 0.3))])
def test_what_a_refuted_cause_loses_goes_to_something_unnamed(
        sets: tuple[tuple[tuple[str, ...], float], ...]) -> None:
    """Whether something unnamed alone was listed or not; listed sets may sum to less than 1."""
    before = replace(report().diagnosis, sets=sets, effects={
        'coulomb_friction': 0.8, 'unknown': 0.15, 'nothing': 0.05})
    after = refuted(before).sets
    shares = [p for _, p in after]
    assert sum(shares) == pytest.approx(sum(p for _, p in sets))
    assert shares == sorted(shares, reverse=True)
    assert dict(after)['unknown',] > 0.3


def test_a_locked_part_predicted_worse_turns_the_odds_of_the_causes() -> None:
    diagnosis = report().diagnosis
    before = Diagnosis(**{**vars(diagnosis), 'effects': {
        'coulomb_friction': 0.8, 'unknown': 0.15, 'nothing': 0.05},
        'sets': ((('coulomb_friction:joint_2',), 0.8), (('unknown',), 0.15), ((), 0.05))})
    after = refuted(before)
    named = after.effects['coulomb_friction']
    assert named / (1.0 - named) == pytest.approx(REFUTED * 0.8 / 0.2)
    assert sum(after.effects.values()) == pytest.approx(1.0)
    assert after.causes[0].probability == pytest.approx(before.causes[0].probability * named / 0.8)
    assert after.verdict == 'cause_and_remainder'
    assert sum(p for _, p in after.sets) == pytest.approx(1.0)
    assert dict(after.sets)['unknown',] == pytest.approx(after.effects['unknown'])
    assert after.sets[0][0] == ('unknown',)
    unnamed = Diagnosis('not_in_catalogue', 'Something.')
    assert refuted(unnamed) is unnamed
