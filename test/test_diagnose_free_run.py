"""Free runs against a step-by-step simulation that discretises every sample afresh."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.free_run import free_run, start_instants
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.effects.base import Effect
import numpy as np
import pytest
from simulated_records import effects, free_run_errors, predictor, simulated

EXTENSIONS = {
    'nothing': (),
    'friction': ('coulomb_friction:joint_2:level_n_m=0.4',),
    'forces': ('coriolis_centripetal:arm:share=1', 'base_tilt:arm:tilt_x_rad=0.03,'
               'tilt_y_rad=-0.02'),
    'sensors': ('strain_gain:strain_1a:factor=1.1', 'strain_delay:arm:delay_s=0.02'),
    'timing': ('input_delay:arm:delay_s=0.023', 'actuator_dead_zone:joint_1:half_width=0.05'),
    'structure': ('clamp_compliance:link_1:compliance_rad_per_n_m=0.003',),
    'payload': ('payload_change:arm:change_kg=0.06,time_s=6.0,duration_s=0.0',)}


def one_by_one(p: Predictor, start: int, steps: int) -> Array:
    """Return the outputs of one run, with exact matrices at every sample."""
    arm, record = p.base.arm(p.record.payload), p.record
    limits = [drive.command_limit for drive in arm.robot.drives]
    sample_time, state, outputs = arm.robot.sample_time, p.states[start], []
    for k in range(start, start + steps):
        time = record.time[k]
        outputs.append(arm.output(state, time))
        command = np.clip(record.command[k], np.negative(limits), limits)
        for effect in arm.effects:
            memory = effect.memory(sample_time)
            command = effect.on_command(command, record.command[k - memory:k], time, sample_time)
        mass = arm.payload
        for effect in arm.effects:
            mass = effect.payload_at(time, mass)
        cosine = np.cos(state[:arm.form.order] @ arm.form.elbow_angle)
        state = arm.at_payload(mass).advance(arm.matrices(float(cosine), mass), state, command,
                                             time)
    return np.array(outputs)


@pytest.mark.parametrize('name', EXTENSIONS)
def test_batch_of_runs_is_the_simulation_step_by_step(name: str) -> None:
    found: tuple[Effect, ...] = effects(*EXTENSIONS[name])
    p = predictor(simulated(found, 24.0), found, locked=False)
    starts, steps = np.array([300, 580, 611]), 80
    outputs = free_run(p, starts, steps)
    for column, start in enumerate(starts):
        expected = one_by_one(p, int(start), steps)
        # Seven nodes over cos(theta_2) interpolate to some 1e-4 where the payload is largest.
        scale = np.max(np.abs(expected), axis=0)
        assert np.all(np.abs(outputs[:, column] - expected) < 5e-4 * scale)


def test_runs_end_with_the_record() -> None:
    record = simulated(duration=24.0)
    p = predictor(record)
    last = len(record.time) - 5
    found = free_run_errors(p, np.array([last]), 8)
    assert np.all(np.isfinite(found[:5]))
    assert np.all(np.isnan(found[5:]))


def test_first_output_is_the_one_step_prediction() -> None:
    p = predictor(simulated(duration=24.0))
    rows = np.array([100, 700])
    np.testing.assert_allclose(free_run(p, rows, 1)[0], p.arm.output(
        p.states[rows], p.record.time[rows]), rtol=1e-12)


def test_a_true_model_without_noise_runs_free_without_error() -> None:
    hidden = effects('coulomb_friction:joint_2:level_n_m=0.4')
    record = simulated(hidden, noise=0.0)
    right = free_run_errors(predictor(record, hidden), np.array([1200]), 100)
    wrong = free_run_errors(predictor(record), np.array([1200]), 100)
    assert np.max(np.abs(right[..., :2])) < 0.02 * np.max(np.abs(wrong[..., 1]))


@pytest.mark.parametrize('first, stop, count', [(0, 10, 240), (5, 1000, 240), (3, 4, 1)])
def test_start_instants_are_even_and_no_more_than_asked(first: int, stop: int,
                                                        count: int) -> None:
    instants = start_instants(first, stop, count)
    assert instants[0] == first
    assert instants[-1] < stop
    assert 1 <= len(instants) <= count
    assert len(set(np.diff(instants))) <= 1
