"""When an event happened and how long it took: changes of an arm of finite elements."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.event_grid import EventGrid
from flex_plant_sim.diagnosis.causes.event_time import EventIndices, EventTimeIntegral
from flex_plant_sim.diagnosis.causes.gauss_newton import GaussNewton
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.parameter_values import values_in_set
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.stats import multivariate_normal
from simulated_records import effects, REFERENCE, simulated, SLOWEST
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
                     np.array([1.0, 0.25]), 0.1)


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


def test_no_time_is_added_between_those_that_change_the_same_samples() -> None:
    grid = some_grid()
    seen = np.arange(40) / 10.0
    # A sharp event at a sample: bisecting would end at two equal times.
    responses = 1e3 * np.ones((9, 2, 1)) * (seen >= TIME[:, None, None])
    said = np.concatenate([-responses[4][None], grid.background[1:]])
    for _ in range(60):
        grid = replace(grid, responses=responses, background=said)
        if not (more := grid.refinement_times).size:
            break
        times = np.sort(np.r_[grid.time, more])
        responses = 1e3 * np.ones((times.size, 2, 1)) * (seen >= times[:, None, None])
        grid = replace(grid, time=times)
    assert np.diff(grid.time).min() > 0.04 and np.all(np.isfinite(grid.estimate()))
    assert grid.estimate()[0] == pytest.approx(2.0, abs=0.1)


def test_deviations_are_those_of_what_is_drawn_from_all_events() -> None:
    grid, rng = some_grid(), np.random.default_rng(5)
    values = grid.estimate()
    sudden, gradual = grid.probability
    weight = (gradual + np.diag(sudden)).ravel()
    events = rng.choice(weight.size, 200000, p=weight / weight.sum())
    start, end = np.divmod(events, TIME.size)
    drawn = np.zeros((events.size, 5))
    drawn[:, 0], drawn[:, 1] = TIME[start], TIME[end] - TIME[start]
    root = np.sqrt(grid.channel_weight)[:, None]
    said, *columns = ((row * root).ravel() for row in grid.background)
    for event in np.unique(events):
        of_event = events == event
        k, n = divmod(int(event), TIME.size)
        unit = (response_at(grid, TIME[k], TIME[n] - TIME[k]) * root).ravel()
        wide = np.column_stack([unit, *columns])
        covariance = np.linalg.inv(
            wide.T @ wide + np.diag(np.r_[grid.size_width, grid.prior_widths]**-2.0))
        drawn[of_event, 2:] = rng.multivariate_normal(
            -covariance @ (wide.T @ said), covariance, int(of_event.sum()))
    found = grid.mean_square_deviation(values)
    square = np.mean((drawn - values)**2, axis=0)
    assert np.diagonal(found)[2:] == pytest.approx(square[2:], rel=0.03)
    assert np.all(np.diagonal(found)[:2] >= 0.97 * square[:2])


def arm_that_changes(event: tuple[float, float, float], payload: float | None = None
                     ) -> tuple[Data, BaseModel]:
    """Return the record of an arm of finite elements whose payload changes, and the model."""
    case = draw_case('payload_change', 1, duration_s=18.0)
    (name, _), = case.effects
    if payload is not None:
        case = replace(case, payload_true=payload, payload_told=payload)
    change, start, duration = event
    case = replace(case, effects=((name, {
        'time': start, 'mass': case.payload_true + change, 'duration': duration}),))
    made, robot = make_record(case), load_robot('reference')
    record = Record('made', made.time - made.time[0], made.command,
                    np.column_stack([made.joint, made.strain]), case.payload_told)
    base = nominal_base(robot, 'assumed_modes', 2)
    data = Data.of([record], slowest_frequency(base, case.payload_told), robot.sample_time)
    return data, base


def test_a_grid_weighs_events_as_their_own_responses_do() -> None:
    """Two thirds of a payload are lost: the means of sudden losses had 10 nats more for 3 s."""
    lost = np.array([-0.1, 6.0, 5.0])
    data, base = arm_that_changes((-0.1, 6.0, 5.0), payload=0.15)
    likelihood = Likelihood(base, data.windows, data.noise)
    event, = (h for h in all_hypotheses(base.robot) if h.label == 'payload_change:arm')
    causes = CauseSet((event,), data.duration)
    solver = GaussNewton(likelihood, causes, np.ones(6))
    grid = EventTimeIntegral(solver, solver.linearise(lost, *solver.residual_and_cost(lost)),
                             EventIndices(0, 1, 2)).grid
    found, exact = [], []
    for start, duration in ((6.0, 5.0), (6.8, 3.0), (5.5, 6.0), (7.0, 3.0)):
        values = np.array([-0.1, start, duration])
        point = solver.linearise(values, *solver.residual_and_cost(values))
        exact.append(solver.statistics(point).held_fixed((1, 2)).log_evidence(np.ones(6)))
        found.append(float(grid.log_likelihood_of(grid.averaging_weights_of(start, duration))))
    less = np.array(exact)[1:] - exact[0]
    assert np.all(less < -2.0)
    np.testing.assert_allclose(np.array(found)[1:] - found[0], less, rtol=0.5)


@pytest.fixture(scope='module', params=[(9.2, 0.0), (9.2, 3.7), (4.0, 10.0)])
def arm(request: pytest.FixtureRequest) -> tuple[Data, BaseModel, Array]:
    """Return the record of an arm of finite elements, the model, and its payload's change."""
    start, duration = request.param
    data, base = arm_that_changes((0.03, start, duration))
    return data, base, np.array([0.03, start, duration])


def test_a_change_of_the_payload_is_told_as_slow_as_it_may_be(
        arm: tuple[Data, BaseModel, Array]) -> None:
    """From a sudden one in the middle of it, and from one that is seconds too early."""
    data, base, true = arm
    event, = (h for h in all_hypotheses(base.robot) if h.label == 'payload_change:arm')
    middle = np.array([true[0], true[1] + 0.5 * true[2], 0.0])
    starts = [middle, np.array([0.5 * true[0], true[1] - 3.0, 0.0])]
    found = [RefinedFit.refine(CandidateSet((event,), (start,)), base, data).fit
             for start in starts]
    assert found[1].log_evidence == pytest.approx(found[0].log_evidence, abs=2.0)
    for fit in found:
        for value, truth in zip(values_in_set(fit, event), true):
            assert value.low <= truth <= value.high, value.name
        assert fit.values[2] < 0.5 if true[2] == 0.0 else fit.values[2] > 0.5


def test_a_payload_that_has_changed_moves_as_one_that_is_wrong_from_the_start() -> None:
    """Coriolis forces and those of bent links are of the payload that is carried then."""
    heavy = effects('payload_mass:arm:deviation_kg=0.1')
    base = nominal_base(REFERENCE, 'assumed_modes', 3)
    data = Data.of([simulated(heavy, 14.0)], SLOWEST, REFERENCE.sample_time)
    told, wrong, changed = (
        Likelihood(base, data.windows, data.noise, hidden).centre_residual
        for hidden in ((), heavy,
                       effects('payload_change:arm:change_kg=0.1,time_s=0,duration_s=0')))
    # Forces of the payload that was told are 2 % off.
    assert np.all(np.linalg.norm(changed - wrong, axis=1)
                  < 0.01 * np.linalg.norm(wrong - told, axis=1))
