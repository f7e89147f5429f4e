"""When an event happened and how long it took: changes of an arm of finite elements."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.event_grid import EventGrid
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import (
    nominal_base,
    parameter_values,
    slowest_frequency,
)
import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.stats import multivariate_normal
from simulated_records import REFERENCE
from truth.records import draw_case, make_record

TIME, DURATION_WIDTHS = np.linspace(0.0, 4.0, 9), np.array([0.5, 1.5, 4.5])


def some_grid(sudden: float = 0.5) -> EventGrid:
    """Return events of nine times in a record of two channels, one of them 3 s long in it."""
    rng = np.random.default_rng(4)
    seen = np.arange(40) / 10.0
    responses = 0.3 * rng.standard_normal((2, 40)) * (seen >= TIME[:, None, None])
    columns = 0.2 * rng.standard_normal((2, 2, 40))
    said = -np.mean(responses[1:8], axis=0) - 0.4 * columns[0] + rng.standard_normal((2, 40))
    return EventGrid(TIME, responses, np.concatenate([said[None], columns]),
                     np.array([0.5, 0.7]), 2.0, DURATION_WIDTHS, 0.8, sudden,
                     np.array([1.0, 0.25]))


def log_likelihood(grid: EventGrid, response: Array) -> float:
    """Return ln p of the residual with a response to a unit size, all Gaussian, written out."""
    root = np.sqrt(grid.channel_weight)[:, None]
    said, *columns = ((row * root).ravel() for row in grid.background)
    wide = np.column_stack([(response * root).ravel() * grid.size_width,
                            *(grid.prior_widths[k] * row for k, row in enumerate(columns))])
    return float(multivariate_normal(cov=np.eye(said.size) + wide @ wide.T).logpdf(said))


def response_at(grid: EventGrid, start: float, duration: float) -> Array:
    """Return the mean of what sudden events of a unit size add between two times."""
    late = start + duration * (np.arange(200) + 0.5) / 200.0
    every = np.apply_along_axis(
        lambda row: np.interp(late, grid.time, row).mean(), 0, grid.responses)
    return np.asarray(every / grid.size)


def test_a_slow_event_s_likelihood_is_that_of_the_mean_of_sudden_ones() -> None:
    grid = some_grid()
    none = log_likelihood(grid, np.zeros((2, 40)))
    for start, duration in ((0.5, 3.0), (1.7, 1.1), (3.2, 0.0), (0.0, 4.0)):
        told = float(grid.log_likelihood_of(grid.averaging_weights_of(start, duration)))
        response = response_at(grid, start, duration)
        assert told == pytest.approx(log_likelihood(grid, response) - none, abs=2e-3)
    assert grid.log_likelihood[1, 7] == pytest.approx(
        grid.log_likelihood_of(grid.averaging_weights_of(0.5, 3.0)))


def test_times_and_durations_are_integrated_over_as_the_prior_says() -> None:
    grid = some_grid()

    def likelihood(start: float, duration: float) -> float:
        weights = grid.averaging_weights_of(start, duration)
        return float(np.exp(grid.log_likelihood_of(weights)))

    def gradual(duration: float, start: float) -> float:
        density = sum(share * np.sqrt(2.0 / np.pi) / width * np.exp(-0.5 * (duration / width)**2)
                      for share, width in zip((1 / 6, 2 / 3, 1 / 6), DURATION_WIDTHS))
        return float(density * likelihood(start, duration))

    at_once, _ = quad(lambda t: likelihood(t, 0.0), 0.0, 4.0, limit=200)
    taking, _ = dblquad(gradual, 0.0, 4.0, 0.0, lambda start: 4.0 - start, epsabs=1e-2)
    assert grid.log_integral == pytest.approx(np.log(0.5 * (at_once + taking) / 4.0), abs=0.1)
    assert grid.probability[0].sum() == pytest.approx(at_once / (at_once + taking), abs=0.05)
    assert some_grid(0.0).probability[0].sum() == 0.0


@pytest.fixture(scope='module', params=[(13.2, 0.0), (13.2, 3.7), (6.0, 13.0)])
def arm(request: pytest.FixtureRequest) -> tuple[Data, BaseModel, Array]:
    """Return the record of an arm of finite elements, the model, and its payload's change."""
    case = draw_case('payload_change', 1, duration_s=24.0)
    (name, _), = case.effects
    change, (start, duration) = 0.03, request.param
    case = replace(case, effects=((name, {
        'time': start, 'mass': case.payload_true + change, 'duration': duration}),))
    made, robot = make_record(case), load_robot('reference')
    record = Record('made', made.time - made.time[0], made.command,
                    np.column_stack([made.joint, made.strain]), case.payload_told)
    base = nominal_base(robot, 'assumed_modes', 2)
    data = Data.of([record], slowest_frequency(base, case.payload_told), robot.sample_time)
    return data, base, np.array([change, start, duration])


def test_a_change_of_the_payload_is_told_as_slow_as_it_may_be(
        arm: tuple[Data, BaseModel, Array]) -> None:
    """From a sudden one in the middle of it, and from one that is seconds too early."""
    data, base, true = arm
    event, = (h for h in all_hypotheses(base.robot) if h.label == 'payload_change:arm')
    starts = [event.as_sudden(true), np.array([0.5 * true[0], true[1] - 3.0, 0.0])]
    found = [RefinedFit.refine(CandidateSet((event,), (start,)), base, data).fit
             for start in starts]
    assert found[1].log_evidence == pytest.approx(found[0].log_evidence, abs=2.0)
    for fit in found:
        for value, truth in zip(parameter_values(fit, event), true):
            assert value.low <= truth <= value.high, value.name
        assert fit.values[2] < 0.5 if true[2] == 0.0 else fit.values[2] > 0.5


@pytest.mark.parametrize('change, start, duration', [
    (-0.08, 9.0, 4.0), (0.16, 2.5, 12.0), (0.05, 6.0, 0.0)])
def test_a_sudden_change_carries_as_much_for_as_long_as_the_slow_one(
        change: float, start: float, duration: float) -> None:
    """The same mass at both ends, and the same integral of it over time."""
    event, = (h for h in all_hypotheses(REFERENCE) if h.label == 'payload_change:arm')
    slow, time = np.array([change, start, duration]), np.arange(0.0005, 20.0, 0.001)
    before, sudden = slow.copy(), event.as_sudden(slow)
    assert np.array_equal(slow, before), 'the values asked about are kept'
    carried = [event.effect_at(values).payload_at(time, 0.2) for values in (slow, sudden)]
    assert carried[1].sum() == pytest.approx(carried[0].sum(), rel=1e-9)
    assert set(np.round(carried[1], 12)) == {0.2, round(0.2 + change, 12)}


def test_what_is_no_event_is_as_sudden_as_it_is_and_each_event_has_its_own_time() -> None:
    known = {h.label: h for h in all_hypotheses(REFERENCE)}
    ripple, event = known['torque_ripple:joint_1'], known['payload_change:arm']
    values = np.array([0.1, 0.2, 7.0])
    assert np.array_equal(ripple.as_sudden(values), values)
    both = CauseSet((ripple, event), 20.0).as_sudden(np.array([*values, 0.1, 5.0, 3.0]))
    assert both == pytest.approx([*values, 0.1, 6.5, 0.0])
