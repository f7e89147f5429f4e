"""One likelihood and one prior, on problems whose answers have closed forms."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.gauss_newton import fit_set
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.neighbourhood import without_mean_error
from flex_plant_sim.diagnosis.causes.posterior import Posterior, SetKey
from flex_plant_sim.diagnosis.likelihood.evidence import (
    channel_products,
    detectable_size,
    GaussianMarginal,
    ParameterPrior,
    sandwich_covariance,
)
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import (
    imitation_odds,
    log_prior_odds,
    part_priors,
    parts_without_effect,
    PROBABILITY_ANY_CAUSE,
    PROBABILITY_UNKNOWN,
    unknown_odds,
    with_deviations,
)
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.prediction.noise import steady_filter
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.verdict.verdict import doubt, nothing_verdict
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import solve_discrete_are
from scipy.stats import multivariate_normal, norm
from simulated_records import effects, REFERENCE, simulated

RNG = np.random.default_rng(7)
COLUMNS, PRIOR_WIDTHS = RNG.standard_normal((30, 4)), np.array([0.5, 1.0, 2.0, 1e-9])
RESIDUAL = RNG.standard_normal(30) + COLUMNS @ np.array([0.4, -1.0, 2.5, 0.0])
PRIOR = ParameterPrior(np.array([1.0]), np.array([0.7]), np.zeros(1), np.zeros(1, bool))
NO_PRIOR = ParameterPrior(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, bool))
EMPTY = SufficientStatistics(np.zeros((1, 1, 1)), np.zeros(0), NO_PRIOR, np.zeros(0), 1.0,
                             np.zeros(1))
NOTHING = Fit((), DiscrepancyModel(), np.zeros(0), np.zeros(0), np.ones(1), np.eye(1), EMPTY, 0.0)


def test_evidence_is_that_of_the_gaussian_it_stands_for() -> None:
    marginal = GaussianMarginal.of(RESIDUAL, COLUMNS, PRIOR_WIDTHS)
    whole = np.eye(30) + COLUMNS @ np.diag(PRIOR_WIDTHS**2) @ COLUMNS.T
    direct = multivariate_normal(np.zeros(30), whole).logpdf(RESIDUAL)
    assert marginal.log_evidence - 15.0 * np.log(2.0 * np.pi) == pytest.approx(
        direct, rel=1e-12)


def test_posterior_of_the_parts_is_that_of_ridge_regression() -> None:
    marginal = GaussianMarginal.of(RESIDUAL, COLUMNS, PRIOR_WIDTHS)
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
    assert found.log_evidence - paid == pytest.approx(tempered - paid, rel=1e-10)
    # At the optimum Laplace's method is exact.
    best = replace(statistics(), offsets=found.mean[:1])
    move = np.eye(5)
    move[1, 0] = found.mean[0] - 0.2
    best = replace(best, products=move.T @ statistics().products @ move)
    assert best.log_evidence(scale, temper) == pytest.approx(found.log_evidence - paid)


def test_the_scale_is_the_likeliest_and_never_below_one() -> None:
    bare = replace(statistics(3.0), tolerances=np.full(3, 1e-9))
    power = np.sum((3.0 * RESIDUAL.reshape(2, 15))**2, axis=1)
    assert bare.likeliest_error_scale() == pytest.approx(np.sqrt(power / 15.0), rel=1e-6)
    assert statistics(1e-3).likeliest_error_scale() == pytest.approx([1.0, 1.0])


def test_a_prediction_that_is_not_finite_has_no_evidence() -> None:
    with np.errstate(invalid='ignore'):
        marginal = GaussianMarginal.of(RESIDUAL * np.inf, COLUMNS, PRIOR_WIDTHS)
    assert marginal.log_evidence == -np.inf


def test_a_one_sided_prior_keeps_the_mass_on_its_side() -> None:
    column, width = COLUMNS[:, :1], 0.7
    marginal = GaussianMarginal.of(RESIDUAL, column, np.array([width]))

    def density(theta: float) -> float:
        left = RESIDUAL + column[:, 0] * theta
        prior = 2.0 * norm.pdf(theta, scale=width)
        return float(np.exp(-0.5 * left @ left + 0.5 * RESIDUAL @ RESIDUAL) * prior)

    prior = ParameterPrior(np.zeros(1), np.array([width]), np.array([-1.0]), np.zeros(1, bool))
    inside = prior.log_truncation(marginal.mean, np.diagonal(marginal.covariance))
    assert marginal.log_evidence + 0.5 * RESIDUAL @ RESIDUAL + inside == pytest.approx(
        np.log(quad(density, -8.0, 0.0)[0]), abs=1e-6)


def test_a_shape_that_nature_may_lack_is_absent_as_likely_as_not() -> None:
    """One value, known badly and near its centre of 1, with half of its prior at 1."""
    column, width, value = 0.3 * COLUMNS[:, 0], 0.7, 1.1
    spiked = ParameterPrior(np.ones(1), np.array([width]), np.zeros(1), np.ones(1, bool))

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
    gained = [GaussianMarginal.of(r, column[:, None], np.array([width])).log_evidence + 0.5 * r @ r
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
    found = []
    for h in gears:
        prior = h.prior(40.0)
        residual = RESIDUAL + COLUMNS[:, 1] * prior.centre[1]
        joint = GaussianMarginal.of(residual, COLUMNS[:, :2], prior.width[:2])
        alone = np.eye(30) + prior.width[0]**2 * np.outer(COLUMNS[:, 0], COLUMNS[:, 0])
        direct = multivariate_normal(np.zeros(30), alone).logpdf(residual)
        assert joint.log_evidence == pytest.approx(direct + 15.0 * np.log(2.0 * np.pi))
        found.append(SetKey.of(replace(NOTHING, hypotheses=(h,))))
    # Both stand in the posterior, under one name.
    assert found[0] != found[1] and found[0].labels == found[1].labels


def hypothesis(label: str) -> Hypothesis:
    """Return a hypothesis about the reference robot."""
    found, = (h for h in all_hypotheses(REFERENCE) if h.label == label)
    return found


def test_probabilities_follow_evidence_and_price() -> None:
    base, h = BaseModel(REFERENCE), hypothesis('payload_mass:arm')
    cause = replace(NOTHING, hypotheses=(h,), log_evidence=6.0)
    found = Posterior.of([NOTHING, cause], base)
    odds = np.exp(6.0 + log_prior_odds(h.effect, REFERENCE))
    like_it, real = odds / (1.0 + odds), 1.0 / (1.0 + imitation_odds())
    assert found.effect_probability('payload_mass') == pytest.approx(like_it * real)
    assert found.nothing_probability == pytest.approx(1.0 / (1.0 + odds))
    assert found.unknown_probability == pytest.approx(like_it * (1.0 - real))
    # What is unknown is as likely as stated, whether it looks like a cause or not.
    some = sum(np.exp(log_prior_odds(h.effect, REFERENCE)) for h in all_hypotheses(REFERENCE))
    assert some * imitation_odds() + unknown_odds() == pytest.approx(
        PROBABILITY_UNKNOWN / (1.0 - PROBABILITY_UNKNOWN))


def test_the_more_is_wrong_at_once_the_likelier_one_unknown_thing_imitates_it() -> None:
    labels = [f'{name}:joint_1' for name in (
        'coulomb_friction', 'viscous_friction', 'torque_ripple', 'actuator_bias', 'motor_lag')]
    on = tuple(hypothesis(label) for label in labels)
    base = BaseModel(REFERENCE)
    stated = [Posterior.of([replace(NOTHING, hypotheses=on[:k])], base) for k in range(1, 6)]
    chances = [p.effect_probability('coulomb_friction') for p in stated]
    real = [1.0 / (1.0 + imitation_odds(further)) for further in range(3)]
    # What more than two further faults would do is not known.
    assert chances == pytest.approx([real[0], real[0], real[1], real[2], real[2]])
    assert [p.unknown_probability for p in stated] == pytest.approx(
        [1.0 - r**k for r, k in zip((real[0], *real, real[2]), range(1, 6))])
    assert [bool(doubt(p)) for p in stated] == [False, False, True, True, True]
    # Something unnamed besides is one more fault.
    besides = Posterior.of([replace(NOTHING, hypotheses=on[:1],
                                    discrepancy=replace(base.discrepancy, remainder=True))], base)
    assert besides.effect_probability('coulomb_friction') == pytest.approx(real[1])


def test_errors_larger_than_every_model_s_are_not_those_of_a_cause_alone() -> None:
    base, h = BaseModel(REFERENCE), hypothesis('payload_mass:arm')
    cause = replace(NOTHING, hypotheses=(h,), log_evidence=50.0)
    loud = replace(cause, error_scale=np.array([1.1]), statistics=replace(EMPTY, samples=3000.0))
    found = Posterior.of([NOTHING, loud], base)
    assert found.best.discrepancy.remainder and found.best.hypotheses == (h,)
    quiet = replace(loud, statistics=replace(EMPTY, samples=3.0))
    assert not Posterior.of([NOTHING, quiet], base).best.discrepancy.remainder


def test_what_was_not_fitted_counts_with_its_linear_evidence() -> None:
    cause = replace(NOTHING, hypotheses=(hypothesis('payload_mass:arm'),), log_evidence=6.0)
    unfitted = {frozenset({'payload_mass:arm'}): 99.0, frozenset({'air_drag:arm'}): -1.0}
    found = Posterior.of([NOTHING, cause], BaseModel(REFERENCE), unfitted)
    assert found.effect_probability('air_drag') * (1.0 + imitation_odds()) == pytest.approx(
        np.exp(-1.0) * found.nothing_probability)
    causes = sum(found.effect_probability(name) for name in ('air_drag', 'payload_mass'))
    assert found.nothing_probability + causes + found.unknown_probability == pytest.approx(1.0)


def test_what_was_not_fitted_beside_a_set_with_a_remainder_has_one_too() -> None:
    unfitted = {frozenset({'air_drag:arm'}): 0.0}
    shares = [Posterior.of([NOTHING], BaseModel(REFERENCE), unfitted, unknown).effect_probability(
        'air_drag') for unknown in (False, True)]
    assert shares == pytest.approx([0.5 / (1.0 + imitation_odds(k)) for k in (0, 1)])


def test_what_was_not_fitted_is_as_far_off_as_what_was() -> None:
    a, b, c, d = (frozenset({name}) for name in 'abcd')
    # Beside the file's parts nothing scored 12: of two neighbours one nat and three were too many.
    estimates = {a: 14.0, b: 13.0, c: 12.5}
    assert without_mean_error(estimates, {a: 13.0, b: 10.0, d: 99.0}) == {
        c: pytest.approx(12.5 - 2.0)}
    assert without_mean_error(estimates, {d: 99.0}) == estimates


def test_nothing_is_not_stated_where_something_is_likelier() -> None:
    alike = [replace(NOTHING, hypotheses=(h,), log_evidence=-log_prior_odds(h.effect, REFERENCE))
             for h in map(hypothesis, ('coulomb_friction:joint_1', 'air_drag:arm'))]
    fits = [replace(NOTHING, log_evidence=0.5), *alike]
    verdict, sentence, sets = nothing_verdict(Posterior.of(fits, BaseModel(REFERENCE)), ())
    assert verdict == 'cannot_tell' and set(sets[0]) == {
        'nothing', 'coulomb_friction', 'air_drag'}
    assert 'nothing 45 %' in sentence and 'something unnamed' in sentence
    fits[0] = replace(NOTHING, log_evidence=0.9)
    assert nothing_verdict(Posterior.of(fits, BaseModel(REFERENCE)), ())[0] == 'nothing_wrong'


def test_a_credible_set_holds_what_may_stand_in_a_cause_s_place() -> None:
    a, b, c = (hypothesis(f'{name}:joint_1') for name in (
        'coulomb_friction', 'stribeck_friction', 'viscous_friction'))
    fits = [replace(NOTHING, hypotheses=(h,), log_evidence=e) for h, e in (
        (a, 50.0), (b, 49.0), (c, 30.0))]
    found = Posterior.of([NOTHING, *fits], BaseModel(REFERENCE))
    assert found.credible_alternatives(a.label) == (a.label, b.label)


def test_what_stands_beside_a_cause_is_no_look_alike() -> None:
    a, b = hypothesis('coulomb_friction:joint_1'), hypothesis('viscous_friction:joint_1')
    fits = [replace(NOTHING, hypotheses=on, log_evidence=e) for on, e in (
        ((a,), 50.0), ((a, b), 53.0), ((b,), 10.0))]
    found = Posterior.of([NOTHING, *fits], BaseModel(REFERENCE))
    assert found.probability[1] > 0.1 and found.credible_alternatives(a.label) == (a.label,)


def test_steady_filter_solves_the_riccati_equation() -> None:
    arm = BaseModel(REFERENCE).arm(REFERENCE.payload_mass)
    noise = np.array([1e-4, 1e-4, 5e-7, 5e-7, 5e-7, 5e-7])
    force = np.full(arm.form.order, 1e-4)
    steady, n = steady_filter(arm, force, noise), arm.states
    # At an end of the schedule, where a Riccati equation is solved itself.
    table, c = arm.schedule.table[0].reshape(n, -1), arm.output_matrix
    f, e = table[:, :n], table[:, n + 2:]
    p = solve_discrete_are(f.T, c.T / noise, (e * force) @ e.T, np.eye(noise.size))
    s = c @ p @ c.T + np.diag(noise**2)
    assert steady.gain[0] == pytest.approx(f @ p @ c.T @ np.linalg.inv(s), rel=1e-5, abs=1e-9)
    whitened = steady.whitener[0] @ s @ steady.whitener[0].T
    assert whitened == pytest.approx(np.eye(noise.size), abs=1e-5)


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


def test_a_part_is_far_off_where_no_effect_asked_says_so() -> None:
    parts = part_priors(REFERENCE, 0.1)
    far = parts_without_effect(REFERENCE, parts, tuple(catalogue()))
    assert {'link_mass_1', 'length_2', 'elbow_mass', 'position_strain_1a'} <= set(far)
    assert not {'stiffness_1', 'drive_damping_2', 'strain_gain:strain_1a', 'payload_mass:arm',
                'elbow_inertia', 'payload_inertia'} & set(far)
    others = [name for name in catalogue() if name not in ('drive_bandwidth', 'link_stiffness')]
    assert set(parts_without_effect(REFERENCE, parts, others)) - set(far) == {
        'stiffness_1', 'stiffness_2', 'drive_damping_1', 'drive_damping_2'}


def test_a_cause_is_fitted_with_the_evidence_that_its_prior_leaves() -> None:
    hidden = effects('actuator_gain:joint_2:factor=1.2')
    nature = catalogue()['coriolis_centripetal']('arm', (1.0,))
    record = simulated((nature, *hidden), 30.0)
    base = BaseModel(REFERENCE, effects=(nature,))
    data = Data.of([record], 10.0, REFERENCE.sample_time)
    likelihood = Likelihood(base, data.windows, data.noise)
    causes = CauseSet((hypothesis('actuator_gain:joint_2'),), data.duration)
    found = fit_set(likelihood, causes, (np.array([1.1]),))
    nothing = fit_set(likelihood, CauseSet((), data.duration), (np.zeros(0),))
    sure = 1.96 * np.sqrt(found.covariance[0, 0])
    assert abs(found.values[0] - 1.2) < max(sure, 0.01)
    assert found.log_evidence > nothing.log_evidence + 20.0


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
