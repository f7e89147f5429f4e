"""Effects of structure and payload against closed forms and conservation laws."""

from __future__ import annotations

from dataclasses import replace

from extended_arms import arm, COMMANDS, frequencies, moving, outputs, ROBOT, stiff
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.simulator import simulate, Simulator
import numpy as np
import pytest

GRAVITY = 9.81


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
    for model, modes, close in (('assumed_modes', 3, 1e-4), ('paper', 10, 0.05)):
        form = arm(text.format('inertia_kg_m2=0.3,damping_ratio=0.2'), robot=robot, model=model,
                   modes=modes).form
        m, k = form.mass_at(1.0, 0.1)[2:, 2:], form.stiffness_at(1.0)[2:, 2:]
        lowest = np.sqrt(np.min(np.abs(np.linalg.eigvals(np.linalg.solve(m, k)))))
        assert form.names[-1] == 'psi_base'
        assert lowest == pytest.approx((100.0 / inertia)**0.5, rel=close)
        # The rotor is turned by the joint's own angle, and not by the base.
        rotor = form.mass[0, 0, 0] - form.mass[0, 0, -1]
        assert rotor == pytest.approx(robot.drives[0].inertia)
        # What the mounting loses is told as that of the bare base, of 0.3 kg m^2.
        assert form.damping[-1, -1] / (2.0 * lowest * inertia) == pytest.approx(
            0.2 * (0.3 / inertia)**0.5, rel=close)


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
             (lower.mass, elbow + 0.5 * lower.length * d2, True),
             (m, elbow + lower.length * d2, True)]
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
        mass = form.mass_at(np.cos(form.elbow_angle @ p), 0.1)
        return float(0.5 * (rate @ mass @ rate + p @ form.stiffness_at(1.0) @ p))

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


@pytest.mark.parametrize('duration', [0.0, 0.5])
def test_payload_change_is_the_simulator_s_profile(duration: float) -> None:
    text = f'payload_change:arm:change_kg=-0.07,time_s=0.5,duration_s={duration}'
    profile = PayloadProfile((0.5, 0.5 + duration), (0.1, 0.03))
    expected = simulate(Simulator(arm(), profile), COMMANDS)[0]
    np.testing.assert_allclose(outputs(arm(text)), expected, rtol=0.0, atol=1e-12)


def test_an_effect_moves_the_payload_from_where_the_file_has_it() -> None:
    robot = replace(ROBOT, payload_offset=0.02)
    found = arm('payload_offset:arm:offset_m=0.05', robot=robot).form
    expected = arm(robot=replace(ROBOT, payload_offset=0.07)).form
    np.testing.assert_allclose(found.payload_mass, expected.payload_mass, rtol=1e-12)
    assert not np.allclose(found.payload_mass, arm(robot=robot).form.payload_mass, rtol=1e-3)


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
