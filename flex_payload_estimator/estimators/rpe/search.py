"""When did the payload change, and to what? The recent past is replayed with it opened."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator
from typing import NamedTuple

from flex_payload_estimator.estimators.rpe.hypothesis import Hypothesis, Sample
from flex_payload_estimator.estimators.rpe.stepper import Stepper
import numpy as np

# Payloads tried beside the best guess, as shares of the way to it.
SHARES = (0.0, 0.5, 1.0, 1.5)
# Filter steps a second of data: a search takes several hundred, and no sample shall wait for it.
STEPS_PER_S = 6000.0

Kept = tuple[Sample, Hypothesis]
Replay = Generator[None, None, Hypothesis]


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
        self.samples: deque[Kept] = deque(maxlen=length)
        self.sparse = False

    def record(self, sample: Sample, active: Hypothesis) -> None:
        """Keep a sample that `active` has seen."""
        self.samples.append((sample, active.copy()))

    def forget(self) -> None:
        """Drop everything."""
        self.samples.clear()
        self.sparse = False

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

    def _bring_on(self, stepper: Stepper, h: Hypothesis) -> None:
        """Bring h from the first sample up to now."""
        for k in range(1, len(self.samples)):
            stepper.step(h, self.samples[k][0], True)


class Search:
    """
    A search for the likeliest change, a few filter steps at a time.

    Parameters
    ----------
    stepper : Stepper
        What steps the trials.
    recent : Recent
        At least two samples; what comes later is told by `add`.
    active : Hypothesis
        Without a change.
    guess : float
        Of the payload after it, kg; payloads around are tried too.
    stride : int
        Samples between the first trials of when it was; finer ones follow.

    """

    def __init__(self, stepper: Stepper, recent: Recent, active: Hypothesis, guess: float,
                 stride: int):
        self.stepper, self.active = stepper, active
        self._samples, self._sparse = list(recent.samples), recent.sparse
        self._last = len(self._samples) - 1
        self._unchanged = self._samples[0][1].copy()
        self._best, self._when, self._ahead = active, 0, 0.0
        self._work = self._likeliest(active.mass, guess, stride)
        self._found = False

    def add(self, kept: Kept) -> None:
        """Take a sample that came meanwhile."""
        self._samples.append(kept)

    def advance(self, steps: int) -> None:
        """Go some filter steps on, as far as there are samples."""
        for _ in range(steps):
            if not self._found:
                self._found = next(self._work, True) is True
            elif self._last + 1 < len(self._samples):
                self._last += 1
                self.stepper.step(self._best, self._samples[self._last][0], True)
                if self._sparse:
                    self.stepper.step(self._unchanged, self._samples[self._last][0], True)

    def result(self) -> Change | None:
        """Return the likeliest change, None as long as it is not known up to the last sample."""
        if not self._found or self._last + 1 < len(self._samples):
            return None
        base = self._unchanged if self._sparse else self._samples[-1][1]
        gain = self._best.log_likelihood + self._ahead - base.log_likelihood
        self._best.log_likelihood = self.active.log_likelihood + gain
        return Change(gain, self._samples[self._when][0].time, self._best)

    def _likeliest(self, mass: float, guess: float, stride: int) -> Iterator[None]:
        """Find what the payload may have become after which sample, each yield a filter step."""
        last, std, heaviest = self._last, self.stepper.heaviest / 6.0, self.stepper.heaviest
        ahead = yield from self._without()
        trials: dict[int, Hypothesis] = {}
        for k in range(last - 1, -1, -stride):
            trials[k] = yield from self._replay(k, guess, std)
        when = max(trials, key=lambda k: trials[k].log_likelihood + ahead[k])
        guess, trials = trials[when].mass, {}
        for k in range(max(0, when - stride + 1), min(last - 1, when + stride - 1) + 1):
            trials[k] = yield from self._replay(k, guess, std)
        when = max(trials, key=lambda k: trials[k].log_likelihood + ahead[k])
        best = trials[when]
        for around in np.clip(mass + np.array(SHARES) * (best.mass - mass), 0.0, heaviest):
            found = yield from self._replay(when, float(around), std)
            best = max(best, found, key=lambda h: h.log_likelihood)
        found = yield from self._replay(when, best.mass, std)
        self._best = max(best, found, key=lambda h: h.log_likelihood)
        self._when, self._ahead = when, ahead[when]

    def _without(self) -> Generator[None, None, list[float]]:
        """Return what no change has gained more, seen from the samples kept, up to each."""
        if not self._sparse:
            return [0.0] * self._last
        ahead = [0.0]
        for k in range(1, self._last + 1):
            sample, kept = self._samples[k]
            self.stepper.step(self._unchanged, sample, True)
            ahead.append(self._unchanged.log_likelihood - kept.log_likelihood)
            yield
        return ahead

    def _replay(self, place: int, mass: float, std: float) -> Replay:
        """
        Return the hypothesis that the payload changed after one of the samples.

        Parameters
        ----------
        place : int
            Which sample.
        mass, std : float
            What the payload became, kg: the filter starts there.

        """
        h = self._samples[place][1].copy()
        jump = mass - h.mass
        self.stepper.reopen(h, std)
        h.mass = mass
        for k in range(place + 1, self._last + 1):
            sample = self._samples[k][0]
            self.stepper.predict(h, sample, True)
            if k == place + 1:
                # It changed somewhere within this sample.
                h.cov = h.cov + jump**2 / 12.0 * np.outer(h.sens[:, 0], h.sens[:, 0])
            self.stepper.correct(h, sample)
            yield
        return h
