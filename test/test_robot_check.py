"""What flex_robot check says, against beams, finite elements and the Riccati bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import json
import math
from pathlib import Path
import re

from cramer_rao import linearise, payload_bound
from finite_elements import natural_frequencies
from flex_plant_sim.arm.robot import EffectSpec, Robot, Tolerances
from flex_plant_sim.arm.robot_file import load_robot, robot_text
from flex_plant_sim.arm.robot_keys import TOLERANCES
from flex_plant_sim.commissioning.observability import observability
from flex_plant_sim.commissioning.plausibility import hints
from flex_plant_sim.commissioning.standard_move import standard_move
from flex_plant_sim.commissioning.summary import locked_modes, tip_force
from flex_plant_sim.diagnosis.likelihood.prior import part_priors
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, prepared, slowest_frequency
from flex_plant_sim.effects import catalogue
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Simulator
from flex_plant_sim.tools.robot import main
from msg_config.errors import InputError
import numpy as np
import pytest

REFERENCE, QUANSER = load_robot('reference'), load_robot('quanser_2dsfl')
GAUGES = ('strain_1a', 'strain_1b', 'strain_2a', 'strain_2b')
# What the prior calls the parts of a tolerance, its key itself where none is named.
OF_LINKS = ('stiffness', 'damping', 'link_mass', 'length', 'drive_inertia', 'drive_gain',
            'drive_damping')
NAMED = {'gauge_position_m': ('position_', GAUGES), 'strain_gain': ('strain_gain:', GAUGES),
         'strain_bias': ('strain_bias:', GAUGES), 'payload': ('payload_mass:', ('arm',)),
         'payload_inertia_kg_m2': ('payload_inertia', ('',)),
         'angle_zero_rad': ('angle_offset:', ('joint_2',))}
UNITS = {'gauge_position_m': 'm', 'strain_bias': 'm/m', 'payload_inertia_kg_m2': 'kg m^2',
         'angle_zero_rad': 'rad'}


@pytest.mark.parametrize('robot', [REFERENCE, QUANSER], ids=['reference', 'quanser'])
def test_a_tip_force_bends_as_beam_theory_says(robot: Robot) -> None:
    """A cantilever in two pieces: strain b M / (2 E I), deflection by Castigliano."""
    upper, lower = robot.links
    behind = lower.hub_radius + lower.length
    expected = [0.5 * upper.thickness * (upper.length - x + behind) / upper.bending_stiffness
                for x in upper.gauge_positions]
    expected += [0.5 * lower.thickness * (lower.length - x) / lower.bending_stiffness
                 for x in lower.gauge_positions]
    found = tip_force(robot, 3)
    np.testing.assert_allclose(found.strain, expected, rtol=1e-9)
    squared = sum(((link.length + lever)**3 - lever**3) / (3.0 * link.bending_stiffness)
                  for link, lever in ((upper, behind), (lower, 0.0)))
    assert found.deflection == pytest.approx(squared, rel=1e-9)


def test_frequencies_are_those_of_finite_elements() -> None:
    hertz, _ = locked_modes(REFERENCE, 5, 0.1)
    truth = natural_frequencies(REFERENCE, 0.0, 0.1)[:3] / (2.0 * math.pi)
    np.testing.assert_allclose(hertz[:3], truth, rtol=2e-3)


def test_the_bound_without_tolerances_is_that_of_the_riccati_recursion() -> None:
    """Another way to the same number: known start, no process noise, state and payload."""
    none = replace(REFERENCE, tolerances=Tolerances(**dict.fromkeys(vars(Tolerances()), 0.0)))
    move = standard_move(none)
    arm = ExtendedArm(none, modes=2)
    # The recursion is of linear equations.
    none = replace(none, effects=(EffectSpec('coriolis_centripetal', 'arm', {'share': 0.0}),))
    states, _ = Simulator(arm).advance(move.commands, np.zeros((len(move.commands), 2)))
    noise = [none.angle_noise] * 2 + [none.strain_noise] * 4
    bound = payload_bound(linearise(arm, states, move.commands), noise, np.zeros(arm.states))
    for damping in (0.0, 1e-6):
        narrow = replace(none, tolerances=replace(none.tolerances, damping=damping))
        found = observability(narrow, 2)
        assert found.exact == pytest.approx(bound[-2], rel=2e-3)
        assert found.within_tolerances == pytest.approx(found.exact, rel=0.05 if damping else 1e-9)


def test_the_bound_never_beats_the_scale_that_tolerances_leave_open() -> None:
    """Masses, stiffnesses, drive dampings all larger alike: the outputs stay as they are."""
    t = REFERENCE.tolerances
    scaled = [t.stiffness, t.link_mass, t.drive_inertia, t.drive_damping] * 2 + [
        t.elbow_mass, t.elbow_inertia]
    floor = REFERENCE.payload_mass / math.sqrt(sum(tau**-2 for tau in scaled))
    found = observability(REFERENCE, 2)
    assert floor < found.within_tolerances < 10.0 * floor
    assert found.exact < 1e-2 * found.within_tolerances


def test_faster_sampling_with_as_much_noise_a_second_tells_as_much(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Of 100 kHz five hundred samples are taken as one.
    monkeypatch.setattr('flex_plant_sim.commissioning.observability.MAX_SAMPLES', 2000)
    faster = replace(REFERENCE, sample_time=1e-5, angle_noise=REFERENCE.angle_noise * 10.0**1.5,
                     strain_noise=REFERENCE.strain_noise * 10.0**1.5)
    found, slow = observability(faster, 2), observability(REFERENCE, 2)
    assert REFERENCE.sample_time == 0.01
    assert found.exact == pytest.approx(slow.exact, rel=0.02)
    assert found.within_tolerances == pytest.approx(slow.within_tolerances, rel=0.02)


def test_a_payload_that_the_model_cannot_carry_is_one_line() -> None:
    with pytest.raises(InputError, match='payload: expected one that the model moves, got 300 '
                       'kg: with 2 modes it is unstable'):
        observability(replace(REFERENCE, payload_mass=300.0), 2)


@pytest.mark.parametrize('change, words', [
    (lambda r: r.with_link(0, thickness=0.01, height=0.009), 'are the two exchanged'),
    (lambda r: r.with_link(1, damping_ratio=0.3), '1 % is 0.01'),
    (lambda r: r.with_link(1, damping_ratio=0.0), '0 is taken as exact'),
    (lambda r: r.with_link(1, gauge_positions=()), 'links.lower: no gauge'),
    (lambda r: r.with_link(1, gauge_positions=(0.02, 0.499)), 'nearer to the clamp'),
    (lambda r: replace(r, sample_time=0.1), 'to see the second mode'),
    (lambda r: r.with_link(1, youngs_modulus=7e9), 'large deflections'),
    (lambda r: r.with_link(0, youngs_modulus=7e15).with_link(1, youngs_modulus=7e15),
     'flexible at all'),
    (lambda r: r.with_link(0, density=2.7), 'steel is 7850'),
    (lambda r: replace(r, drives=(r.drives[0], replace(r.drives[1], damping=0.02))), 'in ms'),
    (lambda r: replace(r, elbow_mass=1.578, elbow_inertia=0.1704),
     '0.1704 is 1.578 kg at 0.33 m from the elbow axis: is it about another axis?'),
    (lambda r: replace(r, angle_limits=((-90.0, 90.0), (-1.5, 1.5))), 'is it in degrees'),
    (lambda r: replace(r, payload_mass=0.1, payload_inertia=0.025), 'at 0.5 m from its centre'),
    (lambda r: replace(r, angle_noise=0.1), 'in degrees'),
    (lambda r: replace(r, strain_noise=5e-3), '1 um/m is 1e-6'),
    (lambda r: replace(r, tolerances=replace(r.tolerances, stiffness=3.0)), 'is 300 %'),
])
def test_what_hardly_any_arm_is_gets_a_hint(change: Callable[[Robot], Robot], words: str) -> None:
    robot = change(REFERENCE)
    bent = tip_force(robot, 2)
    found = hints(robot, tuple(locked_modes(robot, 2, 0.1)[0]), bent.deflection,
                  tuple(bent.strain))
    assert any(words in line for line in found)
    assert len(found) <= 2


@pytest.mark.parametrize('bent_share, said', [(0.18, False), (0.22, True)])
def test_a_tip_is_bent_by_what_the_arm_weighs(bent_share: float, said: bool) -> None:
    """A payload whose weight bends the tip by a share of the reach, by statics of beams."""
    upper, lower = (link.length for link in REFERENCE.links)
    radii = [link.hub_radius for link in REFERENCE.links]
    first, second = (link.youngs_modulus * link.height * link.thickness**3 / 12.0
                     for link in REFERENCE.links)
    # The lower link stands on the end of the upper, stretched out, joints held.
    arm = lower + radii[1]
    sag = upper**3 / 3.0 + arm * upper**2 + arm**2 * upper
    by_newton = sag / first + lower**3 / (3.0 * second)
    assert tip_force(REFERENCE, 3).deflection == pytest.approx(by_newton, rel=0.01)
    payload = bent_share * (sum(radii) + upper + lower) / (9.80665 * by_newton)
    assert payload > REFERENCE.links[1].mass
    found = hints(replace(REFERENCE, payload_mass=payload), (1.0, 4.0), by_newton, (1e-3,) * 4)
    assert any('large deflections' in line for line in found) == said


def test_the_tool_prints_draws_and_writes(tmp_path: Path,
                                          capsys: pytest.CaptureFixture[str]) -> None:
    arm, picture, figures = tmp_path / 'a.yaml', tmp_path / 'a.svg', tmp_path / 'a.json'
    assert main(['template', '--output', str(arm)]) == 0
    assert main(['check', str(arm), '--json', str(figures)]) == 0
    text = capsys.readouterr().out
    found = json.loads(figures.read_text())
    assert found['hints'] == [] and 'every number is one that an arm can have' in text
    assert found['not_in_file'] == {} and 'not in the file' not in text
    assert f'± {1e3 * found["payload_std_kg"]["parts_within_tolerances"]:.2g} g' in text
    assert main(['show', str(arm), '--output', str(picture)]) == 0
    assert '<svg' in picture.read_text(encoding='utf-8')
    assert main(['show', str(arm), '--output', str(tmp_path / 'a.txt')]) == 2
    assert 'expected an image suffix' in capsys.readouterr().err


def test_what_is_large_is_written_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = tmp_path / 'a.yaml'
    stiff = re.sub('(thickness_m: )[0-9.]+', r'\g<1>0.03', robot_text('reference'))
    arm.write_text(stiff.replace('{mass_kg: 0.1', '{mass_kg: 20'))
    assert main(['check', str(arm)]) == 0
    text = capsys.readouterr().out
    assert re.search(r'worth \d{3} mN', text) and re.search(r'± \d{3} g', text)
    assert 'e+' not in text


def test_the_whole_prior_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Each width differs, so that none can stand in another's place.
    widths = {key: size * (1.0 + 0.01 * k) for k, (key, (size, _)) in enumerate(
        TOLERANCES.items())}
    arm = tmp_path / 'arm.yaml'
    arm.write_text(robot_text('reference') + 'tolerances:\n' + ''.join(
        f'  {key}: {width:.6g}\n' for key, width in widths.items()))
    assert main(['prior', str(arm)]) == 0
    parts, effects = capsys.readouterr().out.split('\n\n')
    expected: dict[str, tuple[object, str]] = {}
    for key, width in widths.items():
        kind, named = NAMED.get(key, (key, ('_1', '_2') if key in OF_LINKS else ('',)))
        unit = UNITS.get(key, '%')
        shown = pytest.approx(width * (100.0 if unit == '%' else 1.0), rel=5e-3)
        expected |= {kind + name: (shown, unit) for name in named}
    lines = [line.split(maxsplit=3) for line in parts.splitlines()]
    assert {name: (float(size), unit) for name, _, size, unit in lines} == expected
    assert {part.name for part in part_priors(load_robot(arm), 0.1)} == set(expected)
    assert {line.split()[0].partition(':')[0] for line in effects.splitlines()[1:-1]} == set(
        catalogue())


def test_what_a_cut_file_lost_is_listed_with_what_stands_in(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm, text = tmp_path / 'a.yaml', robot_text('quanser_2dsfl')
    arm.write_text(text[:text.index('  strain_gain:')])
    assert main(['check', str(arm)]) == 0
    assert 'strain_gain 0.01, payload 0.01' in capsys.readouterr().out
    arm.write_text(text.replace('strain_gain: 0.1', 'strain_gain: 10'))
    assert main(['check', str(arm)]) == 2
    assert 'tolerances.strain_gain: expected 0, or 1e-09 to 3, got 10' in capsys.readouterr().err


def test_an_effect_that_is_none_is_named_with_its_file(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm, text = tmp_path / 'a.yaml', robot_text('quanser_2dsfl')
    arm.write_text(f'{text}effects: [{{name: rust, site: joint_1}}]\n')
    assert main(['check', str(arm)]) == 2
    assert capsys.readouterr().err.startswith(f'error: {arm}: effects: expected one of ')


def test_a_slow_arm_moves_as_long_as_its_diagnosis_needs(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm, log = tmp_path / 'a.yaml', tmp_path / 'a.csv'
    arm.write_text(re.sub('(thickness_m: )[0-9.]+', r'\g<1>0.001', robot_text('reference')))
    robot = load_robot(str(arm))
    base = nominal_base(robot, 'assumed_modes', 3)

    def cut() -> None:
        read = read_log(str(log), robot)
        records, nominal = prepared([Record.of(read, robot.payload_mass)], base)
        Data.of(records, slowest_frequency(nominal, robot.payload_mass),
                nominal.robot.sample_time)

    assert main(['move', str(arm), '--modes', '1', '--output', str(log)]) == 0
    assert capsys.readouterr().err == ''
    cut()
    log.unlink()
    assert main(['move', str(arm), '--modes', '1', '--strokes', '30', '--output', str(log)]) == 0
    said = re.fullmatch(r'.*a.csv: 30.0 s, flex_diagnose needs ([0-9.]+) s, 16 periods.*\n',
                        capsys.readouterr().err)
    with pytest.raises(InputError, match=f'at least {said and said[1]} s, 16 periods'):
        cut()


@pytest.mark.parametrize('options, words', [
    (['--output', 'move.png'], '--output: move.png: expected a name that ends with .csv'),
    (['--output', 'move.csv', '--strokes', '1000000'],
     'strokes: expected at most 500000 samples in all, got 1000000 strokes of 1 s'),
    (['--output', 'move.csv', '--payload', '1e300'], 'expected a mass >= 0 kg, at most 1000 kg')])
def test_a_move_that_is_no_log_is_refused_in_one_line(
        options: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        code = main(['move', 'reference', *options])
    except SystemExit as stop:
        code = int(stop.code or 0)
    lines = capsys.readouterr().err.splitlines()
    assert code == 2 and len(lines) == 1 and words in lines[0]
    assert not any(tmp_path.iterdir())
