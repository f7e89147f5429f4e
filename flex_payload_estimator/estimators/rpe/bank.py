"""A bank of hypotheses: weighed by likelihood, pruned until one is left."""

from __future__ import annotations

from typing import Any, NamedTuple

from flex_payload_estimator.estimators.rpe.events import EXPLAINED
from flex_payload_estimator.estimators.rpe.hypothesis import Hypothesis, Sample, Weighed
from flex_payload_estimator.estimators.rpe.search import Recent
from flex_payload_estimator.estimators.rpe.stepper import Stepper
from flex_plant_sim.arm.second_order import Array
import numpy as np

START_MASSES = 6
KEEP_NATS = 30.0
# Two filters agree where the payload is known to this share of (m + soft mass).
FINE = 0.05
ROBUST_MISFIT = 6.0
# Blocks with motion after which the level of model error is decided.
BLOCKS_TO_DECIDE = 4
# And blocks after which an exact level has proved itself.
BLOCKS_TO_TRUST = 10
# The simpler of two hypotheses may be behind by this.
SIMPLER_NATS = 3.0


class Ahead(NamedTuple):
    """
    A prediction made before its measurement, and how to take it back.

    Attributes
    ----------
    command : Array
        Assumed, (2,).
    saved : list of (Hypothesis, Hypothesis)
        Each hypothesis and its copy before.
    pace : tuple
        What the pace remembered before.
    sample, mark : Sample
        The ones before.
    weighed : Weighed or None
        What the measurement will be worth, where one hypothesis is left.

    """

    command: Array
    saved: list[tuple[Hypothesis, Hypothesis]]
    pace: tuple[Any, ...]
    sample: Sample
    mark: Sample | None
    weighed: Weighed | None

    def restore(self) -> None:
        """Take the prediction of every hypothesis back."""
        for h, before in self.saved:
            h.x, h.cov, h.sens = before.x, before.cov, before.sens


class Bank:
    """
    Hypotheses over the starting payload and over the level of model error.

    Parameters
    ----------
    stepper : Stepper
    tolerances : Array
        Of the part parameters, relative, (p,).

    """

    def __init__(self, stepper: Stepper, tolerances: Array):
        self.stepper, self.tolerances = stepper, tolerances
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.hypotheses: list[Hypothesis] = []
        self.lively_blocks = 0
        self._doubt, self._doubt_nats, self._misfits, self._calm = 0, KEEP_NATS, 0, 0
        self._since = 0.0, 0.0

    def start(self, measured: Array) -> None:
        """Fill the bank: every level with payloads from 0 to the heaviest."""
        soft, heaviest = self.stepper.schedule.soft_mass, self.stepper.heaviest
        shares = np.arange(START_MASSES + 1) / START_MASSES
        edges = soft * (1.0 + heaviest / soft)**shares - soft
        self.hypotheses = [
            self.stepper.start(level, measured, 0.5 * (low + high), 0.5 * (high - low))
            for level, kind in enumerate(self.stepper.levels) if not kind.drift
            for low, high in zip(edges[:-1], edges[1:])]

    @property
    def decided(self) -> bool:
        """Tell whether there was motion enough to decide between levels."""
        return self.lively_blocks >= BLOCKS_TO_DECIDE

    def weight(self, h: Hypothesis) -> float:
        """Return a log-weight: levels by what was recent, payloads by all samples."""
        first = max((other for other in self.hypotheses if other.level == h.level),
                    key=lambda other: other.log_likelihood)
        return first.recent + h.log_likelihood - first.log_likelihood

    def best(self) -> Hypothesis:
        """Return the likeliest hypothesis."""
        if len(self.hypotheses) == 1:
            return self.hypotheses[0]
        return max(self.hypotheses, key=self.weight)

    def prune(self) -> None:
        """Drop what is unlikely within its level, or agrees with a likelier one; then levels."""
        if len(self.hypotheses) == 1:
            return
        nats = KEEP_NATS
        if self._doubt:
            self._doubt -= 1
            nats = self._doubt_nats if self._doubt else 0.0
        kept: list[Hypothesis] = []
        for h in sorted(self.hypotheses, key=lambda h: -h.log_likelihood):
            rivals = [other for other in kept if other.level == h.level]
            if not any(h.log_likelihood <= other.log_likelihood - nats or self._agree(h, other)
                       for other in rivals):
                kept.append(h)
        self.hypotheses = kept
        if self.decided:
            # The first of a level in `kept` is its likeliest.
            recent: dict[int, float] = {}
            for h in kept:
                recent.setdefault(h.level, h.recent)
            least = max(recent.values()) - KEEP_NATS
            self.hypotheses = [h for h in kept if recent[h.level] > least]

    def _agree(self, one: Hypothesis, other: Hypothesis) -> bool:
        fine = FINE * (other.mass + self.stepper.schedule.soft_mass)
        return other.variance < fine**2 and (one.mass - other.mass)**2 < 9.0 * other.variance

    def level_weights(self) -> None:
        """Hold all hypotheses for equally likely."""
        for h in self.hypotheses:
            h.log_likelihood = h.recent = 0.0

    def rival(self, changed: Hypothesis, samples: int, nats: float) -> None:
        """Let a changed payload compete with the unchanged one for some samples."""
        self.hypotheses = [changed, self.best()]
        self._doubt, self._doubt_nats = samples, nats

    def widen(self, spread: Array, patience: float, recent: Recent) -> bool:
        """
        Bring larger model errors back in where the only hypothesis left no longer fits.

        Parameters
        ----------
        spread : Array
            Standard deviation of the state at the start, (n,).
        patience : float
            Samples for which it must not fit: a change of payload looks the same at first.
        recent : Recent
            From before: a drifting payload is tried from there.

        """
        if len(self.hypotheses) > 1:
            return False
        active, levels = self.hypotheses[0], self.stepper.levels
        exact = levels[active.level].exact
        fits = active.misfit < (EXPLAINED if exact else ROBUST_MISFIT)
        self._misfits = 0 if fits else self._misfits + 1
        if self._misfits < patience:
            return False
        self._misfits = 0
        for level in range(active.level + 1, len(levels)):
            if levels[level].drift:
                # Only what was exact for a while can be exact but for a drifting payload.
                drifting = recent.replay_at(self.stepper, active, level) \
                    if self.lively_blocks >= BLOCKS_TO_TRUST else None
                if drifting:
                    self.hypotheses.append(drifting)
                    self._since = recent.samples[0][0].time, recent.samples[0][1].mass
                continue
            h = active.copy()
            self.stepper.loosen(h, level)
            if exact:
                self.stepper.reopen(h, self.stepper.heaviest / 6.0)
                h.cov = h.cov + np.diag(1e-4 * spread**2)
            self.hypotheses.append(h)
        active.misfit, self.lively_blocks = 1.0, 0
        return len(self.hypotheses) > 1

    def drifted(self, best: Hypothesis) -> tuple[float, float] | None:
        """Return since when, s, and from where, kg, the payload drifts, if it does."""
        drifting = self.stepper.levels[best.level].drift and len(self.hypotheses) == 1
        return self._since if drifting else None

    def settle(self) -> None:
        """Once a block: let a payload that drifted try to stand still again."""
        first = self.hypotheses[0]
        if len(self.hypotheses) == 1 and self.stepper.levels[first.level].drift:
            self._calm += 1
            if self._calm == BLOCKS_TO_DECIDE:
                still = first.copy()
                self.stepper.loosen(still, 0)
                self.hypotheses.append(still)
                self._calm = -BLOCKS_TO_DECIDE
        elif self._calm < 0:
            self._calm += 1
            if self._calm == 0:
                best = max(h.recent for h in self.hypotheses)
                stands = [h for h in self.hypotheses
                          if h.level == 0 and h.recent > best - SIMPLER_NATS]
                self.hypotheses = stands or [h for h in self.hypotheses if h.level]

    def variance(self, h: Hypothesis) -> float:
        """Return the variance of a payload's error, kg^2: colour and tolerances included."""
        if self.stepper.levels[h.level].exact:
            return h.variance
        lean = h.lean * self.tolerances
        return h.variance * h.windows.colour + float(lean @ lean)

    def moments(self) -> tuple[float, float]:
        """Return mean and variance of the payload, kg and kg^2."""
        if len(self.hypotheses) == 1:
            return self.hypotheses[0].mass, self.variance(self.hypotheses[0])
        logs = np.array([self.weight(h) for h in self.hypotheses])
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        masses = np.array([h.mass for h in self.hypotheses])
        mean = float(weights @ masses)
        spread = np.array([self.variance(h) for h in self.hypotheses]) + (masses - mean)**2
        return mean, float(weights @ spread)
