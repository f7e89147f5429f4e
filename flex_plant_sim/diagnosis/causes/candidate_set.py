"""A set of causes that is to be fitted, with the values to start from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.proposal import Proposal
import numpy as np


@dataclass(frozen=True)
class CandidateSet:
    """
    A set of causes to fit, and where to start.

    Attributes
    ----------
    hypotheses : tuple of Hypothesis
    starts : tuple of Array
        Values, (k,) each; the fit begins at the best of them.
    deviations : Array, optional
        Of the parts, (p,), around which the set is linearised first; zero by default.

    """

    hypotheses: tuple[Hypothesis, ...]
    starts: tuple[Array, ...]
    deviations: Array | None = None

    @classmethod
    def of(cls, fit: Fit) -> CandidateSet:
        """Return the set of a fit, to start from its estimates."""
        return cls(fit.hypotheses, (fit.values,), fit.deviations)

    def with_values_of(self, known: CandidateSet) -> CandidateSet:
        """Return the set with one more start, at another's values of the causes that it shares."""
        values = dict(zip((h.label for h in known.hypotheses),
                          CauseSet(known.hypotheses, 1.0).split(known.starts[0])))
        own = CauseSet(self.hypotheses, 1.0).split(self.starts[0])
        start = [values.get(h.label, value) for h, value in zip(self.hypotheses, own)]
        return replace(self, starts=(*self.starts, np.concatenate([np.zeros(0), *start])))

    @property
    def labels(self) -> frozenset[str]:
        """Return the labels of the causes."""
        return frozenset(h.label for h in self.hypotheses)

    def without(self, index: int) -> CandidateSet:
        """Return the set without one of its causes."""
        values = CauseSet(self.hypotheses, 1.0).split(self.starts[0])
        rest = [value for k, value in enumerate(values) if k != index]
        return CandidateSet(self.hypotheses[:index] + self.hypotheses[index + 1:],
                            (np.concatenate([np.zeros(0), *rest]),))

    def with_proposal(self, proposal: Proposal) -> CandidateSet:
        """Return the set with the proposed cause added, to start from the proposal's starts."""
        return CandidateSet(
            (*self.hypotheses, proposal.hypothesis),
            tuple(np.concatenate([self.starts[0], start]) for start in proposal.starts))

    def with_each_probe(self, proposal: Proposal) -> Iterator[CandidateSet]:
        """Return the same, and once more from each probed start: there are minima in between."""
        yield self.with_proposal(proposal)
        for start in proposal.probe_starts:
            yield self.with_proposal(replace(proposal, starts=(start,)))
