"""
The search step that refines sets: linearised around themselves, so that their evidence compares.

Sets are refined that may be the most probable, given how uncertain their fits are. Laws of unnamed
torques and parts that are not as their file says are tried on refined sets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.fit import (
    Fit,
    may_be_null,
    NOTABLE_EXCESS,
    with_far_part,
)
from flex_plant_sim.diagnosis.causes.posterior import SetKey
from flex_plant_sim.diagnosis.causes.refined_fit import GAIN_UNCERTAINTY, RefinedFit
from flex_plant_sim.diagnosis.causes.search_state import MAX_DEFICIT, SearchState
from flex_plant_sim.diagnosis.likelihood.prior import parts_without_effect
from flex_plant_sim.diagnosis.pool import attempt
from flex_plant_sim.diagnosis.prediction.latent_view import law_effect, torque_laws
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
import numpy as np

# Leading sets that are refined at a time; a budget.
MAX_REFINED_AT_ONCE = 3


def refine_leading(state: SearchState, centre: RefinedFit) -> None:
    """
    Refine the most probable sets that are not refined.

    Fits around the file's parts, see `RefinedFit.near_file_parts`, compare with one another alone.
    """
    fits = state.posterior().fits
    if centre.fit is not state.refined[SetKey.of(centre.fit)].fit:
        fits = tuple(fit for fit in fits if SetKey.of(fit).without_remainder not in state.refined)
    if fits:
        before = {SetKey.of(fit): state.score(fit) for fit in reversed(fits)
                  if SetKey.of(fit).without_remainder not in state.refined}
        refine_contenders(state, _one_of_each_set(fits)[:MAX_REFINED_AT_ONCE], fits[0], centre)
        _refine_followers(state, before)


def _one_of_each_set(fits: Sequence[Fit]) -> tuple[Fit, ...]:
    """Return the first fit of each set, whether it leaves a remainder or not."""
    found: dict[SetKey, Fit] = {}
    for fit in fits:
        found.setdefault(SetKey.of(fit).without_remainder, fit)
    return tuple(found.values())


def _refine_followers(state: SearchState, before: Mapping[SetKey, float]) -> None:
    """
    Refine sets that may lead if they gain by it what those refined already gained on average.

    Linearised around themselves, sets that were fitted around one centre gain alike, as far as
    such gains are known.
    """
    gains = [state.score(state.refined[key].fit) - score for key, score in before.items()
             if key in state.refined]
    if gains:
        gain = float(np.mean(gains))
        least = state.score(state.best.fit) - gain - max(MAX_DEFICIT, GAIN_UNCERTAINTY * gain)
        state.refine_each([state.fits[key] for key in sorted(
            (key for key, score in before.items() if key in state.fits and score > least
             and key not in state.refined and key == key.without_remainder),
            key=lambda key: -before[key])[:MAX_REFINED_AT_ONCE]])


def refine_alternatives(state: SearchState, best: RefinedFit, centre: RefinedFit) -> None:
    """Refine the most probable set without each of the causes of the best."""
    posterior, labels = state.posterior(), SetKey.of(best.fit).labels
    alternatives = {label: fit for fit in reversed(posterior.fits) for label in labels
                    if labels - SetKey.of(fit).labels == {label}}
    refine_contenders(state, tuple(alternatives.values()), posterior.best, centre)


def refine_without_null_causes(state: SearchState) -> None:
    """
    Refine leading sets without causes that gain though they may be null, from where they are.

    Refined from elsewhere, the smaller set may have ended in another optimum; a cause that does
    nothing then gains by its parts alone. (Beside a base that slides, a filter of 0.000 s gained
    3 nats; the base alone, refined from there, has 5 more.)
    """
    def gains(fit: Fit, label: str) -> bool:
        smaller = state.refined.get(SetKey.of(fit).without_remainder.without(label))
        return smaller is not None and state.score(fit) > state.score(smaller.fit)

    state.refine_smaller([
        (fit, k) for fit in state.posterior().fits[:MAX_REFINED_AT_ONCE]
        for k, cause in enumerate(fit.hypotheses)
        if may_be_null(fit, k) and gains(fit, cause.label)])


def refine_contenders(state: SearchState, fits: Sequence[Fit], best: Fit, centre: RefinedFit
                      ) -> None:
    """Refine those of some interpreted fits, around a centre, that may be the most probable."""
    least = state.score(best) - state.score_margin(best, centre, MAX_DEFICIT)
    refined = [found.fit for found in state.refined.values()]
    leading = dict.fromkeys(
        key for fit in fits for key in [SetKey.of(fit).without_remainder]
        if state.attainable_score(state.fits.get(key, fit)) >= least)
    # A set that cannot be refined is dropped.
    state.refine_each([
        state.fits.pop(key) for key in leading
        if key in state.fits and not any(state.fits[key] is fit for fit in refined)])


def try_far_parts(state: SearchState) -> None:
    """
    Re-evaluate the refined sets with each part not as its file says; refine those that may lead.

    The re-evaluation takes no pass, and its gain is uncertain by a share.
    """
    considered = {h.effect.identifier for h in state.catalogue}
    best = max(map(state.score, state.fits.values()))
    may_lead = []
    for centre in state.refined.values():
        parts = centre.likelihood.parts
        names = parts_without_effect(state.nominal.robot, parts, considered)
        found = max((with_far_part(centre.fit, part.name, k) for k, part in enumerate(parts)
                     if part.name in names), key=state.score, default=None)
        if found and state.score(found) > best - state.score_margin(found, centre, MAX_DEFICIT):
            may_lead.append(found)
    state.refine_each(may_lead)


def try_laws(state: SearchState, explored: RefinedFit) -> None:
    """
    Refine a set with laws of its remaining torques, where joint errors are too large.

    So a further cause has to explain more than tables of unnamed torques do. If the best set has
    laws that were found with other causes, it is refined with its own.
    """
    if not np.any(state.best.fit.error_scale[:2] > NOTABLE_EXCESS):
        return
    if not explored.fit.discrepancy.laws:
        _refine_with_laws(state, explored)
    best = state.best
    if best.fit.discrepancy.laws:
        state.keep_light_without_laws()
        if best.fit.hypotheses != explored.fit.hypotheses:
            _refine_with_laws(state, best)


def _refine_with_laws(state: SearchState, centre: RefinedFit) -> None:
    """
    Refine a set with the laws that hold for the torques it leaves, as tables.

    Only for joints whose errors are too large: the torque of another may be an echo, or a part
    within its tolerance. What the laws leave of the joints' errors are torques too.
    """
    state.progress('laws of unnamed torques', 0.9)
    base = centre.extended_model(state.nominal)
    found = torque_laws([Predictor(base, windows, noise) for windows, noise
                         in zip(state.data.locked, state.data.noise)])
    excessive = np.flatnonzero(centre.fit.error_scale[:2] > NOTABLE_EXCESS)
    sites = {f'joint_{k + 1}' for k in excessive}
    laws = [law for law in found if law.site in sites]
    if laws:
        discrepancy = replace(
            centre.fit.discrepancy, laws=tuple(map(law_effect, laws)),
            law_penalties=tuple(law.occam_penalty for law in laws),
            torque_share=remaining_torque_shares(centre.fit))
        error_scale = np.concatenate([np.ones(2), centre.fit.error_scale[2:]])
        state.progress('linearising with laws', 0.9)
        attempt(lambda candidate: state.refine(candidate, discrepancy, error_scale),
                CandidateSet.of(centre.fit))


def remaining_torque_shares(fit: Fit) -> tuple[float, float]:
    """
    Return the discrepancy's torque shares that explain the errors of the joints.

    Errors that are so many times as large as stated are slow torques that are so many times as
    large. A larger noise of the joint's sensor would hide fast motion that is well known.
    """
    first, second = np.multiply(fit.discrepancy.torque_share, np.maximum(fit.error_scale[:2], 1.0))
    return float(first), float(second)
