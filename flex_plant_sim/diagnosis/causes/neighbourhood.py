"""
A set whose neighbours were fitted, and the scores that are estimated of those that were not.

`search` keeps one for each set that it explored; the posterior counts what was not fitted too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.posterior import is_unknown, SetKey
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

    def has_unknown(self, state: SearchState) -> bool:
        """Tell whether something unknown belongs to the set as its score counts it."""
        return is_unknown(state.best_interpretation(self.centre), state.nominal)

    def unfitted_scores(self, state: SearchState) -> Scores:
        """Return the scores of the neighbours that were not fitted to all windows, nats."""
        fitted: dict[frozenset[str], float] = {}
        for fit in state.fits.values():
            if fit.discrepancy == self.centre.discrepancy:
                labels = SetKey.of(fit).labels
                fitted[labels] = max(state.best_score(fit), fitted.get(labels, -np.inf))
        return estimated_scores(*self._estimates(state), fitted)

    def _estimates(self, state: SearchState) -> tuple[Scores, Scores]:
        """Return estimated scores of sets with one cause more: by linear gains, coarse fits."""
        key, base = SetKey.of(self.centre), state.best_score(self.centre)
        fits = {SetKey.of(fit).labels: state.score(fit) for fit in state.coarse_fits[key]}
        linear: dict[frozenset[str], float] = {}
        for proposal in self.proposals:
            linear.setdefault(key.labels | {proposal.hypothesis.label},
                              base + state.penalised_gain(proposal))
        return linear, {labels: base + fits[labels] - fits[key.labels]
                        for labels in linear if labels in fits}


def estimated_scores(linear: Scores, coarse: Scores, fitted: Scores) -> Scores:
    """Return scores of sets that were not fitted, by coarse fits where there are, nats."""
    return {**without_mean_error(linear, fitted), **without_mean_error(coarse, fitted)}


def without_mean_error(estimates: Scores, fitted: Scores) -> Scores:
    """
    Return estimated scores of sets that were not fitted, without the mean error of their kind.

    Estimates are in the innovations of each arm's own filter; where no model fits they are a
    hundred nats off, all alike. Linear gains promise too much where they are largest, and a coarse
    fit may have stopped short. Their mean error on the sets that were fitted is taken off, as with
    a control variate (P. Glasserman, Monte Carlo Methods in Financial Engineering (2003), section
    4.1).
    """
    errors = [score - estimates[labels] for labels, score in fitted.items() if labels in estimates]
    shift = float(np.mean(errors)) if errors else 0.0
    return {labels: score + shift for labels, score in estimates.items() if labels not in fitted}
