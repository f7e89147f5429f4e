"""Those that learn the samples of late again, linearised about what was found."""

from __future__ import annotations

from dataclasses import dataclass, field

from flex_payload_estimator.estimators.rpe.evidence import belief, misfit_of, rare
from flex_payload_estimator.estimators.rpe.filter import FilterStep
from flex_payload_estimator.estimators.rpe.hypothesis import EXACT, Filter, NATURAL, ROUGH
from flex_payload_estimator.estimators.rpe.kernel import CORIOLIS
from flex_payload_estimator.estimators.rpe.past import Moment, Past
import numpy as np

# Samples that are learnt again while one comes.
PACE = 4
# A filter that follows its estimate learns from what it linearises on the way there. So after
# HOLD_S in motion one learns the same samples again, linearised about what was found; ROUNDS times
# (Gauss and Newton's iteration). One of parts is linearised afresh, and forgets nothing, whenever
# it has learnt for twice as long.
HOLD_S, ROUNDS = 0.5, 3
# An exact model does at once where its misfit is beyond this and it had the time, s, to settle:
# it may not have found where to linearise. A wronger one goes on trial.
MISFIT, SETTLES_S = 1.4, 0.1
# A simpler mode may be behind by this when its trial ends.
SIMPLER = 3.0
# And its whitened innovations' mean square is at most this: where it is more they are coloured.
FITS = 1.25
# The payload of a fresh start is known to this share of (m + soft mass): closely where it is
# linearised about what a wrong model knows, widely where that knew nothing of its errors.
CLOSE, FRESH = 0.05, 0.3
# And its state to this share of a start's standard deviation, beyond what the incumbent says.
DOUBT = 0.01


@dataclass(eq=False)
class Relearner:
    """
    A filter that learns the past again.

    Attributes
    ----------
    runner : Filter
    told : list
        Log-likelihood of each sample.
    gain, square : float
        Where it is judged: log-likelihood over the incumbent's, and sum of its whitened
        innovations' mean squares.

    """

    runner: Filter
    told: list[float] = field(default_factory=list)
    gain: float = 0.0
    square: float = 0.0


@dataclass(eq=False)
class Replay:
    """
    Filters that learn the past again, until one has caught up with the present.

    Attributes
    ----------
    runners : list of Relearner
        Of one mode, exact ones with other forces of motion; the likeliest counts.
    place : int
        Number of the next sample.
    since : int
        From which sample on another mode is judged: it has learnt on those before.
    tested : bool
        Whether it is another mode than the incumbent's.
    judged : int
        Samples from `since` on.

    """

    runners: list[Relearner]
    place: int
    since: int
    tested: bool
    judged: int = 0

    @property
    def best(self) -> Relearner:
        """Return the likeliest."""
        return max(self.runners, key=lambda one: one.runner.log)

    def advance(self, past: Past, stepper: FilterStep) -> bool:
        """Learn the next few samples; return whether none is left."""
        for _ in range(PACE):
            if self.place == past.end:
                break
            moment = past[self.place]
            judged = self.place >= self.since and moment.sample.measured is not None
            for one in self.runners:
                self._learn(one, moment, stepper, judged)
            self.judged, self.place = self.judged + judged, self.place + 1
        return self.place == past.end

    def lead(self, past: Past, since: float) -> float:
        """Return what the best has gained over the incumbent after a time, s."""
        gain = 0.0
        for number, told in enumerate(reversed(self.best.told), 1):
            moment = past[past.end - number]
            if moment.sample.time <= since:
                break
            gain += told - moment.gained
        return gain

    def hand_in(self, past: Past) -> None:
        """Let the best be the incumbent of the past."""
        for number, told in enumerate(reversed(self.best.told), 1):
            past[past.end - number].gained = told

    @staticmethod
    def _learn(one: Relearner, moment: Moment, stepper: FilterStep, judged: bool) -> None:
        f = one.runner
        if moment.sample.measured is None:
            stepper.predict(f, moment.sample, moment.loads)
        else:
            stepper.step(f, moment.sample, moment.loads)
            f.log += f.gained
        f.age += moment.lived
        one.told.append(f.gained)
        if judged:
            one.gain += f.gained - moment.gained
            one.square += f.square


def again(f: Filter, past: Past, stepper: FilterStep) -> Replay | None:
    """
    Return a filter's own mode from the prior on, linearised about what it has found.

    Which forces of motion an exact model has is open until the first time.
    """
    open_forces = f.rounds == 0 and not f.mode.parts
    unfit = not f.mode.parts and misfit_of(f.record) > MISFIT
    if min(f.age, past.lived) < SETTLES_S or f.age < HOLD_S and not unfit:
        return None
    moment, runners = past[past.first], []
    mode = ROUGH if f.mode.parts else f.mode
    forms = [(share, mode) for share in stepper.shares] if open_forces else \
        [(float(f.beta[CORIOLIS]), mode)]
    if open_forces and stepper.bends:
        forms.append((stepper.shares[-1], NATURAL))
    for share, form in forms:
        base = f.copy()
        base.mode, base.beta[CORIOLIS] = form, share
        runner = stepper.again(base, FRESH, moment.sample, moment.loads, past.rested)
        # What the robot file does not name must show.
        runner.log = 0.0 if form == mode else -rare(stepper.step_time)
        runners.append(Relearner(runner))
    return Replay(runners, past.first + 1, past.end, False)


def exact_beside(f: Filter, past: Past, stepper: FilterStep) -> Replay:
    """Return an exact model that begins about what one of parts has found."""
    moment, new = past[past.first], stepper.renewed(f, EXACT, CLOSE, 0.0)
    # One of parts knows no noise that is less than it was told.
    new.record[:-5] = np.maximum(new.record[:-5], 1.0)
    stepper.begin_at(new, moment.sample, moment.loads, past.rested)
    return Replay([Relearner(new)], past.first + 1, (past.first + past.end) // 2, True)


def as_good(exact: Filter, incumbent: Filter, gain: float, square: float) -> bool:
    """Tell whether an exact model that gained so much fits, and does as well as another."""
    # What the incumbent knows of the payload is evidence too.
    apart = (exact.mass - incumbent.mass)**2
    gain -= 0.5 * apart / (exact.variance + incumbent.variance)
    gain += belief(exact.record) - belief(incumbent.record)
    return gain > -SIMPLER and square < FITS
