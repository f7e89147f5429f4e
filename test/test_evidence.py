"""One likelihood and one prior, on problems whose answers have closed forms."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.diagnosis.causes.fit import Causes, Fit, fitted
from flex_plant_sim.diagnosis.causes.hypothesis import hypotheses, Hypothesis
from flex_plant_sim.diagnosis.causes.posterior import Posterior
from flex_plant_sim.diagnosis.likelihood.evidence import detectable, Marginal, Slab
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import (
    ANY_CAUSE,
    deviated,
    log_odds,
    part_priors,
    prior_table,
)
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude
from flex_plant_sim.diagnosis.prediction.noise import steady_filter
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.effects import catalogue, sites
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import solve_discrete_are
from scipy.stats import multivariate_normal, norm
from simulated_records import effects, REFERENCE, simulated

RNG = np.random.default_rng(7)
COLUMNS, PRIOR = RNG.standard_normal((30, 4)), np.array([0.5, 1.0, 2.0, 1e-9])
RESIDUAL = RNG.standard_normal(30) + COLUMNS @ np.array([0.4, -1.0, 2.5, 0.0])
NOTHING = Fit((), Amplitude(), np.zeros(0), np.zeros(0), np.ones(1), np.eye(1), 0.0)


def test_evidence_is_that_of_the_gaussian_it_stands_for() -> None:
    marginal = Marginal(COLUMNS, PRIOR)
    whole = np.eye(30) + COLUMNS @ np.diag(PRIOR**2) @ COLUMNS.T
    direct = multivariate_normal(np.zeros(30), whole).logpdf(RESIDUAL)
    assert marginal.log_evidence(RESIDUAL) - 15.0 * np.log(2.0 * np.pi) == pytest.approx(
        direct, rel=1e-12)


def test_posterior_of_the_parts_is_that_of_ridge_regression() -> None:
    marginal = Marginal(COLUMNS, PRIOR)
    precision = COLUMNS.T @ COLUMNS + np.diag(PRIOR**-2.0)
    # The residual is what is left: r = e + J b is explained by b of the other sign.
    assert marginal.mean(RESIDUAL) == pytest.approx(
        -np.linalg.solve(precision, COLUMNS.T @ RESIDUAL), rel=1e-6, abs=1e-12)
    assert marginal.covariance == pytest.approx(np.linalg.inv(precision), rel=1e-6, abs=1e-12)


def test_columns_in_front_are_as_good_as_columns_from_the_start() -> None:
    whole = Marginal(COLUMNS, PRIOR)
    joined = Marginal(COLUMNS[:, 2:], PRIOR[2:]).joined(COLUMNS[:, :2], PRIOR[:2])
    assert joined.log_evidence(RESIDUAL) == pytest.approx(whole.log_evidence(RESIDUAL))
    assert joined.mean(RESIDUAL) == pytest.approx(whole.mean(RESIDUAL))


def test_a_prediction_that_is_not_finite_has_no_evidence() -> None:
    assert Marginal(COLUMNS, PRIOR).log_evidence(RESIDUAL * np.inf) == -np.inf


def test_a_one_sided_slab_keeps_the_mass_on_its_side() -> None:
    column, width = COLUMNS[:, :1], 0.7
    marginal = Marginal(column, np.array([width]))

    def density(theta: float) -> float:
        left = RESIDUAL + column[:, 0] * theta
        prior = 2.0 * norm.pdf(theta, scale=width)
        return float(np.exp(-0.5 * left @ left + 0.5 * RESIDUAL @ RESIDUAL) * prior)

    slab = Slab(np.zeros(1), np.array([width]), np.array([-1.0]))
    inside = slab.log_inside(marginal.mean(RESIDUAL), np.diagonal(marginal.covariance))
    assert marginal.log_evidence(RESIDUAL) + 0.5 * RESIDUAL @ RESIDUAL + inside == pytest.approx(
        np.log(quad(density, -8.0, 0.0)[0]), abs=1e-6)


def test_the_evidence_turns_at_the_detection_limit() -> None:
    column, width, price = COLUMNS[:, 0], 3.0, 5.0
    size = detectable(float(column @ column), width, price)
    effect, nothing = Marginal(column[:, None], np.array([width])), Marginal(
        np.zeros((30, 0)), np.zeros(0))
    draws = RNG.standard_normal((4000, 30)) + size * column
    gained = [effect.log_evidence(r) - nothing.log_evidence(r) for r in draws]
    assert np.mean(gained) == pytest.approx(price, abs=5.0 * np.std(gained) / np.sqrt(4000))


def test_the_odds_leave_the_chance_of_no_cause_that_is_stated() -> None:
    none = 1.0
    for effect in catalogue().values():
        odds = len(sites(effect, REFERENCE)) * np.exp(log_odds(effect, REFERENCE))
        none /= 1.0 + odds
    assert none == pytest.approx(1.0 - ANY_CAUSE)


def hypothesis(label: str) -> Hypothesis:
    """Return a hypothesis about the reference robot."""
    found, = (h for h in hypotheses(REFERENCE) if h.label == label)
    return found


def test_probabilities_follow_evidence_and_price() -> None:
    base, h = Base(REFERENCE), hypothesis('payload_mass:arm')
    cause = replace(NOTHING, hypotheses=(h,), log_evidence=6.0)
    found = Posterior.of([NOTHING, cause], base)
    odds = np.exp(6.0 + log_odds(h.effect, REFERENCE))
    assert found.of_effect('payload_mass') == pytest.approx(odds / (1.0 + odds))
    assert found.of_nothing == pytest.approx(1.0 / (1.0 + odds))
    assert found.of_unknown == 0.0


def test_a_credible_set_holds_what_may_stand_in_a_cause_s_place() -> None:
    a, b, c = (hypothesis(f'{name}:joint_1') for name in (
        'coulomb_friction', 'stribeck_friction', 'viscous_friction'))
    fits = [replace(NOTHING, hypotheses=(h,), log_evidence=e) for h, e in (
        (a, 50.0), (b, 49.0), (c, 30.0))]
    found = Posterior.of([NOTHING, *fits], Base(REFERENCE))
    assert found.credible(a.label) == (a.label, b.label)


def test_steady_filter_solves_the_riccati_equation() -> None:
    arm = Base(REFERENCE).arm(REFERENCE.payload_mass)
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
    robot, sensors = deviated(REFERENCE, parts, values)
    assert robot.links[1].length == pytest.approx(REFERENCE.links[1].length * np.exp(0.01))
    assert robot.links[1].gauge_positions[0] == pytest.approx(
        REFERENCE.links[1].gauge_positions[0] + 1e-3)
    assert [(s.identifier, s.site, s.values) for s in sensors] == [
        ('strain_bias', 'strain_1b', (2e-6,))]
    assert all(name in prior_table(REFERENCE) for name in [*names, *catalogue()])


def test_a_cause_is_fitted_with_the_evidence_that_its_slab_leaves() -> None:
    hidden = effects('actuator_gain:joint_2:factor=1.2')
    nature = catalogue()['coriolis_centripetal']('arm', (1.0,))
    record = simulated((nature, *hidden), 30.0)
    base = Base(REFERENCE, effects=(nature,))
    data = Data.of([record], 10.0, REFERENCE.sample_time)
    likelihood = Likelihood(base, data.windows, data.noise)
    causes = Causes((hypothesis('actuator_gain:joint_2'),), data.duration)
    found = fitted(likelihood, causes, (np.array([1.1]),))
    nothing = fitted(likelihood, Causes((), data.duration), (np.zeros(0),))
    sure = 1.96 * np.sqrt(found.covariance[0, 0])
    assert abs(found.values[0] - 1.2) < max(sure, 0.01)
    assert found.log_evidence > nothing.log_evidence + 20.0
