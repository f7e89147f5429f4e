"""Has the payload changed? The recent past is replayed with the payload opened."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

from flex_payload_estimator.estimators.rpe_hypothesis import Hypothesis, Sample, Stepper
import numpy as np

# Payloads tried beside the best guess, as shares of the way to it.
SHARES = (0.0, 0.5, 1.0, 1.5)
# A change must also be larger than a wrong model's errors look, share of the payload.
SMALLEST_SHARE = 0.1
SIGMAS = 5.0
# Mean of e'S^-1 e per channel beyond which a change explains nothing, or an exact model is none.
EXPLAINED = 1.6


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


class EventLog:
    """
    The payload changes found so far; the last one may still be bettered or taken back.

    Parameters
    ----------
    gap : float
        Changes noticed within this, s, are one.

    """

    def __init__(self, gap: float):
        self.gap = gap
        self.events: list[Event] = []
        self._before: list[Event] = []
        self._noticed = -math.inf

    def notice(self, event: Event) -> None:
        """Add a change, or better the last one where it goes on."""
        self._before = list(self.events)
        if self.events and event.time < self._noticed + self.gap:
            self.events[-1] = replace(self.events[-1], after=event.after)
        else:
            self.events.append(event)
        self._noticed = event.found

    def take_back(self) -> None:
        """Undo the last notice."""
        self.events = self._before


class Recent:
    """
    The last samples, and the active hypothesis after each of them.

    Parameters
    ----------
    length : int
        Samples kept.

    Attributes
    ----------
    sparse : bool
        The active hypothesis takes samples in between that are not kept.

    """

    def __init__(self, length: int):
        self.samples: deque[tuple[Sample, Hypothesis]] = deque(maxlen=length)
        self.sparse = False

    def record(self, sample: Sample, active: Hypothesis) -> None:
        """Keep a sample that `active` has seen."""
        self.samples.append((sample, active.copy()))

    def forget(self) -> None:
        """Drop everything."""
        self.samples.clear()
        self.sparse = False

    def replay(self, stepper: Stepper, place: int, mass: float, std: float) -> Hypothesis:
        """
        Return the hypothesis that the payload changed after one of the samples.

        Parameters
        ----------
        stepper : Stepper
            What steps it.
        place : int
            Which sample.
        mass, std : float
            What the payload became, kg: the filter starts there.

        """
        h = self.samples[place][1].copy()
        jump = mass - h.mass
        stepper.reopen(h, std)
        h.mass = mass
        for k in range(place + 1, len(self.samples)):
            sample = self.samples[k][0]
            stepper.predict(h, sample)
            if k == place + 1:
                # It changed somewhere within this sample.
                h.cov = h.cov + jump**2 / 12.0 * np.outer(h.sens[:, 0], h.sens[:, 0])
            stepper.correct(h, sample)
        return h

    def replay_at(self, stepper: Stepper, active: Hypothesis, level: int
                  ) -> Hypothesis | None:
        """Return the oldest hypothesis kept, brought up to now at another level."""
        if not self.samples:
            return None
        h = self.samples[0][1].copy()
        unchanged = h.copy()
        stepper.loosen(h, level)
        self._bring_on(stepper, h)
        if self.sparse:
            self._bring_on(stepper, unchanged)
            h.recent += active.recent - unchanged.recent
            h.log_likelihood += active.log_likelihood - unchanged.log_likelihood
        return h

    def _bring_on(self, stepper: Stepper, h: Hypothesis) -> list[float]:
        """Bring h from the first sample up to now; return its log-likelihood at each."""
        found = [h.log_likelihood]
        for k in range(1, len(self.samples)):
            stepper.predict(h, self.samples[k][0])
            stepper.correct(h, self.samples[k][0])
            found.append(h.log_likelihood)
        return found

    def _without(self, stepper: Stepper) -> list[float]:
        """Return the log-likelihood of no change at each sample, from the samples kept."""
        if self.sparse:
            return self._bring_on(stepper, self.samples[0][1].copy())
        return [h.log_likelihood for _, h in self.samples]

    def search(self, stepper: Stepper, active: Hypothesis, guess: float, stride: int
               ) -> Change | None:
        """
        Return the likeliest change.

        Parameters
        ----------
        stepper : Stepper
            What steps the trials.
        active : Hypothesis
            Without a change.
        guess : float
            Of the payload after it, kg; payloads around are tried too.
        stride : int
            Samples between the first trials of when it was; finer ones follow.

        """
        last = len(self.samples) - 2
        if last < 0:
            return None
        std = stepper.heaviest / 6.0
        base = self._without(stepper)
        ahead = [base[k] - self.samples[k][1].log_likelihood for k in range(last + 1)]
        trials = {k: self.replay(stepper, k, guess, std) for k in range(last, -1, -stride)}
        when = max(trials, key=lambda k: trials[k].log_likelihood + ahead[k])
        guess = trials[when].mass
        trials = {k: self.replay(stepper, k, guess, std)
                  for k in range(max(0, when - stride + 1), min(last, when + stride - 1) + 1)}
        when = max(trials, key=lambda k: trials[k].log_likelihood + ahead[k])
        found = [trials[when]]
        around = active.mass + np.array(SHARES) * (trials[when].mass - active.mass)
        for mass in np.clip(around, 0.0, stepper.heaviest):
            found.append(self.replay(stepper, when, float(mass), std))
        best = max(found, key=lambda h: h.log_likelihood)
        found = [best, self.replay(stepper, when, best.mass, std)]
        best = max(found, key=lambda h: h.log_likelihood)
        gain = best.log_likelihood + ahead[when] - base[-1]
        best.log_likelihood = active.log_likelihood + gain
        return Change(gain, self.samples[when][0].time, best)


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
        self.recent = Recent(2 * block + 2)
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
        # A payload that may drift follows any change by itself.
        if gain < limit or self._pause or self.stepper.levels[active.level].drift:
            return None
        stride = max(1, self.block // 5)
        self._pause = stride
        guess = min(max(active.mass + step, 0.0), self.stepper.heaviest)
        change = self.recent.search(self.stepper, active, guess, stride)
        if change is None or change.gain < limit or not self._clear(change, active, exact):
            return None
        if abs(change.hypothesis.mass - active.mass) < self.smallest(active):
            # No payload that anybody took or left: the model is not exact.
            active.misfit = max(active.misfit, 2.0 * EXPLAINED)
            return None
        change.hypothesis.watch(active.windows.emptied())
        return change

    def smallest(self, active: Hypothesis) -> float:
        """Return the smallest change, kg, that model errors do not look like."""
        return SMALLEST_SHARE * (active.mass + 0.4 * self.stepper.schedule.soft_mass)

    def limit(self, active: Hypothesis, exact: bool) -> float:
        """Return the log-likelihood that a change must gain; more where scores are coloured."""
        if exact:
            return self.nats
        return self.nats * max(active.windows.scatter, 0.5 * active.windows.colour)

    def _score(self, active: Hypothesis, exact: bool) -> tuple[float, float]:
        """Return the larger gain of the two windows, and the step of payload, kg."""
        best = 0.0, 0.0
        smallest = 0.0 if exact else self.smallest(active)
        scores, informations = active.sums.tolist()
        for score, known in zip(scores[1:], informations[1:]):
            # The past must know the payload better than the window does.
            if known <= 0.0 or active.variance * known > 0.5 or abs(score / known) < smallest:
                continue
            best = max(best, (0.5 * score * score / known, score / known))
        return best

    def _clear(self, change: Change, active: Hypothesis, exact: bool) -> bool:
        """Tell whether a change exceeds its uncertainty, and explains what was wrong."""
        colour = 1.0 if exact else active.windows.colour
        h = change.hypothesis
        clear = (h.mass - active.mass)**2 > SIGMAS**2 * colour * h.variance
        return clear and h.misfit < EXPLAINED
