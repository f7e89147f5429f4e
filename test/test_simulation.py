"""Sampling and simulation: zero-order hold, schedule, order, payload, noise, seeds."""

from __future__ import annotations

from flex_plant_sim.arm.models import MODELS
from flex_plant_sim.arm.robot import EffectSpec
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.schedule import barycentric_weights, chebyshev_nodes
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import state_space, zero_order_hold
from flex_plant_sim.effects import build, catalogue, sites
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.plant_setup import simulator_of
from flex_plant_sim.simulation.simulator import Noise, simulate, Simulator
from msg_config.errors import InputError
from msg_config.parameters import check_parameters
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

ROBOT = load_robot('reference')


def by_expm(a: Array, b: Array, step: float) -> tuple[Array, Array]:
    """Return F and G from scipy's exponential of [[A, B], [0, 0]] T (Van Loan)."""
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    whole = expm(block * step)
    return whole[:n, :n], whole[:n, n:]


@pytest.mark.parametrize('step', [1e-6, 1e-4, 0.01, 0.1])
@pytest.mark.parametrize('model', sorted(MODELS))
def test_zero_order_hold_against_scipy(model: str, step: float) -> None:
    plant = ExtendedArm(ROBOT, model, 3).plant
    f, g = zero_order_hold(plant.a, plant.b, step)
    for k in (0, 9, 24):
        expected = by_expm(plant.a[k], plant.b[k], step)
        for found, exact in zip((f[k], g[k]), expected):
            # Row by row: positions and velocities differ in size by the fastest frequency.
            scale = np.max(np.abs(exact), axis=1, keepdims=True)
            assert np.max(np.abs(found - exact) / np.where(scale > 0.0, scale, 1.0)) < 1e-10


def test_zero_order_hold_of_an_integrator_and_of_nothing() -> None:
    f, g = zero_order_hold(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), 0.5)
    np.testing.assert_allclose(f, [[1.0, 0.5], [0.0, 1.0]], atol=1e-15)
    np.testing.assert_allclose(g, [[0.125], [0.5]], atol=1e-15)
    f, g = zero_order_hold(np.zeros((2, 2)), np.eye(2), 3.0)
    np.testing.assert_allclose(f, np.eye(2))
    np.testing.assert_allclose(g, 3.0 * np.eye(2))


@pytest.mark.parametrize('model', ['paper', 'assumed_modes'])
def test_zero_order_hold_against_an_integrator(model: str) -> None:
    plant = state_space(MODELS[model](ROBOT, 1), 0.6, 0.1)
    command, start = np.array([0.7, -0.4]), 0.1 * np.random.default_rng(2).standard_normal(8)
    f, g = zero_order_hold(plant.a, plant.b, 0.05)
    exact = solve_ivp(lambda _, x: plant.a @ x + plant.b @ command, (0.0, 0.05), start,
                      method='DOP853', rtol=1e-12, atol=1e-14).y[:, -1]
    np.testing.assert_allclose(f @ start + g @ command, exact, rtol=1e-9, atol=1e-11)


def test_interpolation_reproduces_polynomials() -> None:
    nodes, x = chebyshev_nodes(9), np.linspace(-1.0, 1.0, 41)
    weights = barycentric_weights(x, nodes)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-13)
    polynomial = np.polynomial.Polynomial(np.random.default_rng(0).standard_normal(9))
    np.testing.assert_allclose(weights @ polynomial(nodes), polynomial(x), atol=1e-12)


@pytest.mark.parametrize('model', sorted(MODELS))
def test_schedule_against_exact_discretisation(model: str) -> None:
    """At any angle the scheduled matrices are the exact ones to 1e-9 of their size."""
    arm = ExtendedArm(ROBOT, model, 3)
    for theta_2 in np.random.default_rng(1).uniform(-np.pi, np.pi, 12):
        cosine = float(np.cos(theta_2))
        for found, exact in zip(arm.schedule.at(cosine), arm.matrices(cosine, arm.payload)):
            if exact.size:
                assert np.max(np.abs(found - exact)) < 1e-9 * np.max(np.abs(exact))


def commands(count: int, step: float = 0.01) -> Array:
    t = step * np.arange(float(count))
    return np.column_stack([1.2 * np.sin(4.0 * t), 2.0 * np.cos(3.0 * t)])


def test_first_order_in_the_step() -> None:
    """Theta_2 is that at the start of a step: halving the step halves the error."""
    arm = ExtendedArm(ROBOT, 'assumed_modes', 1)
    held, n = commands(60), arm.form.order

    def rate(t: float, x: Array, command: Array) -> Array:
        plant = state_space(arm.form, np.cos(x[1]), arm.payload)
        return plant.a @ x + plant.b @ command

    state = np.zeros(2 * n)
    for command in held:
        state = solve_ivp(rate, (0.0, 0.01), state, method='DOP853', rtol=1e-10,
                          atol=1e-12, args=(command,)).y[:, -1]
    errors = []
    for substeps in (1, 2, 4, 8):
        simulator = Simulator(ExtendedArm(ROBOT, 'assumed_modes', 1, step=0.01 / substeps))
        simulate(simulator, held)
        errors.append(np.linalg.norm(simulator.state[:n] - state[:n]))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.1)
    assert errors[-1] < 1e-3


def test_exact_at_the_sampling_instants_while_the_elbow_stands() -> None:
    """With theta_2 at a standstill any T gives the same states at the same instants."""
    ends = []
    for step in (0.01, 0.001):
        simulator = Simulator(ExtendedArm(ROBOT, 'assumed_modes', 2, step=step))
        simulator.state[2] = 1e-6
        for _ in range(30):
            simulator.step(np.zeros(2))
        ends.append(simulator.state)
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-7, atol=1e-14)


def test_rigid_response_of_the_velocity_loop() -> None:
    """Steady turning: theta_1' tends to gain times command, 1 rad/s per unit."""
    calm = ROBOT.with_link(0, damping_ratio=0.3).with_link(1, damping_ratio=0.3)
    for model in MODELS:
        simulator = Simulator(ExtendedArm(calm, model, 2))
        for _ in range(600):
            simulator.step(np.array([0.2, 0.0]))
        np.testing.assert_allclose(simulator.measure().velocity, [0.2, 0.0], atol=2e-4)


@pytest.mark.parametrize('model', sorted(MODELS))
def test_tachometer_is_the_derivative_of_the_angle(model: str) -> None:
    simulator = Simulator(ExtendedArm(ROBOT, model, 2, step=1e-3))
    for command in commands(40):
        simulator.step(command)
    before = simulator.state.copy()
    fine = Simulator(ExtendedArm(load_robot('reference'), model, 2, step=1e-6))
    fine.state = before
    matrices = fine.arm.matrices(float(np.cos(before[1])), 0.1)
    after = matrices[0] @ before + matrices[1] @ np.array([0.3, 0.1])
    velocity = fine.arm.joint_velocity(before, np.array([0.3, 0.1]))
    np.testing.assert_allclose((after[:2] - before[:2]) / 1e-6, velocity, rtol=2e-3, atol=1e-5)


def test_same_seed_same_bits() -> None:
    noise = Noise(angle=2e-4, strain=5e-7, torque=0.01)
    runs = [simulate(Simulator(ExtendedArm(ROBOT, modes=2), noise=noise, seed=seed), commands(50))
            for seed in (3, 3, 4)]
    np.testing.assert_array_equal(runs[0][0], runs[1][0])
    assert np.all(runs[0][0][1:] != runs[2][0][1:])


def test_reset_repeats_the_run() -> None:
    simulator = Simulator(ExtendedArm(ROBOT, modes=2), PayloadProfile.step(0.1, 0.2, 0.3),
                          Noise(2e-4, 5e-7, 0.01), seed=5)
    first = simulate(simulator, commands(50))
    simulator.reset()
    for once, again in zip(first, simulate(simulator, commands(50))):
        np.testing.assert_array_equal(once, again)


def test_measurement_noise_has_its_deviation_and_stays_outside() -> None:
    quiet = simulate(Simulator(ExtendedArm(ROBOT, modes=2)), commands(2000))[0]
    noisy = simulate(Simulator(ExtendedArm(ROBOT, modes=2), noise=Noise(2e-4, 5e-7), seed=1),
                     commands(2000))[0]
    # 2000 samples: the deviation is known to 1.6 %, three of those allowed.
    np.testing.assert_allclose(np.std(noisy - quiet, axis=0), [2e-4] * 2 + [5e-7] * 4, rtol=0.047)
    correlation = np.corrcoef((noisy - quiet).T) - np.eye(6)
    assert np.max(np.abs(correlation)) < 4.0 / np.sqrt(2000)


def test_process_noise_moves_the_arm() -> None:
    quiet = simulate(Simulator(ExtendedArm(ROBOT, modes=2)), commands(100))[0]
    pushed = simulate(Simulator(ExtendedArm(ROBOT, modes=2), noise=Noise(torque=0.05), seed=1),
                      commands(100))[0]
    difference = np.abs(pushed - quiet)
    assert np.all(difference[0] == 0.0)
    assert np.all(difference[-1] > 0.0)


def test_command_limits_and_what_is_measured() -> None:
    simulator = Simulator(ExtendedArm(load_robot('quanser_2dsfl')))
    simulator.step(np.array([5.0, -5.0]))
    np.testing.assert_array_equal(simulator.measure().command, [0.94, -1.2])
    assert simulator.measure().time == 0.002


@pytest.mark.parametrize('bad', [[np.nan, 0.0], [0.0, np.inf]])
def test_a_command_that_is_no_number_is_refused_and_changes_nothing(bad: list[float]) -> None:
    simulator = Simulator(ExtendedArm(ROBOT, modes=1))
    before = simulator.state.copy()
    with pytest.raises(InputError, match='^command: expected finite numbers, got'):
        simulator.step(np.array(bad))
    np.testing.assert_array_equal(simulator.state, before)


def test_step_must_divide_the_sample_time() -> None:
    with pytest.raises(InputError, match=r'^step: expected the sample time 0.01 s divided by a '
                                         r'whole number, got 0.003 s$'):
        Simulator(ExtendedArm(ROBOT, step=0.003))


def test_unknown_model() -> None:
    with pytest.raises(InputError, match='^model: expected one of paper_reduced, paper, '
                                         "assumed_modes, got 'rigid'$"):
        ExtendedArm(ROBOT, 'rigid')


def test_payload_profiles() -> None:
    pick = PayloadProfile.step(0.1, 2.0, 0.3)
    assert [pick.at(t) for t in (0.0, 1.999, 2.0, 9.0)] == [0.1, 0.1, 0.3, 0.3]
    ramp = PayloadProfile.of_pairs([1.0, 0.0, 3.0, 0.4])
    assert [ramp.at(t) for t in (0.0, 1.0, 2.0, 3.0, 4.0)] == pytest.approx([0, 0, 0.2, 0.4, 0.4])
    assert PayloadProfile.constant(0.2).at(7.0) == 0.2


@pytest.mark.parametrize('times, masses, message', [
    ((0.0,), (-0.1,), r'payload: expected a mass >= 0 kg, got -0.1'),
    ((0.0,), (float('nan'),), r'payload: expected a mass >= 0 kg, got nan'),
    ((1.0, 0.5), (0.1, 0.2), r'payload: expected times that do not decrease, got \(1.0, 0.5\)'),
    ((1.0,), (0.1, 0.2), r'payload: expected as many times as masses, got 1 and 2'),
    ((), (), r'payload: expected as many times as masses, got 0 and 0')])
def test_impossible_payloads(times: tuple[float, ...], masses: tuple[float, ...],
                             message: str) -> None:
    with pytest.raises(InputError, match=f'^{message}$'):
        PayloadProfile(times, masses)


def test_a_payload_acts_from_its_time_on() -> None:
    """Until the pick as with the light payload; a heavier tip then answers otherwise."""
    arm = ExtendedArm(ROBOT, modes=2, payload=0.1)
    light = simulate(Simulator(arm), commands(100))[0]
    picked = simulate(Simulator(arm, PayloadProfile.step(0.1, 0.5, 0.4)), commands(100))[0]
    np.testing.assert_array_equal(light[:51], picked[:51])
    assert np.all(light[60] != picked[60])


def test_a_ramp_is_the_limit_of_small_steps() -> None:
    arm, count = ExtendedArm(ROBOT, modes=2, payload=0.0), 60
    ramp = simulate(Simulator(arm, PayloadProfile((0.0, 0.6), (0.0, 0.3))), commands(count))[0]
    edges = np.repeat(0.01 * np.arange(1.0, 61.0), 2)
    stairs = np.concatenate([[0.0], np.repeat(0.005 * np.arange(1.0, 60.0), 2), [0.3]])
    stepped = simulate(Simulator(arm, PayloadProfile(tuple(edges), tuple(stairs))),
                       commands(count))[0]
    np.testing.assert_allclose(ramp, stepped, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize('name, values', [
    ('coriolis_centripetal', {'share': 1.0}), ('base_tilt', None)])
def test_effects_feel_the_payload_of_the_moment(
        name: str, values: dict[str, float] | None) -> None:
    """An arm that starts empty and has picked 0.3 kg is the arm that carries 0.3 kg."""
    kind = catalogue()[name]
    values = values or {p.name: p.high / 2.0 for p in kind.parameters}
    effect = build(EffectSpec(name, 'arm', values))
    runs = []
    for own, profile in ((0.3, 0.3), (0.0, 0.3)):
        arm = ExtendedArm(ROBOT, modes=2, payload=own, effects=[effect])
        runs.append(simulate(Simulator(arm, PayloadProfile.constant(profile)), commands(80))[0])
    np.testing.assert_allclose(runs[0], runs[1], rtol=1e-9, atol=1e-12)


def test_simulator_is_nonlinear_in_the_elbow_angle() -> None:
    """Folded and stretched the same commands give different motions, alike in sign of angle."""
    ends = {}
    for theta_2 in (0.0, 1.5, -1.5):
        simulator = Simulator(ExtendedArm(ROBOT, modes=2))
        simulator.state[1] = theta_2
        for _ in range(50):
            simulator.step(np.array([1.0, 0.0]))
        ends[theta_2] = simulator.state[0]
    assert abs(ends[0.0] - ends[1.5]) > 1e-3
    assert ends[1.5] == pytest.approx(ends[-1.5], abs=0.02 * abs(ends[1.5]))


def test_the_plant_carries_and_measures_as_the_robot_file_says_unless_told() -> None:
    values = check_parameters('plant_sim', {'robot': 'quanser_2dsfl'})
    measured, _ = simulate(simulator_of(values), np.zeros((2000, 2)))
    np.testing.assert_allclose(measured.std(axis=0), [1.5e-5] * 2 + [1e-6] * 2, rtol=0.1)
    assert simulator_of(values).mass(0.0) == 0.157
    silent = simulator_of({**values, 'angle_noise': 0.0, 'strain_noise': 0.0, 'payload': 0.0})
    assert not simulate(silent, np.zeros((3, 2)))[0].any()
    assert silent.mass(0.0) == 0.0


def carried(schedule: list[float], effect: str) -> Simulator:
    """Return the plant's simulator with a payload of 0.1 kg, a schedule and an effect."""
    return simulator_of(check_parameters('plant_sim', {
        'payload': 0.1, 'payload_schedule': schedule, 'effects': [effect]}))


def test_a_payload_that_was_told_wrong_is_carried_along_the_schedule() -> None:
    heavier = carried([1.0, 0.2, 2.0, 0.0], 'payload_mass:arm:deviation_kg=0.05')
    np.testing.assert_allclose([heavier.mass(t) for t in (0.0, 1.0, 3.0)], [0.15, 0.25, 0.05])
    lighter = carried([1.0, 0.5], 'payload_mass:arm:deviation_kg=-0.2')
    np.testing.assert_allclose([lighter.mass(t) for t in (0.0, 2.0)], [0.0, 0.3])


def test_every_effect_of_the_catalogue_acts_in_the_plant() -> None:
    t = 0.01 * np.arange(220)
    commands = np.column_stack([1.5 * np.sign(np.sin(2.5 * t)), -1.2 * np.sign(np.sin(3.1 * t))])

    def outputs(*effects: str) -> Array:
        return simulate(simulator_of(check_parameters('plant_sim', {
            'angle_noise': 0.0, 'strain_noise': 0.0, 'modes': 2, 'effects': effects})),
            commands)[0]

    without, silent = outputs(), []
    for name, effect in catalogue().items():
        # A change of the payload comes as soon as it may.
        values = ','.join(f'{p.name}={p.starts[0 if p.name == effect.event_time else -1]:g}'
                          for p in effect.parameters if not p.optional)
        with_it = outputs(f'{name}:{sites(effect, ROBOT)[0]}:{values}')
        if np.max(np.ptp(with_it - without, axis=0) / np.ptp(without, axis=0)) < 1e-4:
            silent.append(name)
    # The plant has the Coriolis forces without being told, and a bias moves nothing.
    assert silent == ['coriolis_centripetal', 'angle_offset', 'strain_bias']
