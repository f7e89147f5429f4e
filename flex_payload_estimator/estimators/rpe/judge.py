"""What follows from a marked sample: a smaller bank, changes of payload, closed blocks."""

from __future__ import annotations

from dataclasses import replace
import math

from flex_payload_estimator.estimators.rpe.bank import Bank
from flex_payload_estimator.estimators.rpe.events import ChangeDetector, Event, EventLog
from flex_payload_estimator.estimators.rpe.hypothesis import Hypothesis, Sample
from flex_payload_estimator.estimators.rpe.levels import start_spread
from flex_payload_estimator.estimators.rpe.pace import Pace
from flex_payload_estimator.estimators.rpe.settings import RpeSettings
from flex_payload_estimator.estimators.rpe.windows import PERSISTENT

# What a window must tell about a payload change of a sixth of the heaviest: five sigma.
EXCITED = 25.0


class Judge:
    """
    Decides about hypotheses, at marks.

    Parameters
    ----------
    pace : Pace
    bank : Bank
    settings : RpeSettings

    Attributes
    ----------
    log : EventLog
        Payload changes.
    excited : bool
        The last window told of the payload.

    """

    def __init__(self, pace: Pace, bank: Bank, settings: RpeSettings):
        self.pace, self.bank, self.settings = pace, bank, settings
        self.stepper, self._spread = pace.coarse, start_spread(pace.coarse.effects.arm)
        self._block = max(2, round(settings.block_s / pace.mark_time))
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.detector = ChangeDetector(self.stepper, self._block, self.settings.event_nats,
                                       self.pace.sample_time)
        self.log = EventLog(2 * self._block * self.pace.mark_time)
        self.excited, self._marks = False, 0
        self._unchanged: Hypothesis | None = None
        self._likely: Event | None = None

    def forget(self) -> None:
        """Forget the recent past."""
        self.detector.forget()

    def keep(self, mark: Sample | None) -> None:
        """Keep a mark for the search."""
        if mark:
            self.detector.record(mark, self.bank.best())

    def weigh(self, mark: Sample) -> None:
        """Let a bank learn from a mark, and drop what it makes unlikely."""
        for h in self.bank.hypotheses:
            self.stepper.correct(h, mark)
        self.bank.prune()

    def conclude(self, mark: Sample | None) -> None:
        """Look for a change, a step further at each sample; most is done at marks."""
        if mark is None:
            self.detector.search_on()
            return
        bank, detector = self.bank, self.detector
        self._confirm(mark.time)
        if self.pace.stride > 1 and len(bank.hypotheses) == 1 and not detector.recent.sparse:
            # From here on the only filter left takes every sample.
            detector.forget()
            detector.recent.sparse = True
        active = bank.best()
        self.keep(mark)
        self._marks += 1
        if bank.decided and not self._change(active, mark.time):
            # What is searched for may explain the misfit: until then it is only counted.
            patience = math.inf if detector.busy else self._block // 2
            if bank.widen(self._spread, patience, detector.recent):
                detector.forget()
        if self._marks % self._block == 0:
            self._turn(1 + self._marks // self._block % 2, mark.time)

    def _change(self, active: Hypothesis, now: float) -> bool:
        """Look for a change of payload, and let it compete with none."""
        change = self.detector.look(active)
        if change is None:
            return False
        limit = self.detector.limit(active, self.stepper.levels[active.level].exact)
        # It must gain as much again before it is believed: most that are none gain no more.
        change.hypothesis.log_likelihood -= limit
        self.bank.rival(change.hypothesis, 2 * self._block, 5.0 * limit)
        self._unchanged = active
        self._likely = Event(change.time, now, active.mass, change.hypothesis.mass)
        self.detector.forget()
        self.detector.quiet(self._block)
        return True

    def _confirm(self, now: float) -> None:
        """Tell of a change once it is the likeliest; take it back where it does not stay so."""
        if self._unchanged is None:
            return
        best = self.bank.best()
        if self._likely and best is not self._unchanged:
            self.log.notice(replace(self._likely, found=now, after=best.mass))
            self._likely = None
        if len(self.bank.hypotheses) == 1:
            if best is self._unchanged:
                if self._likely is None:
                    self.log.take_back()
                self.detector.forget()
            self._unchanged = self._likely = None

    def _turn(self, column: int, now: float) -> None:
        """Close a block; where it told nothing of the payload, let the payload walk."""
        best, span = self.bank.best(), self._block * self.pace.mark_time
        told = best.sums[1, column] * (self.stepper.heaviest / 6.0)**2
        self.excited = bool(told > EXCITED)
        self.bank.lively_blocks += self.excited
        if not self.bank.lively_blocks:
            # At rest the likelihoods compare only how a vague start fits.
            self.bank.level_weights()
        walk = self.settings.rest_drift**2 * span
        for h in self.bank.hypotheses:
            if not self.excited and h.variance < (self.stepper.heaviest / 6.0)**2:
                self.stepper.drift(h, walk)
            self.stepper.turn(h, column)
            step = self.stepper.follow_trend(h)
            # What is learnt in the first windows is no drift.
            if h is best and abs(step) > self.detector.smallest(h) and \
                    self._marks > 2 * PERSISTENT * self._block:
                self.log.notice(Event(now - PERSISTENT * span, now, h.mass, h.mass + step))
        drifted = self.bank.drifted(best)
        if drifted and abs(best.mass - drifted[1]) > self.detector.smallest(best):
            self.log.notice(Event(drifted[0], now, drifted[1], best.mass))
        self.bank.settle()
