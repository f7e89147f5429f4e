"""Effects of joints, drives and sensors against closed forms and other programs."""

from __future__ import annotations

from dataclasses import replace

from extended_arms import arm, COMMANDS, effect, frequencies, moving, outputs, ROBOT, stiff
from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import catalogue
from flex_plant_sim.effects.mechanics.elastic_root import root_moment
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
import numpy as np
import pytest
from scipy import signal
from scipy.interpolate import pade
from scipy.linalg import eigh


@pytest.mark.parametrize('text', [
    'coulomb_friction:joint_2:level_n_m=0.4',
    'asymmetric_friction:joint_2:forward_n_m=0.1,backward_n_m=0.7',
    'stribeck_friction:joint_2:level_n_m=0.2,extra_n_m=0.5,speed_rad_per_s=0.1'])
def test_dry_friction_slows_and_never_turns_a_joint(text: str) -> None:
    dry, clean = arm(text), arm()
    state = np.random.default_rng(1).normal(scale=0.1, size=(200, clean.states))
    matrices = clean.schedule.at(np.cos(state[:, 1]))
    speed = [a.advance(matrices, state, np.zeros((200, 2)), 0.0)[:, clean.form.order + 1]
             for a in (dry, clean)]
    assert np.all(speed[0] * speed[1] >= -1e-20)
    assert np.all(np.abs(speed[0]) <= np.abs(speed[1]))
    assert np.mean(np.abs(speed[0]) < np.abs(speed[1])) > 0.99


def test_a_joint_sticks_below_its_friction_and_breaks_away_above() -> None:
    torque = ROBOT.drives[1].torque_gain
    for command, moved in ((0.9, False), (1.2, True)):
        sim = Simulator(arm(f'coulomb_friction:joint_2:level_n_m={torque}'))
        for _ in range(50):
            sim.step(np.array([0.0, command]))
        assert bool(abs(sim.state[1]) > 0.01) is moved


def test_steady_speed_with_viscous_and_with_dry_friction() -> None:
    drive = ROBOT.drives[1]
    speeds = []
    for text in ('viscous_friction:joint_2:damping_n_m_s=2',
                 'coulomb_friction:joint_2:level_n_m=2'):
        robot = replace(stiff(ROBOT, 1.0), payload_mass=0.0)
        sim = Simulator(arm(text, robot=robot.with_link(1, damping_ratio=0.5)))
        for _ in range(400):
            sim.step(np.array([0.0, 1.0]))
        speeds.append(sim.state[sim.arm.form.order + 1])
    np.testing.assert_allclose(speeds, [drive.torque_gain / (drive.damping + 2.0),
                                        (drive.torque_gain - 2.0) / drive.damping], rtol=1e-3)


def test_what_is_left_of_a_drive_s_damping_is_as_good_as_none() -> None:
    drive, low = ROBOT.drives[1], catalogue()['viscous_friction'].at('joint_2', ROBOT)[0].low
    left = arm(f'viscous_friction:joint_2:damping_n_m_s={low}')
    none, less = (outputs(arm(robot=ROBOT.with_drive(1, damping=damping))) for damping in (
        0.0, ROBOT.tolerances.drive_damping * drive.damping))
    assert left.robot.drives[1].damping > 0.0
    assert np.all(np.abs(outputs(left) - none).max(axis=0)
                  < 0.01 * np.abs(less - none).max(axis=0))


def test_a_joint_comes_to_rest_where_spring_and_drive_balance() -> None:
    sim = Simulator(arm('joint_spring:joint_2:stiffness_n_m_per_rad=8,rest_rad=0.3',
                        robot=replace(ROBOT, sample_time=0.002)))
    for _ in range(4000):
        sim.step(np.array([0.0, 0.5]))
    torque = 0.5 * ROBOT.drives[1].torque_gain
    assert sim.state[1] == pytest.approx(0.3 + torque / 8.0, rel=1e-3)


@pytest.mark.parametrize('text, lever', [
    ('gear_compliance:joint_2:compliance_rad_per_n_m=0.05,sensor_behind_gear=1', 0.58),
    ('clamp_compliance:link_2:compliance_rad_per_n_m=0.05', 0.5)])
def test_root_spring_in_series_with_a_light_link(text: str, lever: float) -> None:
    robot = ROBOT.with_link(1, density=1e-3, hub_radius=0.08)
    link = robot.links[1]
    deflection = link.length**3 / (3.0 * link.bending_stiffness) + 0.05 * lever**2
    form = arm(text, robot=robot).form
    held = ['theta_1', 'theta_2', 'q_11', 'q_12', 'q_13']
    assert frequencies(form, held, 0.1)[0] == pytest.approx((0.1 * deflection)**-0.5, rel=1e-5)


@pytest.mark.parametrize('text, lever', [
    ('gear_compliance:joint_2:compliance_rad_per_n_m=0.05,sensor_behind_gear=1', 0.58),
    ('clamp_compliance:link_2:compliance_rad_per_n_m=0.05', 0.5)])
def test_a_lossy_root_spring_damps_by_its_share_of_the_energy(text: str, lever: float) -> None:
    """A spring of Kelvin and Voigt loses omega * retardation of its energy a radian."""
    robot = ROBOT.with_link(1, density=1e-3, hub_radius=0.08)
    link = robot.links[1]
    spring = 0.05 * lever**2
    share = spring / (link.length**3 / (3.0 * link.bending_stiffness) + spring)

    def damping_ratio(retardation: float) -> tuple[float, float]:
        form = arm(f'{text},retardation_s={retardation}', robot=robot).form
        kept = np.arange(form.order) >= 5
        stiffness, mass, damping = (matrix[np.ix_(kept, kept)] for matrix in (
            form.stiffness_at(1.0), form.mass_at(1.0, 0.1), form.damping))
        powers, modes = eigh(stiffness, mass)
        omega, mode = float(np.sqrt(powers[0])), modes[:, 0]
        return float(mode @ damping @ mode) / (2.0 * omega), omega

    (without, omega), (lossy, _) = damping_ratio(0.0), damping_ratio(0.003)
    assert lossy - without == pytest.approx(0.5 * omega * 0.003 * share, rel=1e-4)


@pytest.mark.parametrize('j, compliance', [(0, 0.01), (1, 0.08)])
def test_root_spring_is_that_of_an_added_coordinate(j: int, compliance: float) -> None:
    n, clean = 8, assumed_modes(ROBOT, 8)
    rigid = np.zeros((clean.order, clean.order))
    rigid[j, j] = ROBOT.drives[j].inertia
    spread = np.hstack([np.eye(clean.order), np.eye(clean.order)[:, [j]]])
    mass = spread.T @ (clean.mass_at(0.3, 0.1) - rigid) @ spread
    mass[:-1, :-1] += rigid
    stiffness = np.pad(clean.stiffness_at(0.3), ((0, 1), (0, 1)))
    stiffness[-1, -1] = 1.0 / compliance
    expected = np.sqrt(eigh(stiffness[2:, 2:], mass[2:, 2:], eigvals_only=True))[:4]
    form = arm(f'clamp_compliance:link_{j + 1}:compliance_rad_per_n_m={compliance}', modes=n).form
    np.testing.assert_allclose(frequencies(form, ['theta_1', 'theta_2'], 0.1, 0.3)[:4], expected,
                               rtol=1e-4)


def test_gear_sensor_sees_the_twist_of_a_static_load() -> None:
    text = 'gear_compliance:joint_1:compliance_rad_per_n_m=0.02,sensor_behind_gear={}'
    for model in ('assumed_modes', 'paper'):
        for share in (0.0, 1.0):
            form = arm(text.format(share), model=model).form
            bent = np.zeros(form.order)
            bent[2:] = 0.01
            twist = 0.02 * root_moment(form, ROBOT, 0, 0.0) @ bent
            assert form.angle[0] @ bent == pytest.approx(share * twist, rel=1e-12)


def test_torque_ripple_is_a_sine_of_the_angle() -> None:
    extended = arm('torque_ripple:joint_1:sine_n_m=0.3,cosine_n_m=0.4,periods_per_turn=7')
    motion = moving(extended, 2, rate=0.0)
    expected = 0.5 * np.sin(7.0 * motion.position[:, 0] + np.arctan2(0.4, 0.3))
    force = extended.effects[0].force(motion)
    np.testing.assert_allclose(np.asarray(force)[:, 0], expected, atol=1e-12)
    assert not np.any(np.asarray(force)[:, 1:])


def test_delay_of_one_sample_shifts_the_commands() -> None:
    late = simulate(Simulator(arm('input_delay:arm:delay_s=0.01')), COMMANDS)[0]
    shifted = simulate(Simulator(arm()), np.vstack([np.zeros(2), COMMANDS[:-1]]))[0]
    np.testing.assert_allclose(late, shifted, rtol=0.0, atol=1e-14)


def test_delay_of_a_fraction_is_the_mean_command_of_each_step() -> None:
    late = outputs(arm('input_delay:arm:delay_s=0.023'))
    padded = np.vstack([np.zeros((3, 2)), COMMANDS])
    mixed = 0.7 * padded[1:-2] + 0.3 * padded[:-3]
    np.testing.assert_allclose(late, simulate(Simulator(arm()), mixed)[0], rtol=0.0, atol=1e-12)


def test_delay_of_one_drive_leaves_the_other_s_commands() -> None:
    late = outputs(arm('input_delay:joint_2:delay_s=0.023'))
    padded = np.vstack([np.zeros((3, 2)), COMMANDS])
    mixed = np.where([False, True], 0.7 * padded[1:-2] + 0.3 * padded[:-3], COMMANDS)
    np.testing.assert_allclose(late, simulate(Simulator(arm()), mixed)[0], rtol=0.0, atol=1e-12)


def test_delay_acts_on_commands_as_the_gain_leaves_them() -> None:
    texts = 'actuator_gain:joint_1:factor=1.3', 'input_delay:arm:delay_s=0.02'
    np.testing.assert_allclose(outputs(arm(*texts)), outputs(arm(*texts[::-1])), atol=1e-14)
    late = np.vstack([np.zeros((2, 2)), COMMANDS[:-2]]) * [1.3, 1.0]
    np.testing.assert_allclose(outputs(arm(*texts)), simulate(Simulator(arm()), late)[0],
                               atol=1e-14)


def test_static_command_effects() -> None:
    command, history = np.array([[0.3, -0.7], [0.05, 2.0]]), np.zeros((2, 0, 2))
    for text, expected in (
            ('actuator_dead_zone:joint_2:half_width=0.1', [[0.3, -0.6], [0.05, 1.9]]),
            ('actuator_dead_zone:joint_1:half_width=0.1', [[0.2, -0.7], [0.0, 2.0]]),
            ('actuator_saturation:joint_2:inverse_limit=2', [[0.3, -0.5], [0.05, 0.5]]),
            ('actuator_gain:joint_1:factor=2', [[0.6, -0.7], [0.1, 2.0]]),
            ('actuator_bias:joint_1:bias=-0.1', [[0.2, -0.7], [-0.05, 2.0]])):
        got = effect(text).on_command(command, history, 0.0, 0.01)
        np.testing.assert_allclose(got, expected, atol=1e-15)


def transfer(extended: ExtendedArm, omega: float) -> Array:
    """Return the outputs' response to the commands at omega, rad/s, (m, 2)."""
    plant = extended.plant
    inverse = np.linalg.solve(1j * omega * np.eye(extended.states) - plant.a[3], plant.b[3])
    return plant.c[3] @ inverse


@pytest.mark.parametrize('omega', [3.0, 30.0, 200.0])
def test_dynamics_of_sensors_and_drives_as_transfer_functions(omega: float) -> None:
    clean, s = transfer(arm(), omega), 1j * omega
    filtered = transfer(arm('strain_filter:arm:time_constant_s=0.04,damping=0.8'), omega)
    _, low_pass = signal.freqs([1.0], [0.04**2, 2.0 * 0.8 * 0.04, 1.0], [omega])
    np.testing.assert_allclose(filtered[2:], clean[2:] * low_pass[0], rtol=1e-8)
    np.testing.assert_allclose(filtered[:2], clean[:2], rtol=1e-10)
    lagged = transfer(arm('motor_lag:joint_2:time_constant_s=0.03'), omega)
    np.testing.assert_allclose(lagged, clean * [1.0, 1.0 / (1.0 + 0.03 * s)], rtol=1e-8)
    ratio = transfer(arm('strain_delay:arm:delay_s=0.015'), omega)[2:] / clean[2:]
    over, under = pade([1.0, -1.0, 1.0 / 2.0, -1.0 / 6.0, 1.0 / 24.0, -1.0 / 120.0], 3)
    np.testing.assert_allclose(ratio, over(0.015 * s) / under(0.015 * s), atol=1e-8)
    if omega < 100.0:
        np.testing.assert_allclose(ratio, np.exp(-0.015 * s), rtol=0.0, atol=1e-3)
    late = transfer(arm('angle_delay:joint_2:delay_s=0.015'), omega)
    np.testing.assert_allclose(late[1] / clean[1], over(0.015 * s) / under(0.015 * s), atol=1e-8)
    np.testing.assert_allclose(np.delete(late, 1, 0), np.delete(clean, 1, 0), rtol=1e-10)


def test_strain_filter_is_scipy_s_over_a_finely_sampled_record() -> None:
    robot, fine = replace(ROBOT, sample_time=0.001), np.repeat(COMMANDS, 10, axis=0)
    clean = simulate(Simulator(arm(robot=robot)), fine)[0]
    system = signal.lti([1.0], [0.04**2, 2.0 * 0.8 * 0.04, 1.0])
    time = np.arange(len(fine)) * 0.001
    expected = np.stack([signal.lsim(system, u, time)[1] for u in clean[:, 2:].T], axis=-1)
    got = outputs(arm('strain_filter:arm:time_constant_s=0.04,damping=0.8'))[:, 2:]
    np.testing.assert_allclose(got, expected[::10], atol=3e-3 * np.abs(expected).max())
