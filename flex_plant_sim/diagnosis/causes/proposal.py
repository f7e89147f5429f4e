"""What each hypothesis promises beside causes that are on: its linear evidence, and its starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.causes.sensitivity import Sensitivity, SensitivityProbe
from flex_plant_sim.diagnosis.likelihood.evidence import GaussianMarginal
from flex_plant_sim.diagnosis.record.windows import Indices
import numpy as np

# Places that a fit may start from, the best first.
MAX_STARTS = 2


@dataclass(frozen=True)
class Proposal:
    """
    What a hypothesis could add to the evidence.

    Attributes
    ----------
    hypothesis : Hypothesis
    gain : float
        Nats, by the best of its shapes, linearly or at a start itself.
    starts : tuple of Array
        Values to fit from, best first, (k,) each.
    of_sizes : tuple of Array
        Each size that was looked at, in its best shape, (k,) each: where a size is a frequency,
        nothing between two of them is linear.
    magnitudes, information : Array
        Deviations of the first size from null, (L,), and what the record knows of it there, one
        over its variance: what three of four shapes surpass, (L,).

    """

    hypothesis: Hypothesis
    linear_gain: float
    starts: tuple[Array, ...]
    probe_starts: tuple[Array, ...]
    probed_sizes: Array
    information: Array


@dataclass(frozen=True)
class ProposalRefiner:
    """Looks at a hypothesis again at another size, beside the same causes."""

    probe: SensitivityProbe
    scorer: ProposalScorer

    def __call__(self, item: tuple[Proposal, float]) -> Proposal:
        """Return a promise that knows what the record holds of one more size."""
        propose, size = item
        first = int(np.argmax(propose.hypothesis.is_size))
        deviation = propose.hypothesis.probe_deviations()[0]
        sensitivities = self.probe.sensitivities(propose.hypothesis, deviation * size / abs(deviation[first]))
        if not sensitivities:
            return propose
        found = self.scorer.propose(propose.hypothesis, sensitivities)
        sizes = np.concatenate([found.probed_sizes, propose.probed_sizes])
        order = np.argsort(sizes)
        return replace(propose, probed_sizes=sizes[order], information=np.concatenate(
            [found.information, propose.information])[order])


@dataclass(frozen=True)
class _StartPoint:
    """A place: its gain, its values, what it knows of each size, whether it was looked at."""

    linear_gain: float
    values: Array
    information: Array
    probed: bool


class ProposalScorer:
    """
    Causes that are on: what every promise is measured against.

    Parameters
    ----------
    rows : Array
        Residual, columns of the causes, columns of the parts, weighted, (1 + k + p, m N).
    prior : Array
        Standard deviations of causes and parts, (k + p,).
    weight : Array
        Of each row's samples, (m N,).
    duration : float
        s.

    """

    def __init__(self, rows: Array, prior_widths: Array, weight: Array, duration: float):
        self.rows, self.weight, self.duration = rows.astype(np.float32), weight, duration
        both = self.rows @ self.rows.T
        marginal = GaussianMarginal(both.astype(float), prior_widths)
        self.projection = marginal.inverse_factor * prior_widths
        self.projected_residual = marginal.inverse_factor @ marginal.scaled_gradient

    def propose(self, hypothesis: Hypothesis, sensitivities: Sequence[Sensitivity]) -> Proposal:
        """Return what a hypothesis promises."""
        groups: dict[tuple[float, ...], list[_StartPoint]] = {}
        for sensitivity, products in zip(sensitivities, self._products(sensitivities)):
            groups.setdefault(tuple(sensitivity.deviation), []).extend(
                self._start_points(hypothesis, sensitivity, products))
        points = sorted((p for group in groups.values() for p in group), key=lambda p: -p.linear_gain)
        first = int(np.argmax(hypothesis.is_size))
        return Proposal(
            hypothesis, points[0].linear_gain, tuple(p.values for p in points[:MAX_STARTS]),
            tuple(max(probed, key=lambda p: p.linear_gain).values for group in groups.values()
                  if (probed := [p for p in group if p.probed])),
            np.array([abs(deviation[first]) for deviation in groups]),
            np.array([np.quantile([p.information[first] for p in group], 0.25)
                      for group in groups.values()]))

    def _products(self, sensitivities: Sequence[Sensitivity]) -> list[tuple[Array, Array]]:
        """Return each look's Hessian (s, s) and gradient (s,), the others integrated out."""
        changes = np.stack([sensitivity.changes for sensitivity in sensitivities]) * self.weight
        with_rows = (changes @ self.rows.T).astype(float)
        own = np.matmul(changes, changes.transpose(0, 2, 1)).astype(float)
        seen = with_rows[..., 1:] @ self.projection.T
        gradient = with_rows[..., 0] - seen @ self.projected_residual
        return list(zip(own - seen @ seen.transpose(0, 2, 1), gradient))

    def _start_points(self, hypothesis: Hypothesis, sensitivity: Sensitivity, products: tuple[Array, Array]
                ) -> list[_StartPoint]:
        """Return the linear optimum of the sizes of a shape, and the sizes looked at."""
        sizes, shape = np.flatnonzero(hypothesis.is_size), sensitivity.shape
        deviation, prior = sensitivity.deviation[sizes], hypothesis.prior(self.duration)
        width, centre = prior.width[sizes], (prior.centre - shape)[sizes]
        hessian = products[0] / deviation[:, None] / deviation
        gradient = products[1] / deviation
        total = hessian + np.diag(width**-2.0)
        best = np.clip(np.linalg.solve(total, centre / width**2 - gradient),
                       (hypothesis.low - shape)[sizes], (hypothesis.high - shape)[sizes])
        occam = 0.5 * float(np.linalg.slogdet(width[:, None] * total * width)[1])
        information = np.zeros(shape.size)
        information[sizes] = np.diagonal(hessian)

        def linear_gain(change: Array) -> float:
            normalised = (change - centre) / width
            return -float(gradient @ change + 0.5 * change @ hessian @ change
                          + 0.5 * normalised @ normalised) - occam

        found = [_StartPoint(linear_gain(best), _with_sizes(shape, sizes, best), information, False)]
        if sizes.size == 1:
            found.append(_StartPoint(linear_gain(deviation), _with_sizes(shape, sizes, deviation), information, True))
        return found


def _with_sizes(shape: Array, sizes: Indices, change: Array) -> Array:
    values = shape.copy()
    values[sizes] += change
    return values
