"""The independent truth: right by closed forms, by statics, by energy and by another simulator."""

from __future__ import annotations

from dataclasses import replace
import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any, TypeVar

import numpy as np
import pytest
from truth.assembly import add_terms, assemble, locked_frequencies
from truth.compiled import loop_acceleration
from truth.configuration import Arm, Joint, Link, reference_arm
from truth.effects import CATALOGUE
from truth.equations import acceleration
from truth.full_elements import full_frequencies
from truth.records import (
    build_arm,
    draw_case,
    HAVE_MUJOCO,
    make_record,
    MUJOCO,
    NO_MUJOCO,
    OF_MUJOCO_ALONE,
    TruthCase,
)
from truth.simulation import energy, simulate
from truth.tolerances import TOLD

Part = TypeVar('Part', Link, Joint)

HERE = Path(__file__).parent
BENCH = HERE.parent.parent / 'shared' / 'data' / 'bench'
ANGLE_NOISE, STRAIN_NOISE = 1e-4, 5e-7
# (gamma L) of a clamped-free beam: any text on vibrations, e.g. Blevins 1979, table 8-1.
GAMMA_L = (1.87510407, 4.69409113, 7.85475744, 10.99554073)
# Joint-locked frequencies, rad/s, from another program: payload kg, theta_2 rad.
TABLE = [(0.1, 0.0, (7.87, 25.47, 143.4, 218.8)), (0.1, np.pi / 2, (9.45, 19.36, 142.5, 212.7)),
         (0.0, 0.0, (10.15, 39.30, 166.5, 254.2))]
# These change the set-points, not the arm.
MOTIONS = ('coriolis_centripetal', 'modal_truncation')


def with_each(parts: tuple[Part, Part], **changes: Any) -> tuple[Part, Part]:
    """Return both links or both joints with the same changes."""
    return replace(parts[0], **changes), replace(parts[1], **changes)


def undriven(arm: Arm) -> Arm:
    """Return `arm` without damping and drives."""
    return replace(arm, links=with_each(arm.links, damping_ratio=0.0),
                   joints=with_each(arm.joints, torque_gain=0.0, damping=0.0))


def test_elements_against_closed_form() -> None:
    """Twenty elements give the clamped-free frequencies of a beam."""
    link = reference_arm(0.1).links[0]
    mesh = link.mesh(20)
    mass, stiffness = mesh.mass()[2:, 2:], mesh.stiffness()[2:, 2:]
    squares = np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)
    scale = np.sqrt(link.bending_stiffness / link.mass_per_length) / link.length**2
    assert np.sqrt(squares[:4]) == pytest.approx(np.array(GAMMA_L)**2 * scale, rel=1e-4)


@pytest.mark.parametrize('payload, theta_2, expected', TABLE)
def test_full_elements_against_table(
        payload: float, theta_2: float, expected: tuple[float, ...]) -> None:
    """All elements of the arm with its joints held."""
    got = full_frequencies(reference_arm(payload), theta_2)[:4]
    assert got == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize('payload, theta_2', [(p, t) for p in (0.0, 0.1, 0.3)
                                              for t in (-1.2, 0.0, 0.7, 1.57)])
def test_component_modes_against_full_elements(payload: float, theta_2: float) -> None:
    """Five shapes a link leave six frequencies within 0.1 %."""
    arm = reference_arm(payload)
    full, reduced = full_frequencies(arm, theta_2, 40), locked_frequencies(arm, theta_2)
    assert reduced[:6] == pytest.approx(full[:6], rel=1e-3)


@pytest.mark.parametrize('beyond', [-0.1, 0.1])
def test_a_payload_away_from_the_tip(beyond: float) -> None:
    """Component modes, all elements and segments in MuJoCo are the same arm."""
    arm = reference_arm(0.1)
    arm = replace(arm, payload=replace(arm.payload, beyond_tip=beyond))
    assert locked_frequencies(arm, 0.7)[:4] == pytest.approx(
        full_frequencies(arm, 0.7, 40)[:4], rel=1e-3)
    if not HAVE_MUJOCO:
        pytest.skip(NO_MUJOCO)
    case = TruthCase(3, (('payload_offset', {'beyond': beyond}),), duration_s=6.0,
                     tolerances=False, noise=0.0)
    elements, chain = (make_record(replace(case, simulator=simulator)).table[:, 1:]
                       for simulator in ('finite_elements', MUJOCO))
    assert np.all(np.std(chain - elements, axis=0) < 0.006 * np.std(elements, axis=0))


def test_compiled_equals_numpy() -> None:
    """The loops for Numba and the numpy form are the same equations."""
    arm = replace(reference_arm(0.1), structure=replace(
        reference_arm(0.1).structure, base_stiffness=900.0, base_inertia=0.4, tilt_x=0.03))
    system = assemble(arm)
    lower = add_terms(system.lower_empty, system.payload_unit, 0.1)
    rng = np.random.default_rng(4)
    for _ in range(20):
        p, v, forces = rng.normal(size=(3, system.size)) * [[0.002], [0.5], [2.0]]
        p[:2] = rng.uniform(-2.0, 2.0, 2)
        rest = (p, v, forces, system.gravity, system.upper, lower, system.constant_mass)
        assert loop_acceleration(*rest) == pytest.approx(acceleration(*rest), rel=1e-9, abs=1e-9)


def test_numpy_path_gives_the_same_log() -> None:
    """A log made without compilation equals the compiled one."""
    code = ('from truth.records import TruthCase, make_record\n'
            'print(make_record(TruthCase(3, duration_s=0.1)).table.tobytes().hex())')
    environment = {**os.environ, 'NUMBA_DISABLE_JIT': '1', 'PYTHONPATH': str(HERE)}
    output = subprocess.run([sys.executable, '-c', code], env=environment, check=True,
                            capture_output=True, text=True).stdout
    plain = np.frombuffer(bytes.fromhex(output.strip())).reshape(10, 9)
    assert plain == pytest.approx(make_record(TruthCase(3, duration_s=0.1)).table, abs=1e-12)


def test_energy_is_conserved_to_the_order_of_the_integrator() -> None:
    """Swinging freely with tip slopes of 0.3 rad, energy errs as h cubed or better."""
    arm = undriven(reference_arm(0.1))
    state = np.zeros((2, assemble(arm).size))
    state[0, [1, 2, 7]], state[1, :2] = (0.5, 0.05, -0.03), (1.5, -2.0)
    errors = []
    for step in (0.00025, 0.000125):
        motion = simulate(replace(arm, step=step), command=np.zeros((100, 2)), state=state)
        first, last = energy(arm, motion.state[0]), energy(arm, motion.state[-1])
        errors.append(abs(last / first - 1.0))
    assert errors[0] < 1e-4
    assert errors[1] < errors[0] / 8.0


def test_step_is_small_enough_and_of_fourth_order() -> None:
    """Halving the step changes the log by far less than the noise, at fourth order."""
    case = replace(draw_case(None, 5, duration_s=4.0), noise=0.0)
    command = make_record(case).command
    arm = replace(reference_arm(case.payload_true), sensors=replace(
        reference_arm(0.1).sensors, angle_step=(0.0, 0.0)))
    runs = [simulate(replace(arm, step=0.001 / 2**k), command=command) for k in range(4)]
    strain = [run.fine_strain[::run.steps_per_sample] for run in runs]
    change = [np.abs(strain[k] - strain[3]).max() for k in range(3)]
    assert change[0] < 1e-2 * STRAIN_NOISE
    assert np.abs(runs[0].joint - runs[3].joint).max() < 1e-2 * ANGLE_NOISE
    assert change[0] / change[1] > 11.0
    assert change[1] / change[2] > 11.0


def test_sag_under_gravity_against_statics() -> None:
    """A tilted arm, joints held, bends as the moment of its weight says."""
    arm = reference_arm(0.1)
    arm = replace(
        arm, joints=with_each(arm.joints, inertia=1e5, damping=0.0),
        structure=replace(arm.structure, tilt_y=-0.01))
    strain = simulate(arm, command=np.zeros((1500, 2))).fine_strain
    # It swings about the sag: a window takes the mean.
    strain = np.average(strain, axis=0, weights=np.hanning(strain.shape[0]))
    link = arm.links[1]
    weight = 9.81 * np.sin(-0.01)
    outer = link.length - np.array(link.gauges)
    moment = weight * (0.1 * outer + 0.5 * link.mass_per_length * outer**2)
    expected = 0.5 * link.thickness * moment / link.bending_stiffness
    assert strain[2:] == pytest.approx(expected, rel=5e-3)


@pytest.mark.parametrize('name', sorted(CATALOGUE))
def test_effect_of_no_size_is_no_effect(name: str) -> None:
    """At its null size an effect leaves the log as it is."""
    case = draw_case(name, 7, severity=0.0, duration_s=2.0)
    clean = make_record(replace(case, effects=()))
    assert make_record(case).table == pytest.approx(clean.table, abs=1e-9)


@pytest.mark.parametrize('name', sorted(set(CATALOGUE) - set(OF_MUJOCO_ALONE)))
def test_effect_of_clear_size_shows(name: str) -> None:
    """At its clear size an effect moves some channel, under the same command, by over 3 sigma."""
    duration = 30.0 if name == 'payload_change' else 6.0
    case = replace(draw_case(name, 8, duration_s=duration), noise=0.0)
    clean_case = replace(case, effects=(), payload_true=case.payload_told)
    record = make_record(case)
    clean = make_record(clean_case, None if name in MOTIONS else record.command)
    difference = np.sqrt(np.mean((record.table - clean.table)[:, 3:]**2, axis=0))
    assert np.all(np.isfinite(record.table))
    noise = np.array([ANGLE_NOISE] * 2 + [STRAIN_NOISE] * 4)
    assert (difference / noise).max() > 3.0


def test_a_payload_changes_by_as_much_as_told_whatever_its_tolerance() -> None:
    """On a Quanser arm of 10 % tolerance, a change by 2.5 g that no record shows was one by 15."""
    case = TruthCase(5104, (('payload_change', {'time': 3.0, 'mass': 0.15, 'duration': 0.0}),),
                     'quanser_2dsfl', payload_true=0.16, payload_told=0.16, spread=TOLD)
    payload = build_arm(case).payload
    assert abs(payload.mass - 0.16) > 1e-3
    assert payload.mass_at(4.0) - payload.mass_at(2.0) == pytest.approx(-0.01)
    lost = replace(case, effects=(('payload_change', {**case.effects[0][1], 'mass': 0.0}),))
    assert build_arm(lost).payload.mass_at(4.0) > 0.0


def test_backlash_stays_in_its_gap() -> None:
    """The link leaves the rotor by half the gap and the contact's small twist, no more."""
    case = draw_case('backlash', 3, duration_s=10.0)
    (_, size), = case.effects
    arm = CATALOGUE['backlash'].apply(reference_arm(0.1), {**size, 'joint': 2})
    command = make_record(draw_case(None, 3, duration_s=10.0)).command
    coordinate = int(assemble(arm).twist[1, 0])
    twist = simulate(arm, command=command).state[:, 0, coordinate]
    assert 0.45 * size['gap'] < np.abs(twist).max() < 0.65 * size['gap']


def test_dry_friction_holds_a_joint() -> None:
    """A command below the friction moves the joint by presliding only, one above it moves on."""
    arm = CATALOGUE['coulomb_friction'].apply(reference_arm(0.1), {'joint': 2, 'torque': 0.4})
    for command, moves in ((0.07, False), (0.09, True)):
        angle = simulate(arm, command=np.full((300, 2), [0.0, command])).joint[-1, 1]
        assert (abs(angle) > 1e-3) == moves


def test_seed_decides_everything() -> None:
    """Same seed, same log, bit for bit; another seed, another log."""
    first = make_record(draw_case('coulomb_friction', 11, duration_s=3.0)).table
    again = make_record(draw_case('coulomb_friction', 11, duration_s=3.0)).table
    other = make_record(draw_case('coulomb_friction', 12, duration_s=3.0)).table
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_pairs_and_distractors() -> None:
    """Both effects of a pair are built in; distractors change the log but not what is named."""
    pair = draw_case(('coulomb_friction', 'strain_bias'), 6, duration_s=3.0)
    assert pair.names == ('coulomb_friction', 'strain_bias')
    tables = [make_record(replace(pair, effects=effects)).table
              for effects in (pair.effects, pair.effects[:1], pair.effects[1:], ())]
    assert all(np.abs(tables[0] - table).max() > 1e-6 for table in tables[1:])
    distracted = draw_case('coulomb_friction', 6, duration_s=3.0, distractors=3)
    assert distracted.names == ('coulomb_friction',)
    assert len(distracted.distractors) == 3
    alone = make_record(replace(distracted, distractors=()))
    assert not np.array_equal(make_record(distracted).table, alone.table)


@pytest.mark.parametrize('robot, columns', [('reference', 9), ('quanser_2dsfl', 7)])
def test_record_as_csv(robot: str, columns: int, tmp_path: Path) -> None:
    """The written log has the header and the numbers of the record."""
    record = make_record(draw_case(None, 2, robot, duration_s=2.0))
    record.write_csv(tmp_path / 'log.csv')
    lines = (tmp_path / 'log.csv').read_text().splitlines()
    assert lines[0].split(',') == list(record.columns)
    assert record.table.shape[1] == columns
    written = np.loadtxt(tmp_path / 'log.csv', delimiter=',', skiprows=1)
    assert written == pytest.approx(record.table, rel=1e-8)


def test_poor_excitation() -> None:
    """At rest nothing moves; with one joint moving the other one hardly does."""
    rest = make_record(draw_case(None, 1, duration_s=5.0, excitation='rest')).joint
    assert rest.std(axis=0).max() < 3e-4
    single = make_record(draw_case(None, 1, duration_s=10.0, excitation='one_joint')).joint
    assert single[:, 0].std() < 0.05 * single[:, 1].std()


def test_truth_imports_nothing_of_the_package() -> None:
    """The truth shares no code with what it judges."""
    for path in (HERE / 'truth').rglob('*.py'):
        assert 'flex_' not in path.read_text(), path.name


def test_bench_record_of_another_simulator() -> None:
    """Nominal truth against the clean MuJoCo record, open loop from its commands."""
    path = BENCH / 'case_8009d8b8.csv'
    if not path.exists():
        pytest.skip('../shared/data/bench is not there: no record of another simulator')
    payload = json.loads((BENCH / 'truth.json').read_text())['case_8009d8b8']['payload_told']
    log = np.loadtxt(path, delimiter=',', skiprows=1)
    motion = simulate(reference_arm(payload), command=log[:, 1:3])
    strain = motion.fine_strain[::motion.steps_per_sample]
    measured, simulated = log[:, 3:], np.hstack([motion.joint, strain])
    error = np.linalg.norm(measured - simulated, axis=0)
    fit = 100.0 * (1.0 - error / np.linalg.norm(measured - measured.mean(axis=0), axis=0))
    assert fit[:2].min() > 99.5
    assert fit[2:].min() > 98.0


@pytest.mark.skipif(not HAVE_MUJOCO, reason=NO_MUJOCO)
@pytest.mark.parametrize('name', [
    'stribeck_friction', 'backlash', 'gear_compliance', 'motor_lag', 'clamp_compliance',
    'joint_spring', 'base_compliance', 'base_tilt', 'air_drag', 'loose_payload', 'hub_inertia',
    'drive_integral'])
def test_both_truths_tell_the_same_of_an_effect(name: str) -> None:
    """Under one command they differ by far less than the effect changes either of them."""
    case = replace(draw_case(name, 8, duration_s=1.5), noise=0.0)
    elements = make_record(case)
    chain = make_record(replace(case, simulator=MUJOCO), elements.command)
    clean = make_record(replace(case, effects=(), payload_true=case.payload_told),
                        elements.command)
    apart = np.linalg.norm(chain.table - elements.table, axis=0)
    effect = np.linalg.norm(clean.table - elements.table, axis=0)
    assert np.any(apart[3:] < 0.2 * effect[3:])


@pytest.mark.skipif(not HAVE_MUJOCO, reason=NO_MUJOCO)
def test_the_air_does_not_take_a_payload_without_mass_for_a_sail() -> None:
    """Where all of the payload is loose, hardly a mass is left that is held: a box of 77 m."""
    case = replace(draw_case('air_drag', 8, duration_s=2.0), noise=0.0, simulator=MUJOCO,
                   spread=TOLD)
    loose = ('loose_payload', {'frequency': 92.6, 'damping_ratio': 0.036})
    held = make_record(case)
    found = make_record(replace(case, effects=(*case.effects, loose)), held.command)
    apart = np.linalg.norm(found.table - held.table, axis=0)
    assert np.all(apart[3:] < 0.05 * np.linalg.norm(held.table, axis=0)[3:])


@pytest.mark.skipif(not HAVE_MUJOCO, reason=NO_MUJOCO)
def test_a_chain_that_is_unstable_takes_shorter_steps() -> None:
    """A drive so stiff that its implicit damping counts as more than its rotor's inertia."""
    case = TruthCase(13330, robot='quanser_2dsfl', duration_s=0.2, spread=TOLD, simulator=MUJOCO)
    assert np.isfinite(make_record(case).table).all()
