"""Those that learn the samples of late again, linearised about what was found."""

from __future__ import annotations

from dataclasses import dataclass, field

from flex_payload_estimator.estimators.rpe.evidence import belief, misfit_of, rare
from flex_payload_estimator.estimators.rpe.filter import FilterStep
from flex_payload_estimator.estimators.rpe.hypothesis import (
    EXACT,
    Filter,
    level,
    Mode,
    MODES,
    NATURAL,
    PARTS,
)
from flex_payload_estimator.estimators.rpe.kernel import CORIOLIS
from flex_payload_estimator.estimators.rpe.past import Moment, Past
from flex_payload_estimator.estimators.rpe.trial import SETTLES_S, Trial
import numpy as np

# Samples that are learnt again while one comes.
PACE = 4
# A filter that follows its estimate learns from what it linearises on the way there. So after
# HOLD_S in motion one learns the same samples again, linearised about what was found; ROUNDS times
# (Gauss and Newton's iteration). Whenever the time learnt has doubled, `rough` is linearised
# afresh and forgets nothing; `coarse`, whose first seconds were linearised about what a wrong
# model had found, learns again from the prior on.
HOLD_S, ROUNDS = 0.5, 3
# An exact model does at once where its misfit is beyond this and it had the time to settle: it may
# not have found where to linearise. A wronger one goes on trial.
MISFIT = 1.4
# A payload that stands still may be behind one that walks by this.
SIMPLER = 3.0
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

    """

    runner: Filter
    told: list[float] = field(default_factory=list)

    @property
    def evidence(self) -> float:
        """Return the log of its marginal likelihood, noise and all."""
        return self.runner.log + belief(self.runner.record)


@dataclass(eq=False)
class Replay:
    """
    Filters that learn the past again, until they have caught up with the present.

    Attributes
    ----------
    runners : list of Relearner
        The likeliest counts.
    place : int
        Number of the next sample.
    sought : bool
        Whether it is an exact model beside one of parts, that finds where to linearise.
    judged : bool
        Whether exact models and one of parts compete here.
    former : Trial or None
        The exact model on trial that is judged.

    """

    runners: list[Relearner]
    place: int
    sought: bool = False
    judged: bool = False
    former: Trial | None = None

    @property
    def best(self) -> Relearner:
        """Return the likeliest."""
        return max(self.runners, key=lambda one: one.evidence)

    def lost(self, past: Past, gain: float) -> bool:
        """
        Tell whether the one of parts leads every exact one by so much, nats.

        In the later half: a burst of noise before sets an exact one back, which then catches up.
        """
        if not self.judged or 2 * self.place < past.first + past.end:
            return False
        # The exact ones begin as far behind as they must lead in the end.
        exact = [one.evidence + gain for one in self.runners if not one.runner.mode.parts]
        return self.best.evidence > max(exact) + gain

    def advance(self, past: Past, stepper: FilterStep) -> bool:
        """Learn the next few samples; return whether none is left."""
        for _ in range(PACE):
            if self.place == past.end:
                break
            for one in self.runners:
                self._learn(one, past[self.place], stepper)
            self.place += 1
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
    def _learn(one: Relearner, moment: Moment, stepper: FilterStep) -> None:
        f = one.runner
        if moment.sample.measured is None:
            stepper.predict(f, moment.sample, moment.loads)
        else:
            stepper.step(f, moment.sample, moment.loads)
            f.log += f.gained
        f.age += moment.lived
        one.told.append(f.gained)


def again(f: Filter, past: Past, stepper: FilterStep) -> Replay | None:
    """Return a filter's own mode from the prior on, linearised about what it has found."""
    unfit = not f.mode.parts and misfit_of(f.record) > MISFIT
    # Where `coarse` begins, another has moved already.
    learnt = past.lived if level(f.mode) == 2 else f.age
    if min(f.age, past.lived) < SETTLES_S or learnt < HOLD_S and not unfit:
        return None
    return Replay(_forms(f, past, stepper), past.first + 1)


def _forms(f: Filter, past: Past, stepper: FilterStep) -> list[Relearner]:
    """Return its own mode; which forces of motion an exact one has is open the first time."""
    mode = MODES[level(f.mode)] if f.mode.parts else f.mode
    if f.mode.parts or f.rounds > 0:
        return [_from_prior(f, mode, float(f.beta[CORIOLIS]), past, stepper)]
    runners = [_from_prior(f, mode, share, past, stepper) for share in stepper.shares]
    if stepper.bends:
        runners.append(_from_prior(f, NATURAL, stepper.shares[-1], past, stepper))
        # What the robot file does not name must show.
        if mode != NATURAL:
            runners[-1].runner.log = -rare(stepper.step_time)
    return runners


def _from_prior(f: Filter, mode: Mode, share: float, past: Past, stepper: FilterStep
                ) -> Relearner:
    moment, base = past[past.first], f.copy()
    base.mode, base.beta[CORIOLIS] = mode, share
    # The noise may have been larger than it is now.
    base.noise[:] = np.maximum(base.noise, moment.noise)
    return Relearner(stepper.again(base, FRESH, moment.sample, moment.loads, past.rested))


def exact_beside(f: Filter, past: Past, stepper: FilterStep) -> Replay:
    """Return an exact model that begins about what one of parts has found."""
    moment, new = past[past.first], stepper.renewed(f, EXACT, CLOSE, 0.0)
    # One of parts takes noise for its model error. What begins with too little is sure of a
    # state that is wrong, and all it sees then looks like a motion; too much soon shows.
    new.noise[:] = np.maximum(np.maximum(new.noise, moment.noise),
                              past.most_noise(stepper.told_variance))
    stepper.begin_at(new, moment.sample, moment.loads, past.rested)
    return Replay([Relearner(new)], past.first + 1, sought=True)


def exact_again(exact: Filter, past: Past, stepper: FilterStep) -> Replay:
    """Return an exact model that one of parts has outdone, linearised about what it found."""
    return Replay(_forms(exact, past, stepper), past.first + 1, sought=True)


def judged(exact: Filter, f: Filter, past: Past, stepper: FilterStep,
           former: Trial | None = None) -> Replay:
    """
    Return exact models and one of parts, each from the prior on, about what it has found.

    What parts may be costs them their prior's width (Occam's factor). They have hardly a model
    error: beside one that the arm has not, any exact model is the likelier.
    """
    base = exact.copy()
    base.rounds = 0
    runners = _forms(base, past, stepper)
    # Whoever takes the incumbent's place must gain what is rare.
    for one in runners:
        one.runner.log -= rare(stepper.step_time)
    runners.append(_from_prior(f, PARTS, float(f.beta[CORIOLIS]), past, stepper))
    return Replay(runners, past.first + 1, judged=True, former=former)


def strays(f: Filter) -> bool:
    """Tell whether a `rough` one that has learnt again is to be linearised afresh."""
    if f.rounds < ROUNDS or f.mode.walk > 0.0 or level(f.mode) != 1:
        return False
    return f.age >= (HOLD_S if f.model is None else 2.0 * max(f.linearised, HOLD_S))
