"""The table for a torque without a name: in files, in the simulator and in the predictor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flex_plant_sim.arm.robot import EffectSpec
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.report.extended_file import write_extended
from flex_plant_sim.effects import build, catalogue, effects_of, kinds
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.joint.measured_torque import MeasuredTorque
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
from msg_config.errors import InputError
import numpy as np
import pytest
from simulated_records import commands, effects, predictor, REFERENCE, simulated


def table(variable: str, knots: tuple[float, ...], torques: tuple[float, ...],
          site: str = 'joint_2') -> MeasuredTorque:
    return MeasuredTorque(site, (variable, knots, torques))


def run(*acting: Effect) -> Array:
    """Return the outputs of the reference arm over 6 s."""
    return simulate(Simulator(ExtendedArm(REFERENCE, effects=acting)), commands(REFERENCE, 6.0))[0]


def test_step_over_speed_is_dry_friction() -> None:
    same = run(*effects('asymmetric_friction:joint_2:forward_n_m=0.4,backward_n_m=0.4'))
    np.testing.assert_allclose(run(table('speed', (-1.0, 0.0, 0.0, 1.0), (0.4, 0.4, -0.4, -0.4))),
                               same, rtol=0.0, atol=1e-12)


def test_slope_over_speed_is_viscous_friction() -> None:
    clean, same = run(), run(*effects('viscous_friction:joint_1:damping_n_m_s=3'))
    got = run(table('speed', (-3.0, 0.0, 3.0), (9.0, 0.0, -9.0), 'joint_1'))
    assert np.max(np.abs(got - same)[:, 0]) < 0.02 * np.max(np.abs(clean - same)[:, 0])


@pytest.mark.parametrize(('variable', 'knots'), [('time', (0.0,)), ('speed', (-1.0, 1.0)),
                                                 ('command', (-1.0, 1.0))])
def test_constant_is_a_bias_of_the_drive(variable: str, knots: tuple[float, ...]) -> None:
    torque = 0.05 * REFERENCE.drives[1].torque_gain
    got = run(table(variable, knots, (torque,) * len(knots)))
    same = run(*effects('actuator_bias:joint_2:bias=0.05'))
    np.testing.assert_allclose(got, same, rtol=0.0, atol=1e-9)


def test_wave_over_angle_is_ripple() -> None:
    angle = np.linspace(-3.0, 3.0, 2401)
    wave = table('angle', tuple(angle), tuple(0.4 * np.sin(9.0 * angle)))
    same = run(*effects('torque_ripple:joint_2:sine_n_m=0.4,cosine_n_m=0,periods_per_turn=9'))
    # Between knots 2.5 mrad apart a line misses the wave by (9 x 0.0025)^2 / 8 of it.
    assert np.max(np.abs(run(wave) - same)) < 1e-3 * np.max(np.abs(same - run()))


def test_spring_over_load_softens_the_joint() -> None:
    # A torque in proportion to the root moment swings with the link.
    clean, got = run(), run(table('load', (-10.0, 10.0), (-2.0, 2.0)))
    assert np.all(np.isfinite(got)) and np.max(np.abs(got - clean)[:, 1]) > 1e-3


def test_predictor_knows_it() -> None:
    hidden = table('speed', (-1.5, -0.2, 0.0, 0.0, 0.2, 1.5), (0.2, 0.3, 0.6, -0.6, -0.3, -0.2))
    record = simulated((hidden,), 24.0)
    without, known = (predictor(record, acting) for acting in ((), (hidden,)))
    errors = [np.sqrt(np.mean(p.innovations()[..., 1]**2)) for p in (without, known)]
    assert errors[1] < 1.3e-4 < 2.0 * errors[1] < errors[0]


def test_file_carries_it(tmp_path: Path) -> None:
    hidden = table('angle', (-1.0, 0.5), (0.25, -0.125), 'joint_1')
    write_extended(tmp_path / 'robot.yaml', 'reference', REFERENCE, (hidden,))
    robot = load_robot(tmp_path / 'robot.yaml')
    assert effects_of(robot) == (hidden,)
    assert 'measured_torque' in kinds() and 'measured_torque' not in catalogue()


GOOD = {'variable': 'speed', 'knots': (0.0, 1.0), 'torques_n_m': (0.5, 0.5)}


@pytest.mark.parametrize(('change', 'message'), [
    ({'variable': 'temperature'}, 'variable: expected one of speed, angle, load, command, time'),
    ({'knots': (1.0, 0.0)}, 'knots: expected ascending numbers'),
    ({'knots': 3.0}, 'knots: expected a list of numbers, got 3.0'),
    ({'torques_n_m': (0.5,)}, 'torques_n_m: expected 2 numbers as in knots, got 1'),
    ({'level_n_m': 0.5}, "expected variable, knots, torques_n_m, got 'level_n_m'")])
def test_bad_table_is_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        build(EffectSpec('measured_torque', 'joint_1', GOOD | change), REFERENCE)


def test_missing_key_is_named() -> None:
    with pytest.raises(InputError, match='knots: expected a value, the key is missing'):
        build(EffectSpec('measured_torque', 'joint_1', {'variable': 'time'}), REFERENCE)


def test_list_for_a_named_effect_is_refused() -> None:
    with pytest.raises(InputError, match='level_n_m: expected a number, got'):
        build(EffectSpec('coulomb_friction', 'joint_1', {'level_n_m': (0.1, 0.2)}), REFERENCE)
