"""The posterior over sets of causes: prices, imitations, look-alikes, what was not fitted."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, Hypothesis
from flex_plant_sim.diagnosis.causes.neighbourhood import without_mean_error
from flex_plant_sim.diagnosis.causes.posterior import interpretations, log_prior, Posterior, SetKey
from flex_plant_sim.diagnosis.causes.refinement import _refine_followers
from flex_plant_sim.diagnosis.causes.search import SearchResult
from flex_plant_sim.diagnosis.causes.search_state import MAX_DEFICIT, SearchState
from flex_plant_sim.diagnosis.likelihood.evidence import ParameterPrior
from flex_plant_sim.diagnosis.likelihood.prior import (
    imitation_odds,
    log_prior_odds,
    PROBABILITY_UNKNOWN,
    unknown_odds,
)
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.verdict.doubt import doubt, unnamed_remainder
from flex_plant_sim.diagnosis.verdict.verdict import nothing_verdict
import numpy as np
import pytest
from scipy.stats import norm
from simulated_records import REFERENCE

NO_PRIOR = ParameterPrior(*np.zeros((6, 0)))
EMPTY = SufficientStatistics(np.zeros((1, 1, 1)), np.zeros(0), NO_PRIOR, np.zeros(0), 1.0,
                             np.zeros(1))
NOTHING = Fit((), DiscrepancyModel(), np.zeros(0), np.zeros(0), np.ones(1), np.eye(1), EMPTY, 0.0)


def hypothesis(label: str) -> Hypothesis:
    """Return the first hypothesis of a label about the reference robot."""
    return next(h for h in all_hypotheses(REFERENCE) if h.label == label)


def test_hypotheses_of_two_fixed_values_both_stand_in_the_posterior_under_one_name() -> None:
    gears = [h for h in all_hypotheses(REFERENCE) if h.label == 'gear_compliance:joint_1']
    one, other = (SetKey.of(replace(NOTHING, hypotheses=(h,))) for h in gears)
    assert one != other and one.labels == other.labels


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


def test_two_causes_at_one_place_are_one_more_than_two_apart() -> None:
    base, real = BaseModel(REFERENCE), [1.0 / (1.0 + imitation_odds(k)) for k in range(2)]
    for labels, further in ((('joint_spring:joint_2', 'torque_ripple:joint_2'), 1),
                            (('joint_spring:joint_2', 'torque_ripple:joint_1'), 0),
                            (('payload_mass:arm', 'air_drag:arm'), 0)):
        found = Posterior.of([replace(NOTHING, hypotheses=tuple(map(hypothesis, labels)))], base)
        for label in labels:
            assert found.effect_probability(label.partition(':')[0]) == pytest.approx(
                real[further])
        assert bool(doubt(found)) == bool(further)


def test_the_more_is_wrong_at_once_the_likelier_one_unknown_thing_imitates_it() -> None:
    names = 'coulomb_friction', 'viscous_friction', 'torque_ripple', 'actuator_bias', 'motor_lag'
    on = tuple(hypothesis(f'{name}:joint_{1 + k % 2}') for k, name in enumerate(names))
    base = BaseModel(REFERENCE)
    stated = [Posterior.of([replace(NOTHING, hypotheses=on[:k])], base) for k in range(1, 6)]
    chances = [p.effect_probability('coulomb_friction') for p in stated]
    real = [1.0 / (1.0 + imitation_odds(further)) for further in range(3)]
    # What more than two further faults would do is not known.
    assert chances == pytest.approx([real[0], real[0], real[1], real[2], real[2]])
    # It is one thing that imitates the whole set.
    assert [p.unknown_probability for p in stated] == pytest.approx(
        [1.0 - r for r in (real[0], *real, real[2])])
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


@pytest.mark.parametrize(('gained', 'ahead', 'asked'), [
    (14.0, 10.0 + MAX_DEFICIT, True), (2.0, 10.0 + MAX_DEFICIT, False),
    # What refinement gains is known to three tenths of it.
    (40.0, 48.0, True), (20.0, 28.0, False)])
def test_what_may_lead_with_what_refinement_gained_others_is_refined_too(
        gained: float, ahead: float, asked: bool) -> None:
    base = BaseModel(REFERENCE)
    clamp, gear = (replace(NOTHING, hypotheses=(hypothesis(label),), log_evidence=found)
                   for label, found in (('clamp_compliance:link_2', 9.0),
                                        ('gear_compliance:joint_2', 8.0)))
    before = {SetKey.of(fit): fit.log_evidence for fit in (clamp, gear)}
    best = SimpleNamespace(fit=replace(clamp, log_evidence=clamp.log_evidence + gained))
    # Of refined sets another may be above what the gear was fitted to.
    other = SimpleNamespace(fit=replace(NOTHING, log_evidence=8.0 + ahead))
    taken: list[Fit] = []
    state = SimpleNamespace(score=lambda fit: fit.log_evidence, best=max(
        (best, other), key=lambda found: found.fit.log_evidence), refine_each=taken.extend,
        refined={SetKey.of(clamp): best}, fits={SetKey.of(fit): fit for fit in (clamp, gear)},
        nominal=base)
    _refine_followers(cast(SearchState, state), before)
    assert (taken == [gear]) == asked


def test_slow_errors_of_a_gauge_are_not_those_of_a_cause_alone() -> None:
    base, h = BaseModel(REFERENCE), hypothesis('payload_mass:arm')
    # One channel of all samples as stated; its means over a while three times too large.
    cause = replace(NOTHING, hypotheses=(h,), log_evidence=50.0,
                    statistics=replace(EMPTY, samples=3000.0))
    slow = replace(cause, slow_scale=np.array([3.0]), slow_means=np.array([60]))
    assert not Posterior.of([NOTHING, cause], base).best.discrepancy.remainder
    assert Posterior.of([NOTHING, slow], base).best.discrepancy.remainder
    few = replace(slow, slow_scale=np.array([1.1]))
    assert not Posterior.of([NOTHING, few], base).best.discrepancy.remainder


@pytest.mark.parametrize(('scale', 'slow', 'gain', 'varies'), [
    (1.0, 0.3, 9.0, True), (1.0001, 1.0001, 9.0, True), (1.2, 0.3, 9.0, False),
    (1.0, 1.2, 9.0, False), (1.04, 0.3, 0.0, False)])
def test_a_cause_that_varies_is_said_where_no_errors_are_large(
        scale: float, slow: float, gain: float, varies: bool) -> None:
    """As large as stated to a part in ten thousand, errors were told as what remains."""
    cause = replace(NOTHING, hypotheses=(hypothesis('payload_mass:arm'),), varying_gain=gain,
                    discrepancy=replace(NOTHING.discrepancy, remainder=True),
                    error_scale=np.array([scale, 1.0]), slow_scale=np.array([slow]),
                    slow_means=np.array([60]))
    found = SimpleNamespace(best=SimpleNamespace(fit=cause), posterior=Posterior.of(
        [cause], BaseModel(REFERENCE)))
    said = unnamed_remainder(cast(SearchResult, found))
    assert ('not equally large throughout' in said) == varies
    assert ('Something unnamed remains' in said) != varies


def test_what_was_not_fitted_counts_with_its_estimated_evidence() -> None:
    cause = replace(NOTHING, hypotheses=(hypothesis('payload_mass:arm'),), log_evidence=6.0)
    unfitted = {frozenset({'payload_mass:arm'}): 99.0, frozenset({'air_drag:arm'}): -1.0}
    found = Posterior.of([NOTHING, cause], BaseModel(REFERENCE), unfitted)
    assert found.effect_probability('air_drag') * (1.0 + imitation_odds()) == pytest.approx(
        np.exp(-1.0) * found.nothing_probability)
    causes = sum(found.effect_probability(name) for name in ('air_drag', 'payload_mass'))
    assert found.nothing_probability + causes + found.unknown_probability == pytest.approx(1.0)


def test_what_was_not_fitted_beside_a_set_with_a_remainder_has_one_too() -> None:
    unfitted, base = {frozenset({'air_drag:arm'}): 0.0}, BaseModel(REFERENCE)
    remainder = replace(NOTHING, discrepancy=replace(base.discrepancy, remainder=True))
    shares = [Posterior.of([NOTHING], base, unfitted, beside).effect_probability('air_drag')
              for beside in (NOTHING, remainder)]
    assert shares == pytest.approx([0.5 / (1.0 + imitation_odds(k)) for k in (0, 1)])


def test_a_cause_that_the_record_does_not_show_is_no_fault_more_to_imitate() -> None:
    base, names = BaseModel(REFERENCE), ('coulomb_friction:joint_1', 'strain_gain:strain_1a')
    pair = replace(NOTHING, hypotheses=tuple(map(hypothesis, names)))
    third = {frozenset({*names, 'torque_ripple:joint_2'}): NOTHING.log_evidence}
    alone, beside = Posterior.of([pair], base), Posterior.of([pair], base, third, pair)
    assert beside.effect_probability('torque_ripple') > 0.0
    for name in ('coulomb_friction', 'strain_gain'):
        assert beside.effect_probability(name) == pytest.approx(alone.effect_probability(name))


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


def test_where_only_something_unnamed_competes_no_names_are_to_be_told_apart() -> None:
    unnamed = replace(NOTHING, discrepancy=replace(NOTHING.discrepancy, remainder=True))
    for gain in np.linspace(0.0, 8.0, 33):
        posterior = Posterior.of([NOTHING, replace(unnamed, log_evidence=gain)],
                                 BaseModel(REFERENCE))
        verdict, sentence, sets = nothing_verdict(posterior, ())
        if verdict == 'cannot_tell':
            break
    assert verdict == 'cannot_tell' and 'something unnamed' in sentence and sets == ()


def test_many_unlikely_names_are_counted_and_not_listed() -> None:
    one_each = {h.label: h for h in all_hypotheses(REFERENCE)}.values()
    fits = [replace(NOTHING, hypotheses=(h,), log_evidence=3.0 - log_prior_odds(
        h.effect, REFERENCE)) for h in one_each]
    _, sentence, (names,) = nothing_verdict(
        Posterior.of([NOTHING, *fits], BaseModel(REFERENCE)), ())
    assert len(names) <= 7 and names[0] == 'nothing'
    assert 'more, less likely' in sentence and sentence.count('%') == 6


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


def plain_fit(scale: tuple[float, ...], samples: int = 4) -> Fit:
    """Return a fit without causes and parts whose errors are so much larger than stated."""
    statistics = SufficientStatistics(
        np.zeros((len(scale), 1, 1)), np.zeros(0), ParameterPrior(*np.zeros((6, 0))), np.zeros(0),
        samples, np.zeros(len(scale)))
    return Fit((), DiscrepancyModel(remainder=True), np.zeros(0), np.zeros(0), np.array(scale),
               np.zeros((0, 0)), statistics, -7.0)


def test_a_set_pays_what_white_errors_as_large_are_less_likely() -> None:
    errors, scale = np.random.default_rng(8).standard_normal(50), (1.0, 1.7, 1.2)
    errors /= np.sqrt(np.mean(errors**2))

    def lost(s: float) -> float:
        """Return the log-ratio at the likeliest noise, 1.6 over the root of all samples unsure."""
        noises = np.exp(np.linspace(0.0, np.log(s), 20001))
        unsure = norm.pdf(np.log(noises), scale=1.6 / np.sqrt(50 / 0.75))
        at_each = np.sum(norm.logpdf(s * errors[:, None], scale=noises), axis=0)
        return float(np.max(at_each + np.log(unsure / unsure[0]))
                     - np.sum(norm.logpdf(s * errors, scale=s)))

    dear = sum(map(lost, scale))
    assert dear < -3.0
    fit = replace(plain_fit(scale, 50), discrepancy=DiscrepancyModel(), varying_gain=2.0)
    whole, more = interpretations(fit)
    assert whole.log_evidence == pytest.approx(-7.0 + dear, abs=1e-5)
    assert not whole.discrepancy.remainder
    # A remainder shows in the errors, as surely as they are not just white, or in a change.
    shows = 1.0 - np.exp(dear)
    assert more.log_evidence == pytest.approx(-7.0 + np.log(shows + np.exp(2.0)), abs=1e-5)
    assert more.discrepancy.remainder
    holding = replace(fit, varying_gain=-3.0)
    assert interpretations(holding)[1].log_evidence == pytest.approx(
        -7.0 + np.log(shows + np.exp(-3.0)), abs=1e-5)
    # Errors as stated show none, and hardly larger ones hardly any.
    for near in (1.0, 1.0 + 1e-9):
        found = interpretations(replace(holding, error_scale=np.full(3, near)))
        assert [f.log_evidence for f in found] == pytest.approx([-7.0, -10.0])
    small = replace(fit, error_scale=np.ones(3))
    plain = replace(small, varying_gain=-np.inf)
    assert interpretations(plain) == (plain,)


def test_a_far_part_that_leaves_a_remainder_is_two_unknown_things() -> None:
    base = BaseModel(REFERENCE)
    one = replace(NOTHING, statistics=replace(EMPTY, tolerances=np.ones(30)),
                  discrepancy=replace(base.discrepancy, far_part='mass_1'))
    two = replace(one, discrepancy=replace(one.discrepancy, remainder=True))
    assert log_prior(one, base) == pytest.approx(np.log(0.5 * unknown_odds() / 30.0))
    assert log_prior(two, base) == pytest.approx(
        log_prior(one, base) + np.log(0.5 * unknown_odds()))
    assert log_prior(NOTHING, base) == 0.0
