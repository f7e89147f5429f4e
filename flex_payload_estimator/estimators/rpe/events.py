"""Has the payload changed? A score test, a search that confirms it, and the changes found."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

from flex_payload_estimator.estimators.rpe.hypothesis import Hypothesis, Sample
from flex_payload_estimator.estimators.rpe.search import Change, Recent, Search, STEPS_PER_S
from flex_payload_estimator.estimators.rpe.stepper import Stepper

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
    step_time : float
        From sample to sample, s; marked or not.

    """

    def __init__(self, stepper: Stepper, block: int, nats: float, step_time: float):
        self.stepper, self.block, self.nats = stepper, block, nats
        self.recent = Recent(2 * block + 2)
        self._stride = max(1, block // 5)
        self._budget = math.ceil(STEPS_PER_S * step_time)
        self._search: Search | None = None
        self._pause = 0

    @property
    def busy(self) -> bool:
        """Tell whether a search goes on."""
        return self._search is not None

    def quiet(self, samples: int) -> None:
        """Look for nothing for a while."""
        self._pause = samples

    def forget(self) -> None:
        """Forget the recent past, and what was searched for in it."""
        self.recent.forget()
        self._search = None

    def record(self, sample: Sample, active: Hypothesis) -> None:
        """Keep a sample that `active` has seen."""
        self.recent.record(sample, active)
        if self._search:
            self._search.add(self.recent.samples[-1])

    def search_on(self) -> None:
        """Go on with a search, if there is one: once a sample."""
        if self._search:
            self._search.advance(self._budget)

    def look(self, active: Hypothesis) -> Change | None:
        """Return a change that is certain enough, or None: once a recorded sample."""
        self._pause = max(0, self._pause - 1)
        exact = self.stepper.levels[active.level].exact
        if self._search is None:
            self._begin(active, exact)
        if self._search is None:
            return None
        self.search_on()
        change = self._search.result()
        if self._search.active is not active:
            self._search = None
        if change is None or self._search is None:
            return None
        self._search, self._pause = None, self._stride
        return change if self._holds(change, active, exact) else None

    def _begin(self, active: Hypothesis, exact: bool) -> None:
        """Begin a search where the windows give reason to."""
        gain, step = self._score(active, exact)
        # A payload that may drift follows any change by itself.
        if gain < self.limit(active, exact) or self._pause or len(self.recent.samples) < 2 \
                or self.stepper.levels[active.level].drift:
            return
        guess = min(max(active.mass + step, 0.0), self.stepper.heaviest)
        self._search = Search(self.stepper, self.recent, active, guess, self._stride)

    def _holds(self, change: Change, active: Hypothesis, exact: bool) -> bool:
        """Tell whether a change is certain, and large enough to be one."""
        if change.gain < self.limit(active, exact) or not self._clear(change, active, exact):
            return False
        if abs(change.hypothesis.mass - active.mass) < self.smallest(active):
            # No payload that anybody took or left: the model is not exact.
            active.misfit = max(active.misfit, 2.0 * EXPLAINED)
            return False
        change.hypothesis.watch(active.windows.emptied())
        return True

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
