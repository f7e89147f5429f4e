"""A log that begins in motion: its rates at the first row, and its predictor's first state."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.inputs.first_rates import first_rates, MOVES
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.replay import start_rates
from flex_plant_sim.simulation.simulator import Noise, simulate, Simulator
import numpy as np
import pytest
from simulated_records import predictor
from truth.records import draw_case, make_record

NOISE = np.array([2e-4, 2e-4])


def finite_elements(seed: int, start: int) -> Record:
    """Return a record of a finite-element arm from a row on."""
    case = draw_case(None, seed)
    found = make_record(case)
    output = np.hstack([found.joint, found.strain])
    return Record('log', found.time[start:], found.command[start:], output[start:],
                  case.payload_told)


def start_of(joint: Array, seed: int = 0, count: int = 10) -> tuple[Array, Array]:
    """Return rates and deviations of angles with noise, (N, 2)."""
    noise = NOISE * np.random.default_rng(seed).standard_normal((count, 2))
    return first_rates(joint[:count] + noise, 0.01, NOISE)


def test_a_command_that_begins_with_the_log_is_no_motion() -> None:
    t = 0.01 * np.arange(10)[:, None]
    for seed in range(200):
        # At rest, and accelerated at 20 rad/s^2 behind a lag of 30 ms.
        lagged = 20.0 * (0.5 * t**2 - 0.03 * t + 0.03**2 * (1.0 - np.exp(-t / 0.03)))
        rates, deviations = start_of(np.hstack([0.0 * t, lagged]), seed)
        assert np.all(np.abs(rates) < MOVES * deviations)
        # A drive that is told to turn at 1.4 rad/s after three rows, and does so at its limit.
        turning = np.hstack([0.0 * t, -1.4 * np.maximum(t - 0.025, 0.0)])
        rates, deviations = start_of(turning, seed)
        assert np.all(np.abs(rates) < MOVES * deviations)


def test_a_rate_is_found_within_its_deviation() -> None:
    t = 0.01 * np.arange(10)[:, None]
    z, found = [], []
    for seed in range(200):
        rates, deviations = start_of(t * [0.9, -0.6] + 4.0 * t**2, seed)
        found.append(np.abs(rates) > MOVES * deviations)
        z.append((rates - [0.9, -0.6]) / deviations)
    assert np.mean(found) > 0.95 and np.std(z) < 1.0
    assert np.isinf(first_rates(np.zeros((5, 2)), 0.01, NOISE)[1]).all()


@pytest.mark.parametrize('comparing', [False, True])
def test_a_log_cut_in_motion_is_predicted_as_the_whole_one(comparing: bool) -> None:
    whole = predictor(finite_elements(91, 0), locked=False)
    cut_at = int(np.argmax(np.abs(np.diff(whole.record.output[:1000, :2], axis=0)).min(axis=1)))
    part = predictor(finite_elements(91, cut_at), locked=False)
    states = [Predictor(p.base, p.windows, p.noise, comparing).states for p in (whole, part)]
    order = whole.arm.form.order
    assert np.abs(states[0][cut_at, order:order + 2]).min() > 0.3
    again = np.arange(part.windows.warm_up, part.windows.warm_up + 100)
    error, size = (np.std(x, axis=0)[:order + 2] for x in (
        states[1][again] - states[0][cut_at + again], states[0][cut_at + again]))
    assert np.all(error < 0.02 * size)


def test_a_log_from_rest_begins_at_rest() -> None:
    p = predictor(finite_elements(92, 0), locked=False)
    assert not p.states[0, 2:].any()
    still = predictor(replace(p.record, output=p.record.output + np.array(
        [0.3, -0.2, *np.zeros(p.record.output.shape[1] - 2)])), locked=False)
    np.testing.assert_array_equal(still.states[0, :2], still.record.output[0, :2])
    assert not still.states[0, 2:].any()


def test_the_first_rates_are_read_in_the_arm_s_own_time() -> None:
    """A sixth of its slowest period has eight samples, 0.13 s of the reference arm's three."""
    robot = replace(load_robot('reference'), sample_time=0.04)
    for link in (0, 1):
        robot = robot.with_link(link, thickness=0.4 * robot.links[link].thickness)
    arm, t = ExtendedArm(robot, 'assumed_modes', 2), 0.04 * np.arange(200.0)
    commands = np.column_stack([np.sin(t), 0.8 * np.cos(0.8 * t)])
    output, rates = simulate(Simulator(arm, noise=Noise(1e-4)), commands)
    log = Log('whole', t, commands, output[:, :2], output[:, 2:], robot.gauge_names)
    for first in (37, 50, 80):
        found = start_rates(log.part(first, 200), arm)
        np.testing.assert_allclose(found, rates[first], atol=0.03)
