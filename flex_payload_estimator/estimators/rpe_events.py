"""Has the payload changed? The recent past is replayed with the payload opened."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from flex_payload_estimator.estimators.rpe_hypothesis import Hypothesis, Sample, Stepper
import numpy as np

# Payloads tried beside the best guess, as shares of the way to it.
SHARES = (0.0, 0.5, 1.0, 1.5)
# With a wrong model, a change must also be larger than the model's errors look.
SMALLEST_SHARE = 0.1
SIGMAS = 5.0
CHANGES_PRIOR, PRIOR_BLOCKS = 2.0, 8.0
# Mean of e'S^-1 e per channel beyond which an exact model is none.
EXACT_MISFIT = 1.6


@dataclass(frozen=True)
class Event:
    """
    A payload change that the innovations gave evidence of.

    Attributes
    ----------
    time, found : float
        When it happened and when it was noticed, s.
    before, after : float
        kg, as estimated when it was noticed.

    """

    time: float
    found: float
    before: float
    after: float


class Change(NamedTuple):
    """
    The likeliest change of payload.

    Attributes
    ----------
    gain : float
        Log-likelihood over that of no change.
    time : float
        s.
    hypothesis : Hypothesis
        As it stands now.

    """

    gain: float
    time: float
    hypothesis: Hypothesis


class Recent:
    """
    The last samples, and the active hypothesis every few of them.

    Parameters
    ----------
    length, stride : int
        Samples kept, and samples between snapshots.

    """

    def __init__(self, length: int, stride: int):
        self.stride, self.count = stride, 0
        self.samples: deque[Sample] = deque(maxlen=length)
        self.snapshots: deque[tuple[int, float, Hypothesis]] = deque(maxlen=length // stride)

    def record(self, sample: Sample, active: Hypothesis) -> None:
        """Keep a sample that `active` has seen."""
        self.samples.append(sample)
        self.count += 1
        if self.count % self.stride == 0:
            self.snapshots.append((self.count, sample.time, active.copy()))

    def forget(self) -> None:
        """Drop everything."""
        self.samples.clear()
        self.snapshots.clear()

    def replay(self, stepper: Stepper, snapshot: int, mass: float, std: float) -> Hypothesis:
        """
        Return the hypothesis that the payload changed at a snapshot.

        Parameters
        ----------
        stepper : Stepper
            What steps it.
        snapshot : int
            Index.
        mass, std : float
            What it became, kg: the filter starts there.

        """
        seen, _, before = self.snapshots[snapshot]
        h = before.copy()
        stepper.reopen(h, std)
        h.mass, h.piece = mass, stepper.schedule.cut(mass)
        first = len(self.samples) - (self.count - seen)
        for sample in list(self.samples)[first:]:
            stepper.predict(h, sample)
            stepper.correct(h, sample)
        return h

    def search(self, stepper: Stepper, active: Hypothesis, guess: float) -> Change | None:
        """Try a guess, kg, from every snapshot, then payloads around it from the best one."""
        if not self.snapshots:
            return None
        std = stepper.heaviest / 6.0
        trials = [self.replay(stepper, k, guess, std) for k in range(len(self.snapshots))]
        when = int(np.argmax([h.log_likelihood for h in trials]))
        best = trials[when]
        around = active.mass + np.array(SHARES) * (best.mass - active.mass)
        trials = [best] + [self.replay(stepper, when, mass, std)
                           for mass in np.clip(around, 0.0, stepper.heaviest)]
        best = max(trials, key=lambda h: h.log_likelihood)
        again = self.replay(stepper, when, best.mass, std)
        best = max(best, again, key=lambda h: h.log_likelihood)
        return Change(best.log_likelihood - active.log_likelihood, self.snapshots[when][1], best)


class ChangeDetector:
    """
    Score test for a payload change in two staggered windows, then a replay that confirms it.

    Parameters
    ----------
    stepper : Stepper
    block : int
        Samples between the starts of windows; a window lasts one to two blocks.
    nats : float
        Log-likelihood that a change must gain.

    """

    def __init__(self, stepper: Stepper, block: int, nats: float):
        self.stepper, self.block, self.nats = stepper, block, nats
        self.recent = Recent(2 * block + 2, max(1, block // 5))
        self._pause = 0

    def quiet(self, samples: int) -> None:
        """Look for nothing for a while."""
        self._pause = samples

    def look(self, active: Hypothesis) -> Change | None:
        """Return a change that is certain enough, or None."""
        self._pause = max(0, self._pause - 1)
        exact = self.stepper.levels[active.level].exact
        limit = self.limit(active, exact)
        gain, step = self._score(active, exact)
        if gain < limit or self._pause:
            return None
        self._pause = max(1, self.block // 5)
        guess = min(max(active.mass + step, 0.0), self.stepper.heaviest)
        change = self.recent.search(self.stepper, active, guess)
        if change is None or change.gain < limit or not self._clear(change, active, exact):
            return None
        change.hypothesis.windows = active.windows.emptied()
        return change

    def limit(self, active: Hypothesis, exact: bool) -> float:
        """Return the log-likelihood that a change must gain; more where scores are coloured."""
        if exact:
            return self.nats
        w = active.windows
        usual = (CHANGES_PRIOR * PRIOR_BLOCKS + w.changes) / (PRIOR_BLOCKS + w.blocks)
        return self.nats * max(1.0, usual)

    def _score(self, active: Hypothesis, exact: bool) -> tuple[float, float]:
        """Return the larger gain of the two windows, and the step of payload, kg."""
        best = 0.0, 0.0
        smallest = 0.0 if exact else SMALLEST_SHARE * (
            active.mass + 0.4 * self.stepper.schedule.soft_mass)
        for column in (1, 2):
            score = float(active.windows.score[column])
            known = float(active.windows.information[column])
            # The past must know the payload better than the window does.
            if known <= 0.0 or active.variance * known > 0.5 or abs(score / known) < smallest:
                continue
            best = max(best, (0.5 * score * score / known, score / known))
        return best

    def _clear(self, change: Change, active: Hypothesis, exact: bool) -> bool:
        """Tell whether a change exceeds its uncertainty, and explains what was wrong."""
        colour = 1.0 if exact else active.windows.colour
        size = (change.hypothesis.mass - active.mass)**2
        fits = not exact or change.hypothesis.misfit < EXACT_MISFIT
        return fits and size > SIGMAS**2 * colour * change.hypothesis.variance
