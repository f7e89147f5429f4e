"""Many steps in one loop are the steps of the schedule, compiled or not."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import EffectSpec
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.effects import build
from flex_plant_sim.simulation import stepping
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.simulator import Noise, simulate, Simulator
from flex_plant_sim.simulation.stepping import schedule_row, Stepper
from msg_config.errors import InputError
import numpy as np
import pytest
from truth import simulation as truth
from truth.configuration import reference_arm

ROBOT = load_robot('reference')
CORIOLIS = EffectSpec('coriolis_centripetal', 'arm', {'share': 1.0})
BENT = EffectSpec('foreshortening', 'arm', {'share': 1.0})


def commands(count: int, step: float = 0.01) -> Array:
    t = step * np.arange(float(count))
    return np.column_stack([1.2 * np.sin(4.0 * t), 2.0 * np.cos(3.0 * t)])


def stepped(arm: ExtendedArm, held: Array) -> Array:
    """Return the outputs by the textbook's way: interpolate, apply, ask every effect."""
    state, outputs = np.zeros(arm.states), []
    for k, command in enumerate(held):
        time = k * arm.step_time
        outputs.append(arm.output(state, time))
        matrices = arm.schedule.at(np.cos(schedule_row(arm) @ state))
        state = arm.advance(matrices, state, command, time)
    return np.array(outputs)


@pytest.mark.parametrize('model, effects', [
    ('assumed_modes', ()), ('paper', ()), ('paper_reduced', ()),
    ('assumed_modes', (CORIOLIS,)), ('assumed_modes', (CORIOLIS, BENT)),
    ('paper', (CORIOLIS,)),
    ('assumed_modes', (EffectSpec('motor_lag', 'joint_2', {'time_constant_s': 0.02}),)),
    ('assumed_modes', (EffectSpec('coulomb_friction', 'joint_1', {'level_n_m': 0.2}),))])
def test_many_steps_at_once_are_those_of_the_schedule(model: str,
                                                      effects: tuple[EffectSpec, ...]) -> None:
    arm = ExtendedArm(ROBOT, model, 2, effects=[build(effect) for effect in effects])
    held = commands(150)
    expected = stepped(arm, held)
    assert np.ptp(expected[:, 1]) > 1.0
    np.testing.assert_allclose(simulate(Simulator(arm), held)[0], expected, rtol=0.0, atol=1e-12)


def test_at_once_or_sample_by_sample_with_the_same_noise() -> None:
    arm, profile = ExtendedArm(ROBOT, modes=2, step=0.005), PayloadProfile((0.2, 0.6), (0.0, 0.3))
    noise, held = Noise(angle=2e-4, strain=5e-7, torque=0.01), commands(100)
    at_once, single = Simulator(arm, profile, noise, 5), Simulator(arm, profile, noise, 5)
    outputs, velocities = simulate(at_once, held)
    for command, output, velocity in zip(held, outputs, velocities):
        sample = single.measure()
        np.testing.assert_allclose(sample.output, output, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(sample.velocity, velocity, rtol=0.0, atol=1e-12)
        single.step(command)
    np.testing.assert_array_equal(at_once.state, single.state)
    assert (at_once.time, at_once.samples) == (single.time, single.samples)


@pytest.mark.skipif(not COMPILED, reason='Numba is not installed: there is nothing to compare')
def test_compiled_steps_are_those_of_plain_numpy() -> None:
    arm = ExtendedArm(ROBOT, modes=3, effects=[build(CORIOLIS), build(BENT)])
    stepper, held = Stepper.of(arm), commands(100)
    assert stepper is not None
    fast = stepper.run(np.zeros(arm.states), held, np.zeros((100, arm.form.order)))
    inputs, plain = np.pad(held, ((0, 0), (0, arm.form.order))), np.zeros_like(fast)
    stepping._run_steps.py_func(  # type: ignore[attr-defined]
        stepper.series, stepper.angle, stepper.turning, stepper.bending, stepper.share,
        stepper.step, inputs, plain)
    np.testing.assert_allclose(fast, plain, rtol=0.0, atol=1e-12)


def test_the_reduced_model_takes_no_torque_noise() -> None:
    with pytest.raises(InputError, match='torque'):
        Simulator(ExtendedArm(ROBOT, 'paper_reduced', 2), noise=Noise(torque=0.1))


def energy_drift(angle: str, step: float) -> float:
    """Return the relative change of energy of bending, undamped links that coast for 1 s."""
    robot = ROBOT
    for j in (0, 1):
        robot = robot.with_drive(j, damping=0.0).with_link(j, damping_ratio=0.0)
    arm = ExtendedArm(robot, modes=1, effects=[build(CORIOLIS)], step=step)
    stepper, n, count = Stepper.of(arm), arm.form.order, round(1.0 / step)
    assert stepper is not None
    if angle == 'theta_2':
        stepper = replace(stepper, angle=np.eye(arm.states)[1])
    start = np.zeros(arm.states)
    start[1], start[n:n + 2] = 0.7, (1.5, -2.5)
    states = stepper.run(start, np.zeros((count, 2)), np.zeros((count, n)))

    def energy(state: Array) -> float:
        p, rate = state[:n], state[n:]
        mass = arm.form.mass_at(np.cos(arm.form.elbow_angle @ p), arm.payload)
        return float(0.5 * (rate @ mass @ rate + p @ arm.form.stiffness_at(1.0) @ p))

    return energy(states[-1]) / energy(states[0]) - 1.0


def test_energy_needs_the_angle_between_the_links_where_coriolis_forces_act() -> None:
    """The scheme is of first order; what is left in the limit is the equations' own."""
    limits = {angle: 2.0 * energy_drift(angle, 0.0005) - energy_drift(angle, 0.001)
              for angle in ('elbow', 'theta_2')}
    assert abs(limits['elbow']) < 1e-6
    assert limits['theta_2'] > 5e-5


def test_coriolis_forces_on_that_angle_come_nearer_to_the_finite_elements() -> None:
    time = 0.01 * np.arange(600.0)
    held = 0.5 * np.column_stack([np.sin(2 * time) + 0.4 * np.sign(np.sin(1.3 * time)),
                                  np.sin(3 * time) + 0.4 * np.sign(np.sin(1.7 * time))])
    true = truth.simulate(reference_arm(0.1), command=held).joint
    arm = ExtendedArm(ROBOT, modes=3, payload=0.1, effects=[build(CORIOLIS)])
    stepper, misses = Stepper.of(arm), []
    assert stepper is not None
    for row in (stepper.angle, np.eye(arm.states)[1]):
        states = replace(stepper, angle=row).run(
            np.zeros(arm.states), held, np.zeros((600, arm.form.order)))
        misses.append(np.linalg.norm(states[:-1, :2] - true, axis=0)
                      / np.linalg.norm(true - true.mean(axis=0), axis=0))
    assert np.all(misses[0] < 1e-3)
    assert np.all(misses[0] < 0.6 * misses[1])
