"""Effects against closed forms, other programs and conservation laws."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm_model import Array, SecondOrderForm
from flex_plant_sim.assumed_modes import assumed_modes
from flex_plant_sim.effects import build, parse
from flex_plant_sim.effects.base import Effect, Motion
from flex_plant_sim.effects.elastic_root import root_moment
from flex_plant_sim.effects.kinematics import root_row
from flex_plant_sim.extended_arm import ExtendedArm
from flex_plant_sim.payload_profile import PayloadProfile
from flex_plant_sim.robot import load_robot, Robot
from flex_plant_sim.simulation import simulate, Simulator
import numpy as np
import pytest
from scipy import signal
from scipy.interpolate import pade
from scipy.linalg import eigh

ROBOT = load_robot('reference')
TIME = np.arange(150) * ROBOT.sample_time
COMMANDS = np.stack([np.sin(4.0 * TIME), 0.8 * np.cos(5.0 * TIME)], axis=-1)
GRAVITY = 9.81


def effect(text: str) -> Effect:
    return build(parse(text), ROBOT)


def arm(*texts: str, robot: Robot = ROBOT, model: str = 'assumed_modes', modes: int = 3,
        step: float | None = None) -> ExtendedArm:
    return ExtendedArm(robot, model, modes, effects=[effect(text) for text in texts], step=step)


def outputs(extended: ExtendedArm) -> Array:
    return simulate(Simulator(extended), COMMANDS)[0]


def stiff(robot: Robot, factor: float = 1e4, **changes: float) -> Robot:
    for j in (0, 1):
        robot = robot.with_link(j, youngs_modulus=70e9 * factor, damping_ratio=0.0, **changes)
    return robot


def frequencies(form: SecondOrderForm, held: list[str], payload: float,
                cosine: float = 1.0) -> Array:
    """Return the natural frequencies, rad/s, with some coordinates held at zero."""
    free = [k for k, name in enumerate(form.names) if name not in held]
    pick = np.ix_(free, free)
    return np.sqrt(eigh(form.stiffness_at(cosine)[pick],
                        form.mass_at(cosine, payload)[pick], eigvals_only=True))


def moving(extended: ExtendedArm, seed: int, rate: float = 1.0) -> Motion:
    rng, n = np.random.default_rng(seed), extended.form.order
    position = rng.normal(scale=0.01, size=(20, n))
    position[:, :2] = rng.uniform(-1.5, 1.5, (20, 2))
    velocity = rng.normal(scale=rate, size=(20, n))
    return extended.motion(np.hstack([position, velocity]), np.zeros((20, 2)), 0.0)


# Joint and gear

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
    for text in ('viscous_friction:joint_2:damping_n_m_s=2', 'coulomb_friction:joint_2:level_n_m=2'):
        robot = replace(stiff(ROBOT, 1.0), payload_mass=0.0)
        sim = Simulator(arm(text, robot=robot.with_link(1, damping_ratio=0.5)))
        for _ in range(400):
            sim.step(np.array([0.0, 1.0]))
        speeds.append(sim.state[sim.arm.form.order + 1])
    np.testing.assert_allclose(speeds, [drive.torque_gain / (drive.damping + 2.0),
                                        (drive.torque_gain - 2.0) / drive.damping], rtol=1e-3)


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


# Drive and timing

def test_delay_of_one_sample_shifts_the_commands() -> None:
    late = simulate(Simulator(arm('input_delay:arm:delay_s=0.01')), COMMANDS)[0]
    shifted = simulate(Simulator(arm()), np.vstack([np.zeros(2), COMMANDS[:-1]]))[0]
    np.testing.assert_allclose(late, shifted, rtol=0.0, atol=1e-14)


def test_delay_of_a_fraction_is_the_mean_command_of_each_step() -> None:
    late = outputs(arm('input_delay:arm:delay_s=0.023'))
    padded = np.vstack([np.zeros((3, 2)), COMMANDS])
    mixed = 0.7 * padded[1:-2] + 0.3 * padded[:-3]
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
    over, under = pade([1.0, -1.0, 1.0 / 2.0, -1.0 / 6.0, 1.0 / 24.0], 2)
    np.testing.assert_allclose(ratio, over(0.015 * s) / under(0.015 * s), atol=1e-8)
    if omega < 100.0:
        np.testing.assert_allclose(ratio, np.exp(-0.015 * s), rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(np.abs(ratio), 1.0, atol=1e-8)


def test_strain_filter_is_scipy_s_over_a_finely_sampled_record() -> None:
    robot, fine = replace(ROBOT, sample_time=0.001), np.repeat(COMMANDS, 10, axis=0)
    clean = simulate(Simulator(arm(robot=robot)), fine)[0]
    system = signal.lti([1.0], [0.04**2, 2.0 * 0.8 * 0.04, 1.0])
    time = np.arange(len(fine)) * 0.001
    expected = np.stack([signal.lsim(system, u, time)[1] for u in clean[:, 2:].T], axis=-1)
    got = outputs(arm('strain_filter:arm:time_constant_s=0.04,damping=0.8'))[:, 2:]
    np.testing.assert_allclose(got, expected[::10], atol=3e-3 * np.abs(expected).max())


# Links and structure

def test_hub_inertia_is_rotor_or_elbow_inertia() -> None:
    drive = ROBOT.drives[0]
    for model in ('assumed_modes', 'paper'):
        form = arm('hub_inertia:joint_1:inertia_kg_m2=0.03', model=model).form
        same = arm(robot=ROBOT.with_drive(0, inertia=drive.inertia + 0.03), model=model).form
        np.testing.assert_allclose(form.mass, same.mass, atol=1e-15)
        form = arm('hub_inertia:elbow:inertia_kg_m2=0.002', model=model).form
        same = arm(robot=replace(ROBOT, elbow_inertia=ROBOT.elbow_inertia + 0.002),
                   model=model).form
        np.testing.assert_allclose(form.mass, same.mass, atol=1e-15)


def test_base_on_its_spring_under_a_rigid_arm() -> None:
    robot, text = stiff(ROBOT, 1e6), 'base_compliance:arm:compliance_rad_per_n_m=0.01,{}'
    upper, lower = robot.links
    reach = upper.length + lower.length
    middle = upper.length + 0.5 * lower.length
    inertia = (upper.mass * upper.length**2 / 3.0 + robot.elbow_mass * upper.length**2
               + robot.elbow_inertia + lower.mass * (middle**2 + lower.length**2 / 12.0)
               + 0.1 * reach**2 + 0.3)
    for model, modes in (('assumed_modes', 3), ('paper', 3)):
        form = arm(text.format('inertia_kg_m2=0.3'), robot=robot, model=model, modes=modes).form
        free = form.order - 1
        keep = [k for k in range(2, form.order)]
        m, k = form.mass_at(1.0, 0.1)[np.ix_(keep, keep)], form.stiffness_at(1.0)[np.ix_(keep, keep)]
        lowest = np.sqrt(np.min(np.abs(np.linalg.eigvals(np.linalg.solve(m, k)))))
        assert free == form.names.index('psi_base')
        assert lowest == pytest.approx((100.0 / inertia)**0.5, rel=1e-3 if model != 'paper' else 0.1)


def test_air_drag_on_a_turning_arm_and_never_with_the_motion() -> None:
    extended = arm('air_drag:arm:density_times_drag_kg_per_m3=10')
    motion = moving(extended, 3)
    power = np.sum(np.asarray(extended.effects[0].force(motion)) * motion.velocity, axis=-1)
    assert np.all(power < 0.0)
    straight = np.zeros(2 * extended.form.order)
    straight[extended.form.order] = -2.0
    torque = np.asarray(extended.effects[0].force(
        extended.motion(straight, np.zeros(2), 0.0)))[0]
    upper, lower = ROBOT.links
    reach = upper.length + lower.length
    expected = 0.5 * 10.0 * 4.0 * (upper.height * upper.length**4
                                   + lower.height * (reach**4 - upper.length**4)) / 4.0
    assert torque == pytest.approx(expected, rel=1e-12)


def gravity_torque(theta_1: float, theta_2: float, x: float, y: float) -> Array:
    """Return the torque of a field (x, y), m/s^2, on the joints of the straight-linked arm."""
    (upper, lower), m = ROBOT.links, ROBOT.payload_mass
    d1, d2 = (np.array([np.cos(a), np.sin(a)]) for a in (theta_1, theta_1 + theta_2))
    elbow = upper.length * d1
    parts = [(upper.mass, 0.5 * elbow, False), (ROBOT.elbow_mass, elbow, False),
             (lower.mass, elbow + 0.5 * lower.length * d2, True), (m, elbow + lower.length * d2, True)]
    torque = np.zeros(2)
    for mass, place, is_lower in parts:
        torque[0] += mass * (place[0] * y - place[1] * x)
        arm_2 = place - elbow
        torque[1] += is_lower * mass * (arm_2[0] * y - arm_2[1] * x)
    return torque


@pytest.mark.parametrize('theta_1, theta_2', [(0.3, 0.0), (-0.7, 1.1), (0.4, -1.6)])
def test_tilt_loads_the_joints_as_statics_says(theta_1: float, theta_2: float) -> None:
    text = 'base_tilt:arm:tilt_x_rad=0.03,tilt_y_rad=-0.02'
    expected = gravity_torque(theta_1, theta_2, GRAVITY * np.sin(0.03), GRAVITY * np.sin(-0.02))
    # The paper's root moment, a sum of clamped-free modes, converges slowly: N m, of 0.25 at most.
    for model, modes, close in (('assumed_modes', 3, 1e-13), ('paper', 12, 4e-3)):
        extended = arm(text, model=model, modes=modes)
        form, state = extended.form, np.zeros(2 * extended.form.order)
        state[:2] = theta_1, theta_2
        load = np.asarray(extended.effects[0].force(extended.motion(state, np.zeros(2), 0.0)))
        if model == 'paper':
            # The rotors feel the links through their bending, held against the field.
            assert not np.any(load[:2])
            stiffness = form.stiffness_at(np.cos(theta_2))
            bent = np.linalg.solve(stiffness[2:, 2:], load[2:])
            load[:2] = -stiffness[:2, 2:] @ bent
        np.testing.assert_allclose(load[:2], expected, rtol=1e-12, atol=close)


def test_coriolis_force_conserves_energy() -> None:
    extended = arm('coriolis_centripetal:arm:share=1')
    motion, form = moving(extended, 4), extended.form
    angle, turn = motion.position @ form.elbow_angle, motion.velocity @ form.elbow_angle
    change = form.mass[1] + motion.payload * form.payload_mass[1]
    power = np.einsum('bi,ij,bj->b', motion.velocity, change, motion.velocity)
    growth = 0.5 * power * -np.sin(angle) * turn
    force = np.asarray(extended.effects[0].force(motion))
    np.testing.assert_allclose(np.sum(force * motion.velocity, axis=-1), -growth, rtol=1e-10)


def test_coriolis_force_on_rigid_links_is_the_textbook_s() -> None:
    extended = arm('coriolis_centripetal:arm:share=1')
    w_1, w_2, theta_2 = 1.3, -0.8, 0.9
    state = np.zeros(2 * extended.form.order)
    state[1], state[extended.form.order:][:2] = theta_2, (w_1, w_2)
    upper, lower = ROBOT.links
    h = upper.length * np.sin(theta_2) * lower.length * (0.5 * lower.mass + ROBOT.payload_mass)
    force = np.asarray(extended.effects[0].force(extended.motion(state, np.zeros(2), 0.0)))
    np.testing.assert_allclose(force[:2], [h * (2.0 * w_1 * w_2 + w_2**2), -h * w_1**2],
                               rtol=1e-12)


def energy_drift(share: float, step: float) -> float:
    """Return the relative change of energy of stiff links coasting for 1 s."""
    robot = replace(stiff(ROBOT, 3e3), sample_time=0.01)
    for j in (0, 1):
        robot = robot.with_drive(j, damping=0.0)
    sim = Simulator(arm(f'coriolis_centripetal:arm:share={share}', robot=robot, modes=1,
                        step=step))
    n = sim.arm.form.order
    sim.state[1], sim.state[n:n + 2] = 0.7, (0.5, -0.9)

    def energy() -> float:
        form, p, rate = sim.arm.form, sim.state[:n], sim.state[n:]
        return 0.5 * (rate @ form.mass_at(np.cos(form.elbow_angle @ p), 0.1) @ rate
                      + p @ form.stiffness_at(1.0) @ p)

    before = energy()
    for _ in range(100):
        sim.step(np.zeros(2))
    return abs(energy() / before - 1.0)


def test_coasting_arm_keeps_its_energy_with_coriolis_forces_alone() -> None:
    drifts = [energy_drift(1.0, step) for step in (0.01, 0.005, 0.0025)]
    assert drifts[2] < 1e-3 * energy_drift(0.0, 0.0025)
    np.testing.assert_allclose(np.divide(drifts[:2], drifts[1:]), 2.0, rtol=0.1)


def test_more_shapes_bring_the_paper_s_two_modes_to_the_finite_elements() -> None:
    # Joint-locked frequencies of the reference robot, 0.1 kg, theta_2 = 0: finite elements.
    form = arm('modal_truncation:arm:modes=3', model='paper', modes=2).form
    np.testing.assert_allclose(frequencies(form, ['theta_1', 'theta_2'], 0.1)[:3],
                               [7.87, 25.47, 143.4], rtol=0.01)


# Payload

@pytest.mark.parametrize('duration', [0.0, 0.5])
def test_payload_change_is_the_simulator_s_profile(duration: float) -> None:
    text = f'payload_change:arm:change_kg=-0.07,time_s=0.5,duration_s={duration}'
    profile = PayloadProfile((0.5, 0.5 + duration), (0.1, 0.03))
    expected = simulate(Simulator(arm(), profile), COMMANDS)[0]
    np.testing.assert_allclose(outputs(arm(text)), expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('model', ['assumed_modes', 'paper'])
def test_loose_payload_swings_on_its_grip(model: str) -> None:
    text = 'loose_payload:arm:compliance_m_per_n=0.02,damping_ratio=0.05'
    form = arm(text, robot=stiff(ROBOT, 1e6), model=model).form
    m, d, k = (matrix[-1, -1] for matrix in (form.mass_at(0.4, 0.1), form.damping,
                                             form.stiffness_at(0.4)))
    assert (k / m)**0.5 == pytest.approx((50.0 / 0.1)**0.5, rel=1e-4)
    assert d / (2.0 * (k * m)**0.5) == pytest.approx(0.05, rel=1e-4)
    stiffer = arm(text.replace('0.02', '1e-6'), model=model).form
    pick = np.ix_(range(2, form.order), range(2, form.order))
    low = [np.sort(np.abs(np.linalg.eigvals(np.linalg.solve(
        f.mass_at(0.4, 0.1)[2:, 2:], f.stiffness_at(0.4)[2:, 2:]))))[:3]
        for f in (stiffer, arm(model=model).form)]
    assert np.linalg.cond(form.mass_at(0.4, 0.0)[pick]) < 1e9
    np.testing.assert_allclose(low[0], low[1], rtol=1e-3)


def test_root_rows_turn_with_their_links() -> None:
    form = assumed_modes(ROBOT, 2)
    assert root_row(form, 0)[0] == 1.0 and root_row(form, 1)[:2].tolist() == [1.0, 1.0]


# Backlash

GAP = 'backlash:joint_2:gap_rad=0.03,sensor_behind_gear={}'


def lead_and_state(extended: ExtendedArm, commands: Array, substeps: int = 1) -> Array:
    """Return the states (N, n) before each command."""
    sim, states = Simulator(extended), []
    for command in commands:
        states.append(sim.state.copy())
        sim.step(command)
    return np.array(states)


def test_a_link_rests_while_its_rotor_crosses_half_the_gap() -> None:
    extended, drive = arm(GAP.format(0)), ROBOT.drives[1]
    states = lead_and_state(extended, np.tile([0.0, 0.2], (30, 1)))
    tau = drive.inertia / drive.damping
    time = np.arange(30) * ROBOT.sample_time
    rotor = 0.2 * (time - tau * (1.0 - np.exp(-time / tau)))
    crossing = rotor < 0.015
    read = states @ extended.output_matrix[1]
    assert 5 < crossing.sum() < 15
    np.testing.assert_allclose(read[crossing], rotor[crossing], atol=1e-12)
    np.testing.assert_allclose(states[crossing, 1], 0.0, atol=1e-12)
    assert states[-1, 1] > 0.01
    lead = states[:, extended.form.names.index('gap_joint_2')]
    np.testing.assert_allclose(lead[crossing.sum() + 1:crossing.sum() + 5], -0.015, atol=1e-15)


@pytest.mark.parametrize('model', ['assumed_modes', 'paper'])
def test_lead_stays_within_the_gap_and_both_sensors_agree(model: str) -> None:
    behind, motor = (arm(GAP.format(side), model=model) for side in (1, 0))
    states = lead_and_state(behind, COMMANDS)
    lead = states[:, behind.form.names.index('gap_joint_2')]
    assert np.max(np.abs(lead)) <= 0.015 and np.ptp(np.sign(lead)) == 2.0
    difference = states @ (behind.output_matrix - motor.output_matrix).T
    np.testing.assert_allclose(difference[:, 1], lead, atol=1e-15)


def test_backlash_does_not_depend_on_the_step() -> None:
    coarse = outputs(arm(GAP.format(1)))
    fine = outputs(arm(GAP.format(1), step=0.001))
    clean = outputs(arm())
    effect_size = np.linalg.norm(fine - clean, axis=0)
    assert np.all(np.linalg.norm(coarse - fine, axis=0)[1:] < 0.25 * effect_size[1:])


def test_backlash_never_feeds_energy_in() -> None:
    robot = ROBOT
    for j in (0, 1):
        robot = robot.with_drive(j, damping=0.0).with_link(j, damping_ratio=0.0)
    sim = Simulator(arm(GAP.format(1), robot=robot, modes=1, step=0.001))
    form, n = sim.arm.form, sim.arm.form.order
    k, inertia = form.names.index('gap_joint_2'), robot.drives[1].inertia
    sim.state[2:4], sim.state[n + 1] = 0.02, 0.5

    def energy() -> float:
        p, rate = sim.state[:n].copy(), sim.state[n:].copy()
        rotor = rate[1] - rate[k]
        p[k] = rate[k] = 0.0
        cosine = np.cos(p[1])
        return 0.5 * (rate @ form.mass_at(cosine, 0.1) @ rate + inertia * (rotor**2 - rate[1]**2)
                      + p @ form.stiffness_at(cosine) @ p)

    before = energy()
    for _ in range(200):
        sim.step(np.zeros(2))
        assert energy() < 1.02 * before
