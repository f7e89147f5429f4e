"""The report and the texts: whole, self-contained, for every verdict."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
import json
from pathlib import Path
import re
from typing import get_args

from flex_plant_sim.diagnosis.report.figures import draw_traces, picture
from flex_plant_sim.diagnosis.report.html_report import render, Report, write_report
from flex_plant_sim.diagnosis.report.json_answer import answer, plain
from flex_plant_sim.diagnosis.report.payload_gain import PayloadGain
from flex_plant_sim.diagnosis.verdict.improvement import Gain
from flex_plant_sim.diagnosis.verdict.locked_part import (
    with_gain,
    with_gauges_beyond,
    WORSE_WHERE_NAMED,
)
from flex_plant_sim.diagnosis.verdict.results import (
    Alternative,
    Cause,
    DetectionLimit,
    Diagnosis,
    Hint,
    ParameterValue,
    Verdict,
)
from flex_plant_sim.diagnosis.verdict.symptoms import ChannelResidual, Whiteness
from flex_plant_sim.diagnosis.verdict.wording import (
    apart_text,
    digits_text,
    interval_text,
    key_text,
    parameter_text,
    percent_text,
    rounded,
    unit_text,
)
from flex_plant_sim.effects.structure.modal_truncation import ModalTruncation
from matplotlib.figure import Figure
from msg_config.errors import InputError
import numpy as np
import pytest
from simulated_records import effects

LEVEL = ParameterValue('level_n_m', 0.4312, 0.412, 0.451, 'N m')
FRICTION = effects('coulomb_friction:joint_2:level_n_m=0.4312')[0]
CAUSE = Cause('coulomb_friction', 'joint_2', 'Joint 2 has dry friction.', 0.97, (LEVEL,),
              ('stribeck_friction',), FRICTION)
CANDIDATES = (Alternative('coulomb_friction', 'joint_2', (LEVEL,), 2140.0, 0.97),
              Alternative('strain_gain', 'strain_1a', (LEVEL,), -3.0, 0.0))
WHITE = Whiteness(25.0, 20, 0.2, 0.01)
CHANNEL = ChannelResidual('joint_2', 'rad', 1e-4, 0.3, {0.01: 2e-4, 1.0: 0.0651}, WHITE,
                          {'angle': 0.02}, {'velocity sign': 0.98, 'angle': 0.0},
                          ((0.0, 1.0, 0.9, 0.1), (1.0, 50.5, 0.1, 0.9)))
GAIN = Gain('joint_2', 'rad', 1.0, 0.0651, 0.00066, 0.0005, 0.0008, 0.007, 0.013, 200)
PAYLOAD = PayloadGain('record.csv', 'rpe', 0.1, 0.135, 0.002, 0.101, 0.001)


def report(verdict: Verdict = 'cause', causes: tuple[Cause, ...] = (CAUSE,)) -> Report:
    """Return a small report."""
    diagnosis = Diagnosis(
        verdict, 'Joint 2 has dry friction & no <script>.', causes,
        (('coulomb_friction', 'stribeck_friction'),),
        {'input_delay:arm': DetectionLimit(0.002, 's', 0.002)},
        ('backlash:joint_1',), (CANDIDATES,), 'Record more.', {'joint_2': 0.4},
        effects={'coulomb_friction': 0.97, 'unknown': 0.02, 'nothing': 0.01})
    pictures = {'gains': [picture(lambda figure: figure.subplots().plot([1, 2]), 'x', 'two')]}
    return Report(diagnosis, (CHANNEL,), (CHANNEL,), (GAIN,), (PAYLOAD,),
                  {'robot': 'reference'}, pictures)


class TagCheck(HTMLParser):
    """Checks that tags match and collects what a page would load."""

    empty = {'meta', 'img', 'br'}

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loaded: list[str] = []
        self.pictures: list[dict[str, str | None]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note a tag."""
        if tag not in self.empty:
            self.open.append(tag)
        self.loaded += [value or '' for name, value in attrs if name in ('src', 'href')]
        self.pictures += [dict(attrs)] if tag == 'img' else []

    def handle_endtag(self, tag: str) -> None:
        """Close a tag."""
        assert self.open.pop() == tag


@pytest.mark.parametrize('verdict', get_args(Verdict))
def test_every_verdict_renders_whole_and_self_contained(verdict: Verdict) -> None:
    causes = (CAUSE,) if verdict in ('cause', 'cause_and_remainder', 'cannot_tell') else ()
    page = TagCheck()
    page.feed(render(report(verdict, causes)))
    assert page.open == []
    assert page.pictures and all(p['alt'] for p in page.pictures)
    assert all(address.startswith('data:image/') for address in page.loaded)


def test_page_says_what_was_found_and_escapes_it() -> None:
    text = render(report())
    assert 'no &lt;script&gt;' in text and '<script' not in text
    for expected in ('0.431 ± 0.020 N·m', '97 %', 'stribeck friction', '3.73', '0.0378',
                     '+35.0 %', '+1.0 %', 'input delay', 'width=device-width', '@media print'):
        assert expected in text, expected
    assert not re.search(r'url\((?!data:)|@import|https?://', text)


def test_bare_report_without_causes_or_payload_renders() -> None:
    bare = Report(Diagnosis('nothing_wrong', 'Nothing is wrong.'), (CHANNEL,), (CHANNEL,), ())
    text = render(bare)
    assert 'Payload estimate' not in text and 'Causes' not in text


@pytest.mark.parametrize('factors', [(1e6, 1.1), (1.1, 1e6), (1e300, 1.1), (1e6, 1e6)])
def test_a_model_that_diverges_does_not_hide_the_traces(factors: tuple[float, float]) -> None:
    time = np.linspace(0.0, 8.0, 400)
    measured = 3.0 + 1e-3 * np.sin(time)
    before, after = (measured + 1e-4 * factor * np.expm1(time / 8.0) for factor in factors)
    figure = Figure()
    draw_traces(figure, time, [measured, before, after], 'rad')
    upper, lower = (axis.get_ylim() for axis in figure.axes)
    assert upper[0] < measured.min() and upper[1] > measured.max()
    assert upper[1] - upper[0] < 3e-3 and lower[1] - lower[0] < 3e-3


def test_hints_on_the_log_stand_before_anything_is_explained() -> None:
    found, hint = report(), Hint('a.csv', 'joint_1: in degrees & whose?')
    page = render(replace(found, diagnosis=replace(found.diagnosis, hints=(hint,))))
    assert 'Said of the log' not in render(found)
    assert page.index('a.csv</span>: joint_1: in degrees &amp; whose?') < page.index('Causes')
    said = answer(replace(found.diagnosis, hints=(hint,)), (), (), (), (), {})['hints']
    assert said == [{'file': 'a.csv', 'text': hint.text}]


def test_written_whole_into_a_new_folder(tmp_path: Path) -> None:
    path = write_report(tmp_path / 'new', report())
    assert path.read_text(encoding='utf-8').rstrip().endswith('</html>')
    assert [item.name for item in (tmp_path / 'new').iterdir()] == ['report.html']
    with pytest.raises(InputError, match='expected a folder'):
        write_report(path, report())


@pytest.mark.parametrize('value, uncertainty, text', [
    (0.4312, 0.0195, '0.431'), (1234.5, 87.0, '1234'), (2.05e-5, 3e-7, '2.050e-05'),
    (0.5, 0.0, '0.5'), (3.0, float('inf'), '3'), (12.0, 0.4, '12.00')])
def test_numbers_are_rounded_to_their_uncertainty(value: float, uncertainty: float,
                                                  text: str) -> None:
    assert float(rounded(value, uncertainty)) == pytest.approx(float(text))


def test_intervals_in_words() -> None:
    assert interval_text(LEVEL) == '0.431 ± 0.020 N·m'
    lopsided = replace(LEVEL, low=0.40, high=0.60)
    assert interval_text(lopsided) == '0.43 (0.40 to 0.60) N·m'
    assert interval_text(replace(LEVEL, low=0.4312, high=0.4312)) == '0.4312 N·m'
    modes = ParameterValue('modes', 4.0, 4.0, 4.0, ModalTruncation.parameters[0].unit)
    assert parameter_text(modes) == 'modes 4 a link'
    assert unit_text('N m s/rad') == 'N·m·s/rad'
    assert unit_text('kg m^2') == 'kg·m²'
    assert unit_text('command unit') == 'command unit'
    assert (percent_text(0.999), percent_text(0.001), percent_text(0.62)) == (
        '> 99 %', '< 1 %', '62 %')


def test_json_has_the_keys_that_programs_read() -> None:
    r = report()
    found = answer(r.diagnosis, r.gains, r.before, r.after, r.payload, {'seed': 0})
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    cause = found['causes'][0]
    assert cause['parameters']['level_n_m'] == {
        'value': 0.4312, 'low': 0.412, 'high': 0.451, 'unit': 'N m'}
    assert {'name', 'site', 'probability', 'look_alikes'} <= set(cause)
    assert {'verdict', 'cannot_tell', 'detection_limits', 'gain', 'payload'} <= set(found)
    assert found['detection_limits']['input_delay:arm'] == {
        'value': 0.002, 'unit': 's', 'easiest': 0.002}
    assert found['gain']['joint_2']['horizon_s'] == [1.0]
    assert found['payload']['before_percent'] == pytest.approx(35.0)
    assert found['payload']['after_kg'] == 0.101
    without = answer(r.diagnosis, r.gains, r.before, r.after, (), {})
    assert without['payload'] is None


def test_json_holds_nothing_that_json_does_not_know() -> None:
    assert plain({'a': np.float64(np.nan), 'b': (np.arange(2), np.bool_(True))}) == {
        'a': None, 'b': [[0, 1], True]}


def test_sentence_ends_with_the_surest_gain() -> None:
    r = report()
    assert with_gain(r.diagnosis, [GAIN]).sentence.endswith(
        'With it and the parts as estimated the prediction error of joint 2 after 1 s falls '
        'from 3.7° to 0.038°.')
    unsure = replace(GAIN, ratio_high=1.2)
    assert with_gain(r.diagnosis, [unsure]) == r.diagnosis
    assert with_gain(replace(r.diagnosis, causes=()), [GAIN]).sentence == r.diagnosis.sentence


def test_sentence_says_which_error_the_extension_makes_larger() -> None:
    worse = replace(GAIN, channel='joint_1', after=0.13, ratio_low=1.5, ratio_high=2.5)
    both = with_gain(report().diagnosis, [GAIN, worse]).sentence
    assert both.endswith('joint 2 after 1 s falls from 3.7° to 0.038°, that of joint 1 after 1 s '
                         'rises from 3.7° to 7.4°.')
    alone = with_gain(report().diagnosis, [worse]).sentence
    assert 'prediction error of joint 1 after 1 s rises from 3.7° to 7.4°.' in alone
    # Then nobody should use it.
    assert 'do not use it' in alone and 'do not use it' not in both


def test_a_cause_whose_own_channel_rises_most_is_doubted() -> None:
    diagnosis = report().diagnosis
    at_joint = replace(diagnosis, causes=(replace(diagnosis.causes[0], site='joint_2'),))
    falls = tuple(replace(GAIN, channel=f'strain_{name}') for name in ('1a', '1b', '2a', '2b'))
    rises = replace(GAIN, horizon=5.0, after=0.13, ratio_low=1.5, ratio_high=2.5)
    doubted = with_gain(at_joint, [*falls, rises])
    assert doubted.verdict == 'cause_and_remainder' and WORSE_WHERE_NAMED in doubted.sentence
    assert doubted.causes[0].probability < at_joint.causes[0].probability
    elsewhere = replace(rises, channel='joint_1', after=0.14)
    for others in ([elsewhere], [replace(rises, ratio_low=0.9)],
                   [replace(rises, channel='joint_1')]):
        assert with_gain(at_joint, [*falls, *others]).causes == at_joint.causes
    assert with_gain(at_joint, [*falls, rises, elsewhere]).causes == at_joint.causes


def test_sentence_speaks_of_the_channel_of_the_cause_and_of_what_rises_later() -> None:
    r, more = report(), replace(GAIN, channel='strain_1a', after=0.0001)
    at_joint = replace(r.diagnosis, causes=(replace(r.diagnosis.causes[0], site='joint_2'),))
    later = replace(GAIN, channel='strain_1b', horizon=5.0, after=0.13, ratio_low=1.5)
    found = with_gain(at_joint, [more, GAIN, later]).sentence
    assert found.endswith('of joint 2 after 1 s falls from 3.7° to 0.038°, that of strain 1b '
                          'after 5 s rises from 3.7° to 7.4°.')
    of_arm = replace(r.diagnosis, causes=(replace(r.diagnosis.causes[0], site='arm'),))
    assert 'of strain 1a after 1 s falls' in with_gain(of_arm, [more, GAIN]).sentence
    without = with_gain(replace(r.diagnosis, causes=()), [GAIN], 1).sentence
    assert 'With laws of what has no name and the parts' in without


def test_an_answer_says_which_gauge_errs_by_more_than_it_allows() -> None:
    nothing = replace(report().diagnosis, verdict='nothing_wrong', causes=(), advice='')
    gauge = replace(CHANNEL, channel='strain_1a', unit='m/m', swing=1e-4)
    errs = replace(GAIN, channel='strain_1a', unit='m/m', after=9e-6)
    for noise, low, said in ((0.0, 8e-6, True), (0.0, 4e-6, False), (7.5e-6, 8e-6, False)):
        rows, gains = [CHANNEL, replace(gauge, noise=noise)], [GAIN, replace(errs, low=low)]
        found = with_gauges_beyond(nothing, rows, gains)
        assert ('strain 1a errs by 9 % of what it reads' in found.sentence) == said
        assert bool(found.advice) == said and found.verdict == 'nothing_wrong'
        named = with_gauges_beyond(replace(report().diagnosis, verdict='cause'), rows, gains)
        assert ('strain 1a errs by 9 % of what it reads' in named.sentence) == said
    assert with_gauges_beyond(nothing, rows, [replace(errs, horizon=5.0)]) == nothing


@pytest.mark.parametrize('verdict', ['cause_and_remainder', 'data_cannot_answer'])
def test_gauges_that_err_are_not_told_where_something_is_unnamed_or_nothing_was_fitted(
        verdict: Verdict) -> None:
    found = replace(report().diagnosis, verdict=verdict)
    gauge = replace(CHANNEL, channel='strain_1a', unit='m/m', noise=0.0, swing=1e-4)
    errs = replace(GAIN, channel='strain_1a', unit='m/m', after=9e-6, low=8e-6)
    assert with_gauges_beyond(found, [gauge], [errs]) == found


@pytest.mark.parametrize('key, unit, words', [
    ('deviation_kg', 'kg', 'deviation'), ('compliance_rad_per_n_m', 'rad/(N m)', 'compliance'),
    ('damping_n_m_s', 'N m s/rad', 'damping'), ('drift_per_s', 'm/m/s', 'drift'),
    ('inertia_kg_m2', 'kg m^2', 'inertia'), ('modes', 'modes a link', 'modes'),
    ('density_times_drag_kg_per_m3', 'kg/m^3', 'density times drag')])
def test_keys_are_said_without_their_units(key: str, unit: str, words: str) -> None:
    assert key_text(key, unit) == words


@pytest.mark.parametrize('value, digits, text', [
    (174.3, 2, '170'), (-0.0377, 2, '-0.038'), (1254.0, 3, '1250'), (3.0, 3, '3'),
    (0.0, 2, '0'), (2.5e-7, 2, '2.5e-07'), (float('inf'), 2, 'inf')])
def test_numbers_are_written_out(value: float, digits: int, text: str) -> None:
    assert digits_text(value, digits) == text


def test_what_is_to_be_told_apart_is_a_list() -> None:
    assert apart_text(('strain_gain', 'payload_mass')) == 'strain gain from payload mass'
    assert apart_text(('a', 'b', 'c_d')) == 'a from b or c d'
