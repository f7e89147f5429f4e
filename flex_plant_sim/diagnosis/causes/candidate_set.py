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
    def event_time(self) -> float | None:
        """Return the time of the first event where the first start has it, s; None without one."""
        index = self._event_index
        return None if index is None else float(self.starts[0][index])

    def with_event_at(self, times: Array) -> CandidateSet:
        """Return the set with more starts: the first one with its first event at each time, s."""
        more = np.repeat(self.starts[0][None], len(times), axis=0)
        more[:, self._event_index] = times
        return replace(self, starts=(*self.starts, *more))

    @property
    def _event_index(self) -> int | None:
        boundaries = CauseSet(self.hypotheses, 1.0).boundaries
        return next((int(first) + h.event_index for h, first in zip(self.hypotheses, boundaries)
                     if h.event_index is not None), None)

    @property
    def labels(self) -> frozenset[str]:
        """Return the labels of the causes."""
        return frozenset(h.label for h in self.hypotheses)

    def without(self, index: int) -> CandidateSet:
        """Return the set without one of its causes, the parts where they are."""
        values = CauseSet(self.hypotheses, 1.0).split(self.starts[0])
        rest = [value for k, value in enumerate(values) if k != index]
        return CandidateSet(self.hypotheses[:index] + self.hypotheses[index + 1:],
                            (np.concatenate([np.zeros(0), *rest]),), self.deviations)

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
