"""
A set whose neighbours were fitted, and the scores that are estimated of those that were not.

`search` keeps one for each set that it explored; the posterior counts what was not fitted too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.posterior import SetKey
from flex_plant_sim.diagnosis.causes.proposal import Proposal
from flex_plant_sim.diagnosis.causes.search_state import SearchState
import numpy as np

# Scores of sets by the labels of their causes, nats.
Scores = Mapping[frozenset[str], float]


@dataclass(frozen=True)
class Neighbourhood:
    """
    A set and the proposals beside it.

    Attributes
    ----------
    centre : Fit
        The set, as it was linearised for the proposals; see `RefinedFit.near_file_parts`.
    proposals : tuple of Proposal
        Of all other hypotheses, the best first.

    """

    centre: Fit
    proposals: tuple[Proposal, ...]

    def as_read(self, state: SearchState) -> Fit:
        """Return the set as its score counts it: complete, or with something unknown."""
        return state.best_interpretation(self.centre)

    def unfitted_scores(self, state: SearchState) -> Scores:
        """
        Return the scores of sets with one cause more that were not fitted to all windows, nats.

        A coarse fit tells what it gained. What deserved none is taken to gain nothing: it costs
        its prior odds and its freedom. (Linear gains promise 20 to 120 nats of which fits keep
        none.)
        """
        key, base = SetKey.of(self.centre), state.best_score(self.centre)
        known: dict[frozenset[str], float] = {}
        for fit in state.fits.values():
            if fit.discrepancy == self.centre.discrepancy:
                labels = SetKey.of(fit).labels
                known[labels] = max(state.best_score(fit), known.get(labels, -np.inf))
        fits = {SetKey.of(fit).labels: state.score(fit) for fit in state.coarse_fits[key]}
        at_null: dict[frozenset[str], float] = {}
        for proposal in self.proposals:
            labels = key.labels | {proposal.hypothesis.label}
            score = base + state.score_at_null(proposal)
            at_null[labels] = max(score, at_null.get(labels, -np.inf))
        coarse = {labels: base + fits[labels] - fits[key.labels]
                  for labels in at_null if labels in fits}
        return {**{labels: score for labels, score in at_null.items() if labels not in known},
                **without_mean_error(coarse, known)}


def without_mean_error(estimates: Scores, fitted: Scores) -> Scores:
    """
    Return estimated scores of sets that were not fitted, without the mean error of their kind.

    Coarse fits are in the innovations of each arm's own filter; where no model fits they are a
    hundred nats off, all alike. Their mean error on the sets that were fitted is taken off, as
    with a control variate (P. Glasserman, Monte Carlo Methods in Financial Engineering (2003),
    section 4.1).
    """
    errors = [score - estimates[labels] for labels, score in fitted.items() if labels in estimates]
    shift = float(np.mean(errors)) if errors else 0.0
    return {labels: score + shift for labels, score in estimates.items() if labels not in fitted}
