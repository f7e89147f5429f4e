"""One likelihood and one prior, on problems whose answers have closed forms."""

from __future__ import annotations

from dataclasses import replace
import math

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.likelihood.evidence import (
    channel_products,
    detectable_size,
    GaussianMarginal,
    ParameterPrior,
    sandwich_covariance,
)
from flex_plant_sim.diagnosis.likelihood.prior import (
    log_prior_odds,
    part_priors,
    parts_without_effect,
    PROBABILITY_ANY_CAUSE,
    with_deviations,
)
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm
from simulated_records import REFERENCE

RNG = np.random.default_rng(7)
COLUMNS, PRIOR_WIDTHS = RNG.standard_normal((30, 4)), np.array([0.5, 1.0, 2.0, 1e-9])
RESIDUAL = RNG.standard_normal(30) + COLUMNS @ np.array([0.4, -1.0, 2.5, 0.0])
NO_BOUNDS = np.array([-np.inf]), np.array([np.inf])
PRIOR = ParameterPrior(np.array([1.0]), np.array([0.7]), *NO_BOUNDS, np.zeros(1, bool),
                       np.zeros(1))


def marginal_of(residual: Array, columns: Array, prior_widths: Array) -> GaussianMarginal:
    """Return the marginal of residuals (M,) with J (M, p)."""
    both = np.column_stack([residual, columns])
    return GaussianMarginal(both.T @ both, prior_widths)


def evidence_of(marginal: GaussianMarginal) -> float:
    """Return ln p(r) + M ln(2 pi) / 2, nats."""
    return -0.5 * marginal.quadratic - marginal.half_log_determinant


def test_evidence_is_that_of_the_gaussian_it_stands_for() -> None:
    marginal = marginal_of(RESIDUAL, COLUMNS, PRIOR_WIDTHS)
    whole = np.eye(30) + COLUMNS @ np.diag(PRIOR_WIDTHS**2) @ COLUMNS.T
    direct = multivariate_normal(np.zeros(30), whole).logpdf(RESIDUAL)
    assert evidence_of(marginal) - 15.0 * np.log(2.0 * np.pi) == pytest.approx(
        direct, rel=1e-12)


def test_posterior_of_the_parts_is_that_of_ridge_regression() -> None:
    marginal = marginal_of(RESIDUAL, COLUMNS, PRIOR_WIDTHS)
    precision = COLUMNS.T @ COLUMNS + np.diag(PRIOR_WIDTHS**-2.0)
    # The residual is what is left: r = e + J b is explained by b of the other sign.
    assert marginal.mean == pytest.approx(
        -np.linalg.solve(precision, COLUMNS.T @ RESIDUAL), rel=1e-6, abs=1e-12)
    assert marginal.covariance == pytest.approx(np.linalg.inv(precision), rel=1e-6, abs=1e-12)


def statistics(scale: float = 1.0) -> SufficientStatistics:
    """Return two channels of 15 samples, one value at 1.2 and three parts, unit temper aside."""
    rows = np.vstack([RESIDUAL, COLUMNS.T]).reshape(5, 2, 15) * scale
    return SufficientStatistics(channel_products(rows, rows), np.array([0.2]), PRIOR,
                                PRIOR_WIDTHS[1:], 15.0, np.array([3.0, 4.0]))


def test_sufficient_statistics_hold_the_evidence_of_the_gaussian_they_stand_for() -> None:
    """Linear: r = y + J (value - 1.2) + K b with both Gaussian, channels of two scales."""
    scale, temper = np.array([1.5, 2.0]), 3.0
    deviation = np.repeat(scale * np.sqrt(temper), 15)
    prior = np.concatenate([PRIOR.width, PRIOR_WIDTHS[1:]])
    mean = RESIDUAL - 0.2 * COLUMNS[:, 0]
    whole = np.diag(deviation**2) + COLUMNS @ np.diag(prior**2) @ COLUMNS.T
    direct = multivariate_normal(np.zeros(30), whole).logpdf(mean) + 15.0 * np.log(2.0 * np.pi)
    tempered = direct + 30.0 * 0.5 * np.log(temper) + np.sum(np.log(np.repeat(scale, 15)))
    paid = (15.0 * np.sum(np.log(scale)) + 7.0) / temper
    found = statistics().joint_marginal(scale, temper)
    assert evidence_of(found) - paid == pytest.approx(tempered - paid, rel=1e-10)
    # At the optimum Laplace's method is exact.
    best = replace(statistics(), offsets=found.mean[:1])
    move = np.eye(5)
    move[1, 0] = found.mean[0] - 0.2
    best = replace(best, products=move.T @ statistics().products @ move)
    assert best.log_evidence(scale, temper) == pytest.approx(evidence_of(found) - paid)


def test_the_scale_is_the_likeliest_and_never_below_one() -> None:
    bare = replace(statistics(3.0), tolerances=np.full(3, 1e-9))
    power = np.sum((3.0 * RESIDUAL.reshape(2, 15))**2, axis=1)
    assert bare.likeliest_error_scale() == pytest.approx(np.sqrt(power / 15.0), rel=1e-6)
    assert statistics(1e-3).likeliest_error_scale() == pytest.approx([1.0, 1.0])


def test_a_prediction_that_is_not_finite_has_no_evidence() -> None:
    with np.errstate(invalid='ignore'):
        marginal = marginal_of(RESIDUAL * np.inf, COLUMNS, PRIOR_WIDTHS)
    assert evidence_of(marginal) == -np.inf


@pytest.mark.parametrize('low, high', [(-np.inf, 0.0), (0.0, np.inf), (-0.3, 0.5), (0.2, 0.4)])
def test_a_prior_keeps_the_mass_within_its_bounds(low: float, high: float) -> None:
    column, width = COLUMNS[:, :1], 0.7
    mass = norm.cdf(high, scale=width) - norm.cdf(low, scale=width)
    marginal = marginal_of(RESIDUAL, column, np.array([width]))

    def density(theta: float) -> float:
        left = RESIDUAL + column[:, 0] * theta
        prior = norm.pdf(theta, scale=width) / mass
        return float(np.exp(-0.5 * left @ left + 0.5 * RESIDUAL @ RESIDUAL) * prior)

    prior = ParameterPrior(np.zeros(1), np.array([width]), np.array([low]), np.array([high]),
                           np.zeros(1, bool), np.zeros(1))
    inside = prior.log_correction(np.zeros(1), marginal.mean, np.diagonal(marginal.covariance))
    assert evidence_of(marginal) + 0.5 * RESIDUAL @ RESIDUAL + inside == pytest.approx(
        np.log(quad(density, max(low, -8.0), min(high, 8.0))[0]), abs=1e-6)


@pytest.mark.parametrize('end', [-1.2, 1.5])
def test_a_value_at_an_end_of_its_prior_is_weighed_up_to_there(end: float) -> None:
    """The likeliest value is 0.4: with it outside of the bounds, the gradient is not zero."""
    column, width = COLUMNS[:, 0], 0.7
    low, high = min(end, 0.1), max(end, 0.1)
    prior = ParameterPrior(np.zeros(1), np.array([width]), np.array([low]), np.array([high]),
                           np.zeros(1, bool), np.zeros(1))
    value = high if end < 0.0 else low

    def density(theta: float) -> float:
        left = RESIDUAL - column * theta
        return float(np.exp(-0.5 * left @ left + 0.5 * RESIDUAL @ RESIDUAL)
                     * norm.pdf(theta, scale=width))

    rows = np.stack([RESIDUAL - column * value, -column])[:, None]
    statistics = SufficientStatistics(channel_products(rows, rows), np.array([value]), prior,
                                      np.zeros(0), 30.0, np.zeros(1))
    mass = norm.cdf(high, scale=width) - norm.cdf(low, scale=width)
    assert statistics.log_evidence(np.ones(1), 1.0) + 0.5 * RESIDUAL @ RESIDUAL == pytest.approx(
        np.log(quad(density, low, high)[0] / mass), abs=1e-6)


@pytest.mark.parametrize('low, high', [(-np.inf, np.inf), (0.0, np.inf)])
@pytest.mark.parametrize('truth', [0.1, 1.5, 5.0])
def test_a_width_is_known_to_a_factor(truth: float, low: float, high: float) -> None:
    """The evidence is that of a slab whose width has a Gaussian logarithm, by three widths."""
    column, width, spread = COLUMNS[:, 0], 0.7, math.log(2.0)
    slab = ParameterPrior(np.zeros(1), np.array([width]), np.array([low]), np.array([high]),
                          np.zeros(1, bool), np.array([spread]))
    residual = RESIDUAL - column * truth
    nodes, weights = np.polynomial.hermite_e.hermegauss(3)
    widths = width * np.exp(spread * nodes)
    mass = norm.cdf(high, scale=widths) - norm.cdf(low, scale=widths)

    def density(theta: Array | float) -> Array:
        theta = np.asarray(theta)[..., None]
        left = residual + column * theta
        likelihood = np.exp(0.5 * RESIDUAL @ RESIDUAL - 0.5 * np.sum(left**2, axis=-1))
        return likelihood * (norm.pdf(theta, scale=widths) @ (weights / weights.sum() / mass))

    values = np.linspace(max(low, truth - 3.0), truth + 3.0, 60001)
    best = values[np.argmax(density(values))]
    rows = np.stack([residual + column * best, column])[:, None]
    statistics = SufficientStatistics(channel_products(rows, rows), np.array([best]), slab,
                                      np.zeros(0), 30.0, np.zeros(1))
    # No posterior here is wider than half a width: Laplace's method errs by less than this.
    assert statistics.log_evidence(np.ones(1), 1.0) + 0.5 * RESIDUAL @ RESIDUAL == pytest.approx(
        np.log(quad(density, max(low, truth - 4.0), truth + 4.0, limit=200)[0]), abs=0.03)


@pytest.mark.parametrize('likeliest', [-0.5, 0.5])
def test_a_value_that_the_data_do_not_tell_costs_nothing(likeliest: float) -> None:
    """Such as the speed of an extra friction of zero, wherever its fit was left."""
    column, spread = COLUMNS[:, 0], np.full(2, math.log(2.0))
    slab = ParameterPrior(np.zeros(2), np.array([1.0, 0.1]), np.array([0.0, -0.09]),
                          np.full(2, np.inf), np.zeros(2, bool), spread)
    value = max(likeliest, 0.0)
    rows = np.stack([column * (value - likeliest), column, np.zeros_like(column)])[:, None]

    def log_evidence(slab: ParameterPrior, offsets: list[float]) -> float:
        kept = rows[:1 + len(offsets)]
        return SufficientStatistics(channel_products(kept, kept), np.array(offsets), slab,
                                    np.zeros(0), 30.0, np.zeros(1)).log_evidence(np.ones(1), 1.0)

    told = log_evidence(slab.subset(np.array([0])), [value])
    # A fit stops where little is to be gained.
    assert log_evidence(slab, [value, 0.04]) == pytest.approx(told, abs=0.3)


def test_the_gaussian_that_stands_for_a_slab_has_its_slope() -> None:
    slab = ParameterPrior(np.zeros(2), np.array([0.7, 2.0]), np.full(2, -np.inf),
                          np.full(2, np.inf), np.zeros(2, bool), np.array([math.log(2.0), 0.0]))
    offsets, step = np.array([3.1, 3.1]), 1e-6
    for k, direction in enumerate(np.eye(2)):
        slope = (slab.cost(offsets + step * direction)
                 - slab.cost(offsets - step * direction)) / (2.0 * step)
        assert slope == pytest.approx(offsets[k] / slab.working_width(offsets)[k]**2, rel=1e-6)
    assert slab.working_width(offsets)[1] == pytest.approx(2.0)


def test_a_shape_that_nature_may_lack_is_absent_as_likely_as_not() -> None:
    """One value, known badly and near its centre of 1, with half of its prior at 1."""
    column, width, value = 0.3 * COLUMNS[:, 0], 0.7, 1.1
    spiked = ParameterPrior(np.ones(1), np.array([width]), *NO_BOUNDS, np.ones(1, bool),
                            np.zeros(1))

    def likelihood(theta: float) -> float:
        left = RESIDUAL + column * (theta - value)
        return float(np.exp(-0.5 * left @ left + 0.5 * RESIDUAL @ RESIDUAL))

    prior = quad(lambda theta: likelihood(theta) * norm.pdf(theta, 1.0, width), -8.0, 10.0)[0]
    both = 0.5 * likelihood(1.0) + 0.5 * prior
    best = optimum(RESIDUAL, column, value, spiked)
    assert best.log_evidence(np.ones(1), 1.0) + 0.5 * RESIDUAL @ RESIDUAL == pytest.approx(
        np.log(both), abs=1e-6)


def optimum(residual: np.ndarray, column: np.ndarray, value: float, prior: ParameterPrior
            ) -> SufficientStatistics:
    """Return the sufficient statistics of one value where its posterior is greatest."""
    precision = column @ column + prior.width[0]**-2
    best = (column @ (column * value - residual)
            + prior.centre[0] * prior.width[0]**-2) / precision
    rows = np.stack([residual + column * (best - value), column])[:, None]
    return SufficientStatistics(channel_products(rows, rows), best - prior.centre, prior,
                                np.zeros(0), 30.0, np.zeros(1))


def test_the_evidence_turns_at_the_detection_limit() -> None:
    column, width, price = COLUMNS[:, 0], 3.0, 5.0
    size = detectable_size(float(column @ column), width, price)
    draws = RNG.standard_normal((4000, 30)) + size * column
    gained = [evidence_of(marginal_of(r, column[:, None], np.array([width]))) + 0.5 * r @ r
              for r in draws]
    assert np.mean(gained) == pytest.approx(price, abs=5.0 * np.std(gained) / np.sqrt(4000))


def test_the_odds_leave_the_chance_of_no_cause_that_is_stated() -> None:
    odds = dict.fromkeys(catalogue().values(), 0.0)
    for h in all_hypotheses(REFERENCE):
        odds[h.effect] += np.exp(log_prior_odds(h.effect, REFERENCE))
    none = np.prod(1.0 / (1.0 + np.array(list(odds.values()))))
    assert none == pytest.approx(1.0 - PROBABILITY_ANY_CAUSE)


def test_what_nature_has_one_of_two_values_of_is_weighed_at_both() -> None:
    """A linear parameter that is 0 or 1: the two hypotheses hold the evidence of the mixture."""
    gears = [h for h in all_hypotheses(REFERENCE) if h.label == 'gear_compliance:joint_1']
    assert sorted(h.fixed_values for h in gears) == [(0.0,), (1.0,)]
    assert {h.low[1] for h in gears} == {h.high[1] for h in gears} == {0.0, 1.0}
    for h in gears:
        prior = h.prior(40.0)
        residual = RESIDUAL + COLUMNS[:, 1] * prior.centre[1]
        joint = marginal_of(residual, COLUMNS[:, :2], prior.width[:2])
        alone = np.eye(30) + prior.width[0]**2 * np.outer(COLUMNS[:, 0], COLUMNS[:, 0])
        direct = multivariate_normal(np.zeros(30), alone).logpdf(residual)
        assert evidence_of(joint) == pytest.approx(direct + 15.0 * np.log(2.0 * np.pi))


def test_parts_are_changed_by_their_deviation() -> None:
    parts = part_priors(REFERENCE, 0.1)
    names = [part.name for part in parts]
    values = np.zeros(len(parts))
    values[names.index('length_2')], values[names.index('strain_bias:strain_1b')] = 0.01, 2e-6
    values[names.index('position_strain_2a')] = 1e-3
    robot, sensors = with_deviations(REFERENCE, parts, values)
    assert robot.links[1].length == pytest.approx(REFERENCE.links[1].length * np.exp(0.01))
    assert robot.links[1].gauge_positions[0] == pytest.approx(
        REFERENCE.links[1].gauge_positions[0] + 1e-3)
    assert [(s.identifier, s.site, s.values) for s in sensors] == [
        ('strain_bias', 'strain_1b', (2e-6,))]


def numbers(robot: Robot) -> list[float]:
    """Return all numbers of links, drives, elbow and payload."""
    values = [value for part in (*robot.links, *robot.drives, robot)
              for value in vars(part).values() if np.asarray(value).dtype.kind in 'if']
    return [float(number) for value in values for number in np.ravel(value)]


def test_a_step_from_where_the_parts_are_ends_where_they_are_a_step_further() -> None:
    parts = [part for part in part_priors(REFERENCE, 0.1) if part.effect is None]
    there = 0.5 * np.array([part.tolerance for part in parts])
    robot, _ = with_deviations(REFERENCE, parts, there)
    for k, part in enumerate(parts):
        further = there + np.eye(len(parts))[k] * 0.2 * part.tolerance
        moved, expected = part.change(robot, 0.2 * part.tolerance), with_deviations(
            REFERENCE, parts, further)[0]
        assert moved != robot
        np.testing.assert_allclose(numbers(moved), numbers(expected), rtol=1e-12, atol=1e-15)


def test_a_part_is_far_off_where_no_effect_asked_says_so() -> None:
    parts = part_priors(REFERENCE, 0.1)
    far = parts_without_effect(REFERENCE, parts, tuple(catalogue()))
    assert {'link_mass_1', 'length_2', 'elbow_mass', 'position_strain_1a'} <= set(far)
    assert not {'stiffness_1', 'drive_damping_2', 'strain_gain:strain_1a', 'payload_mass:arm',
                'elbow_inertia', 'payload_inertia'} & set(far)
    others = [name for name in catalogue() if name not in ('drive_bandwidth', 'link_stiffness')]
    assert set(parts_without_effect(REFERENCE, parts, others)) - set(far) == {
        'stiffness_1', 'stiffness_2', 'drive_damping_1', 'drive_damping_2'}


def test_intervals_are_as_wide_as_windows_disagree() -> None:
    # A slope with errors that go with the motion: each window has a slope of its own.
    rng, found, stated = np.random.default_rng(11), [], []
    for _ in range(400):
        x, noise = rng.standard_normal((40, 50)), rng.standard_normal((40, 50))
        y = (2.0 + rng.standard_normal((40, 1))) * x + noise
        white = np.array([[1.0 / np.sum(x**2)]])
        slope = float(np.sum(x * y)) * white[0, 0]
        found.append(slope)
        scores = np.sum(x * (y - slope * x), axis=1)[None]
        wide = sandwich_covariance(white, scores)
        stated.append(wide[0, 0])
        assert wide[0, 0] > 10.0 * white[0, 0]
        assert sandwich_covariance(white, 0.0 * scores) == pytest.approx(white)
    assert np.sqrt(np.mean(stated)) == pytest.approx(np.std(found), rel=0.12)


def test_a_part_beyond_all_numbers_makes_no_prediction() -> None:
    """So that the hypothesis whose fit diverged is dropped, and not the whole diagnosis."""
    parts = part_priors(REFERENCE, 0.1)
    with pytest.raises(np.linalg.LinAlgError, match='no finite prediction'):
        with_deviations(REFERENCE, parts, np.full(len(parts), 1000.0))
