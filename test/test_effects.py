"""The whole catalogue: null, clear, batch and file forms of every effect."""

from __future__ import annotations

from dataclasses import asdict, replace
import math
from pathlib import Path
import re
import subprocess
import sys
from typing import Any

from flex_plant_sim.arm.robot import EffectSpec
from flex_plant_sim.arm.robot_file import load_robot, parse_robot, robot_text
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import build, catalogue, effects_of, explanation_at, parse, sites
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
from msg_config.errors import InputError
import numpy as np
import pytest
import yaml

ROBOT = load_robot('reference')
IDENTIFIERS = tuple(catalogue())
DESIGNED = """
    coulomb_friction viscous_friction asymmetric_friction stribeck_friction backlash
    gear_compliance joint_spring torque_ripple actuator_gain actuator_bias actuator_dead_zone
    actuator_saturation motor_lag input_delay angle_gain angle_offset strain_bias strain_drift
    strain_gain strain_crosstalk strain_filter strain_delay link_stiffness modal_damping air_drag
    clamp_compliance base_tilt base_compliance coriolis_centripetal modal_truncation hub_inertia
    payload_mass payload_inertia payload_change loose_payload drive_bandwidth presliding_friction
    base_sliding angle_delay payload_offset payload_beside drive_integral""".split()
# Inside a short test record, and a gauge other than the last one.
WITHIN = {'time_s': 0.2, 'source': 1.0, 'duration_s': 0.1}
TIME = np.arange(60) * ROBOT.sample_time
COMMANDS = np.stack([np.sin(9.0 * TIME) + 0.5 * np.sign(np.sin(20.0 * TIME)),
                     1.5 * np.cos(11.0 * TIME)], axis=-1)


def clear(effect: type[Effect], site: str | None = None) -> Effect:
    """Return an effect at a size that nobody would overlook."""
    site = site or sites(effect, ROBOT)[-1]
    inside = {**WITHIN, 'source': 4.0} if site == 'strain_1a' else WITHIN
    return effect(site, tuple(inside.get(p.name, p.starts[-1]) for p in effect.parameters))


def outputs(effects: tuple[Effect, ...], model: str) -> Array:
    return simulate(Simulator(ExtendedArm(ROBOT, model, 2, effects=effects)), COMMANDS)[0]


@pytest.fixture(scope='module', params=['assumed_modes', 'paper'])
def clean(request: Any) -> tuple[str, Array]:
    return request.param, outputs((), request.param)


def test_catalogue_is_the_designed_one() -> None:
    assert sorted(IDENTIFIERS) == sorted(DESIGNED)


@pytest.mark.parametrize('identifier', IDENTIFIERS)
def test_declaration(identifier: str) -> None:
    effect = catalogue()[identifier]
    assert effect.identifier == identifier
    assert any(math.isfinite(p.smallest) for p in effect.parameters)
    for p in effect.parameters:
        assert p.low <= p.null <= p.high and p.starts and p.smallest > 0.0
        assert all(p.low <= start <= p.high for start in p.starts)
        if math.isfinite(p.smallest):
            assert any(abs(start - p.null) >= p.smallest for start in p.starts)
            signed = p.low < p.null
            assert not signed or {np.sign(s - p.null) for s in p.starts} == {-1.0, 1.0} \
                or identifier == 'coriolis_centripetal'
    for site in sites(effect, ROBOT):
        sentence = explanation_at(effect, site)
        assert sentence.endswith('.') and '{' not in sentence


@pytest.mark.parametrize('identifier', IDENTIFIERS)
def test_null_is_the_clean_arm(identifier: str, clean: tuple[str, Array]) -> None:
    model, expected = clean
    effect = catalogue()[identifier]
    for site in sites(effect, ROBOT):
        got = outputs((effect(site, tuple(p.null for p in effect.parameters)),), model)
        np.testing.assert_allclose(got, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('identifier', IDENTIFIERS)
def test_clear_value_shows(identifier: str, clean: tuple[str, Array]) -> None:
    model, expected = clean
    for site in sites(catalogue()[identifier], ROBOT):
        got = outputs((clear(catalogue()[identifier], site),), model)
        noise = np.array([ROBOT.angle_noise] * 2 + [ROBOT.strain_noise] * 4)
        assert np.all(np.isfinite(got))
        assert np.max(np.abs(got - expected) / noise) > 1.0


def values_of(effect: type[Effect], count: int, rng: np.random.Generator) -> Array:
    """Return parameter values (count, k) around the starts, one row an item."""
    columns = []
    for p in effect.parameters:
        start = WITHIN.get(p.name, p.starts[0])
        near = np.clip(start * rng.uniform(0.5, 1.5, count), p.low, p.high)
        columns.append(np.full(count, start) if effect.structural else near)
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize('model', ['assumed_modes', 'paper'])
@pytest.mark.parametrize('identifier', IDENTIFIERS)
def test_batch_is_the_loop(identifier: str, model: str) -> None:
    effect, rng, count = catalogue()[identifier], np.random.default_rng(5), 4
    site = sites(effect, ROBOT)[-1]
    values = values_of(effect, count, rng)
    items = [effect(site, tuple(row)) for row in values]
    batch = items[0] if effect.structural else effect(
        site, tuple(values[:, k:k + 1] for k in range(values.shape[1])))
    arms = [ExtendedArm(ROBOT, model, 2, effects=(item,)) for item in (batch, *items)]
    windows, n = 3, arms[0].states
    state = rng.normal(scale=0.02, size=(windows, count, n))
    time, history = rng.uniform(0.0, 9.0, windows), rng.normal(size=(windows, count, 30, 2))
    command = rng.normal(size=(windows, count, 2))
    at_drive = batch.on_command(command, history, time[:, None], 0.01)
    matrices = arms[0].schedule.at(np.cos(state[..., 1]))
    after = arms[0].advance(matrices, state, at_drive, time[:, None])
    read = arms[0].output(after, time[:, None])
    for w in range(windows):
        for b, (item, arm) in enumerate(zip(items, arms[1:])):
            one = item.on_command(command[w, b], history[w, b], time[w], 0.01)
            np.testing.assert_allclose(at_drive[w, b], one, rtol=0.0, atol=1e-12)
            step = arm.advance(arm.schedule.at(np.cos(state[w, b, 1])), state[w, b], one, time[w])
            np.testing.assert_allclose(after[w, b], step, rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(read[w, b], arm.output(step, time[w]), rtol=1e-12,
                                       atol=1e-12)


@pytest.mark.parametrize('identifier', IDENTIFIERS)
def test_robot_file_round_trip(identifier: str) -> None:
    effect = clear(catalogue()[identifier])
    spec = EffectSpec(identifier, effect.site, {
        p.name: float(v) for p, v in zip(effect.parameters, effect.values)})
    assert build(spec, ROBOT) == effect
    text = ','.join(f'{name}={value!r}' for name, value in spec.values.items())
    assert parse(f'{identifier}:{effect.site}:{text}') == spec
    file = Path(sys.modules[load_robot.__module__].__file__ or '').parents[1] / 'robots'
    data = yaml.safe_load((file / 'reference.yaml').read_text())
    data['effects'] = [{'name': spec.name, 'site': spec.site, **spec.values}]
    read = parse_robot(yaml.safe_dump(data), 'test.yaml')
    assert asdict(read.effects[0]) == asdict(spec)
    assert effects_of(read) == (effect,)


def test_a_number_of_an_effect_is_not_judged_as_that_of_a_part() -> None:
    """A link is damped by less than 0.7 of the critical, a base on rubber by more."""
    spec = parse('base_compliance:arm:compliance_rad_per_n_m=0.01,damping_ratio=1.2')
    data = yaml.safe_load(robot_text('reference'))
    data['effects'] = [{'name': spec.name, 'site': spec.site, **spec.values}]
    assert parse_robot(yaml.safe_dump(data), 'test.yaml').effects[0].values == spec.values


@pytest.mark.parametrize('text, message', [
    ('coulomb_frictoin:joint_1:level_n_m=1', "got 'coulomb_frictoin'"),
    ('coulomb_friction:joint_3:level_n_m=1', "expected one of joint_1, joint_2, got 'joint_3'"),
    ('coulomb_friction:joint_1:torque=1', "expected level_n_m, got 'torque'"),
    ('backlash:joint_1:gap_rad=0.1', 'sensor_behind_gear: expected a number, it is missing'),
    ('coulomb_friction:joint_1:level_n_m=-1', 'level_n_m: expected 0 to 20 N m, got -1'),
    ('coulomb_friction:joint_1:level_n_m=nan', 'expected 0 to 20 N m, got nan'),
    ('strain_bias:strain_1c:bias=1e-5', "got 'strain_1c'"),
    ('strain_crosstalk:strain_1a:share=0.1,source=9', 'source: expected 1 to 4, got 9'),
    ('strain_crosstalk:strain_1a:share=0.1,source=1', 'source: expected another gauge, one of 2'),
    ('strain_crosstalk:strain_1a:share=0.1,source=2.4', 'source: expected a whole number'),
    ('coulomb_friction:joint_1', 'expected identifier:site:parameter=number'),
    ('coulomb_friction:joint_1:level_n_m=much', 'expected identifier:site:parameter=number'),
])
def test_bad_input_is_named_in_one_line(text: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        build(parse(text), ROBOT)
    assert message in str(error.value) and '\n' not in str(error.value)


def test_gauge_sites_need_a_robot() -> None:
    spec = parse('strain_bias:joint_1:bias=1e-5')
    with pytest.raises(InputError, match='expected a gauge'):
        build(spec)
    effect = build(replace(spec, site='strain_9'))
    with pytest.raises(InputError, match='expected one of strain_1a'):
        effect.on_output(np.zeros(6), 0.0, ROBOT)


@pytest.mark.parametrize('identifier', ['backlash', 'coulomb_friction', 'gear_compliance',
                                        'drive_integral'])
def test_reduced_model_refuses_what_needs_joint_velocities(identifier: str) -> None:
    with pytest.raises(InputError, match=f'{identifier} needs paper or assumed_modes'):
        ExtendedArm(ROBOT, 'paper_reduced', 2, effects=(clear(catalogue()[identifier]),))


def test_page_is_current(repository: Path) -> None:
    made = subprocess.run([sys.executable, '-m', 'flex_plant_sim.effects'], cwd=repository,
                          capture_output=True, text=True, check=True).stdout
    assert (repository / 'docs' / 'effects.md').read_text(encoding='utf-8') == made
    assert not re.search(r'\b(\w+) (at )?the \1\b', made)  # 'the gauge the gauge'


def test_a_choice_of_numbers_says_what_each_stands_for() -> None:
    """A record's answer may be `sensor behind gear 0`."""
    for effect in catalogue().values():
        for p in effect.parameters:
            assert not p.discrete or p.unit or p.meaning or p.name in effect.explanation, p.name
