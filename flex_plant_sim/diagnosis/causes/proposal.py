"""
Proposals: the linear evidence of each further cause beside a set of causes, and where to start.

They are computed from `Sensitivity` by algebra. The search fits the best of them, and their
information is a first guess of detection limits.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.causes.sensitivity import Sensitivity, TIMES_A_PERIOD
from flex_plant_sim.diagnosis.likelihood.evidence import GaussianMarginal
import numpy as np

# Starts of a proposal at most, the best first; probed values it offers to start from at most, and
# at least one of each size. Both are budgets.
MAX_STARTS, MAX_PROBE_STARTS = 2, 6
# Information on sizes in single precision is known to this share of its largest part.
ROUNDING = float(np.finfo(np.float32).eps)


@dataclass(frozen=True)
class Proposal:
    """
    What a hypothesis could add to the evidence of a set of causes.

    Attributes
    ----------
    hypothesis : Hypothesis
    linear_gain : float
        Log-evidence at the best shape, by linearisation, nats, without the prior odds.
    occam : float
        Log-evidence that its freedom costs there, nats: what it loses if its best size is null.
    starts : tuple of Array
        Values to start a fit from, the best first, (k,) each.
    probe_starts : tuple of Array
        Probed values, (k,) each: each size at its best shape, then the best others. Where a size
        and a shape set a frequency, the residual is not linear between two of them.
    probed_sizes, information : Array
        Deviations of the first size from null, (L,), and the information on the size there (one
        over its variance), of which three quarters of the shapes have more, (L,).

    """

    hypothesis: Hypothesis
    linear_gain: float
    occam: float
    starts: tuple[Array, ...]
    probe_starts: tuple[Array, ...]
    probed_sizes: Array
    information: Array

    def with_times_around(self, period: float) -> Proposal:
        """
        Return the proposal of an event with starts at all times within half a period, s.

        Sensitivities tell the time without the vibration that an event starts. The sum of both has
        its minimum elsewhere, the further the more the size is off, and in between it is steep.
        """
        late = np.zeros((TIMES_A_PERIOD + 1, self.starts[0].size))
        late[:, self.hypothesis.event_index] = period * np.linspace(-0.5, 0.5, len(late))
        return replace(self, starts=tuple(np.maximum(start + by, self.hypothesis.low)
                                          for start in self.starts for by in late))


@dataclass(frozen=True)
class _StartPoint:
    """Values to start from, gain, cost of freedom, information on sizes, if they were probed."""

    gain: float
    occam: float
    values: Array
    information: Array
    probed: bool


class ProposalScorer:
    """
    The linear evidence of further causes beside a set of causes.

    Parameters
    ----------
    rows : Array
        Residual without causes, Jacobian in the causes' values, Jacobian in the parts, weighted,
        (1 + k + p, m N).
    prior_widths : Array
        Prior standard deviations of values and parts, (k + p,).
    weight : Array
        One over the standard deviation of each sample, (m N,).
    duration : float
        Of the longest record, s.

    """

    def __init__(self, rows: Array, prior_widths: Array, weight: Array, duration: float):
        self.rows, self.weight, self.duration = rows.astype(np.float32), weight, duration
        products = self.rows @ self.rows.T
        marginal = GaussianMarginal(products.astype(float), prior_widths)
        self.projection = marginal.inverse_factor * prior_widths
        self.projected_residual = marginal.inverse_factor @ marginal.scaled_gradient

    def propose(self, hypothesis: Hypothesis, sensitivities: Sequence[Sensitivity]) -> Proposal:
        """Return the proposal of a hypothesis, from all its shapes and probed sizes."""
        groups: dict[tuple[float, ...], list[_StartPoint]] = {}
        for sensitivity, points in zip(sensitivities,
                                       self._start_points(hypothesis, sensitivities)):
            groups.setdefault(tuple(sensitivity.deviation), []).extend(points)
        points = sorted((p for group in groups.values() for p in group), key=lambda p: -p.gain)
        # Of an event's times the best one for each size: its neighbours lead to the same fit.
        apart = points if hypothesis.event_index is None else sorted(
            (max(group, key=lambda p: p.gain) for group in groups.values()), key=lambda p: -p.gain)
        first = int(np.argmax(hypothesis.is_size))
        return Proposal(
            hypothesis, points[0].gain, points[0].occam,
            tuple(p.values for p in apart[:MAX_STARTS]),
            tuple(p.values for p in _probed(groups.values())),
            np.array([abs(deviation[first]) for deviation in groups]),
            np.array([np.quantile([p.information[first] for p in group], 0.25)
                      for group in groups.values()]))

    def _products(self, sensitivities: Sequence[Sensitivity]) -> tuple[Array, Array]:
        """Return Hessians (S, s, s) and gradients (S, s), causes and parts integrated out."""
        changes = np.stack([sensitivity.changes for sensitivity in sensitivities]) * self.weight
        with_rows = (changes @ self.rows.T).astype(float)
        own = np.matmul(changes, changes.transpose(0, 2, 1)).astype(float)
        projected = with_rows[..., 1:] @ self.projection.T
        gradient = with_rows[..., 0] - projected @ self.projected_residual
        return own - projected @ projected.transpose(0, 2, 1), gradient

    def _start_points(self, hypothesis: Hypothesis, sensitivities: Sequence[Sensitivity]
                      ) -> Iterator[list[_StartPoint]]:
        """Yield of each shape the optimum of its sizes, and the probed size if it is one."""
        sizes, prior = np.flatnonzero(hypothesis.is_size), hypothesis.prior(self.duration)
        shapes = np.stack([sensitivity.shape for sensitivity in sensitivities])
        deviation = np.stack([sensitivity.deviation for sensitivity in sensitivities])[:, sizes]
        width, centre = prior.width[sizes], (prior.centre - shapes)[:, sizes]
        hessian, gradient = self._products(sensitivities)
        hessian = hessian / deviation[:, :, None] / deviation[:, None]
        gradient = gradient / deviation
        # Two sizes may do the same so strongly that rounding leaves nothing of the prior's one.
        values, vectors = np.linalg.eigh(np.eye(sizes.size) + width[:, None] * hessian * width)
        values = np.maximum(values, np.maximum(1.0, ROUNDING * values[:, -1:]))
        slope = (centre / width - width * gradient)[:, None]
        scaled = (slope @ vectors)[:, 0] / values
        best = np.clip(width * (vectors @ scaled[..., None])[..., 0],
                       *_reach(hypothesis, shapes[:, sizes], deviation))
        occam = 0.5 * np.sum(np.log(values), axis=1)
        information = np.zeros_like(shapes)
        information[:, sizes] = np.diagonal(hessian, axis1=1, axis2=2)

        def starts(change: Array, probed: bool) -> list[_StartPoint]:
            from_centre = (change - centre) / width
            curved = (hessian @ change[..., None])[..., 0]
            gain = -np.sum((gradient + 0.5 * curved) * change + 0.5 * from_centre**2, axis=1)
            at = shapes.copy()
            at[:, sizes] += change
            return [_StartPoint(*point, probed)
                    for point in zip((gain - occam).tolist(), occam.tolist(), at, information)]

        found = [starts(best, False)]
        if sizes.size == 1:
            found.append(starts(deviation, True))
        return map(list, zip(*found))


def _reach(hypothesis: Hypothesis, null: Array, deviation: Array) -> tuple[Array, Array]:
    """
    Return the least and largest deviations up to which probes tell what sizes change, (S, s).

    They are those of the next probes, and null, of one size whose effect is not linear. Far from a
    probe its change says little: a share of what a delay of 80 ms changes looks like one of 3 ms
    that averages noise away, and promised 12 nats where that costs 9.
    """
    is_size = hypothesis.is_size
    low, high = hypothesis.low[is_size] - null, hypothesis.high[is_size] - null
    if hypothesis.effect.linear or null.shape[1] > 1:
        return low, high
    probes = {float(probe[is_size][0]) for probe in hypothesis.probe_deviations()}
    sides = {math.copysign(1.0, probe) for probe in probes}
    known = {*probes, 0.0} if len(sides) > 1 else probes
    for here in np.unique(deviation):
        rows = deviation[:, 0] == here
        low[rows] = max((x for x in known if x < here), default=low[rows])
        high[rows] = min((x for x in known if x > here), default=high[rows])
    return low, high


def _probed(groups: Iterable[Sequence[_StartPoint]]) -> list[_StartPoint]:
    """Return the best probed point of each group, then the best others up to the budget."""
    ranked = [sorted((p for p in group if p.probed), key=lambda p: -p.gain) for group in groups]
    first = [points[0] for points in ranked if points]
    others = sorted((p for points in ranked for p in points[1:]), key=lambda p: -p.gain)
    return first + others[:max(MAX_PROBE_STARTS - len(first), 0)]
