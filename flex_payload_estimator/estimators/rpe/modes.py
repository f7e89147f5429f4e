"""
What may be wrong with the model, and every way from one such hypothesis to another.

A hypothesis is a mode: how far model and payload may be from what they are told to be. The
incumbent gives the estimate; trials run beside it from the incumbent's knowledge, and each may
take its place for what it gains in log-likelihood over it since it began:

* `moved`: the payload walks at random. Always one runs; where it loses it begins again. Where its
  gain was least is the time of a change (Page's cumulative sum, Biometrika 41, 1954).
* `still`: beside an incumbent whose payload walks, one whose payload stands still.
* `other`: the other modes take turns, and come at once where the incumbent does not fit.
* `again`: the incumbent's own mode from the prior, linearised about what the incumbent has found;
  it learns the samples of late once more and takes its place when it has caught up.
* `former`: what was incumbent before stays a while; it comes back with all it knows.

So no mode is left for good. The exact mode needs no gain, one with more freedom MODE_GAIN nats, a
change of the payload GAIN nats.
"""

from __future__ import annotations

import math

from flex_payload_estimator.estimators.rpe.evidence import belief, misfit_of
from flex_payload_estimator.estimators.rpe.filter import FilterStep
from flex_payload_estimator.estimators.rpe.hypothesis import Filter, Mode, Sample
from flex_payload_estimator.estimators.rpe.past import Past
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_payload_estimator.estimators.rpe.trial import Trial

# From the simplest to the one that allows most; `rough` by benchmarks/model_error.py and
# benchmarks/loop_band.py on tuning seeds, with three shapes a link.
MODES = (Mode('exact', False, 0.0, 0.0), Mode('rough', True, 0.1, 0.1),
         Mode('coarse', True, 0.6, 0.6))
EXACT, ROUGH = MODES[:2]
# At the start, and on trial, with less: what it is to find is where to linearise, and whether
# parts are off; a large model error hides that where the arm moves little.
SEEK = ROUGH._replace(gauge=0.05, drive=0.05)
LEVELS = {mode.name: place for place, mode in enumerate(MODES)}
# Nats that more freedom, a change of the payload among it, must gain: once in e^12 / 12
# independent trials by chance.
GAIN = 12.0
# In each mode so many times as much: a model's errors last, and each counts again.
WRONG = (1.0, 5.0, math.inf)
# And a wrong model that does not fit either, by this, tells of no change.
UNFIT = 2.0
# And what more freedom about the model must.
MODE_GAIN = 8.0
# A model is wrong for longer than a moment, s: a change of the payload shows at once.
PERSISTS_S = 0.1
# Nor is it judged while a payload that has just begun to walk is sought, s: of 16 drawn changes on
# a matched arm 12 were found without that time, 16 with it (benchmarks/payload_changes.py).
SEEKS_S = 0.2
# A simpler mode may be behind by this when its trial ends.
SIMPLER = 3.0
# And its whitened innovations' mean square is at most this: where it is more they are coloured.
FITS = 1.25
# A walking payload may be anywhere after WALK_S.
WALK_S = 1.0
# A filter of parts that follows its estimate learns from what it linearises on the way there. So
# after HOLD_S in motion one learns the same samples again, of PAST_S at most, linearised about
# what was found, REPLAY of them while one comes; ROUNDS times (Gauss and Newton's iteration). It
# is linearised afresh, and forgets nothing, whenever it has learnt for twice as long.
HOLD_S, ROUNDS = 0.5, 3
PAST_S, REPLAY = 10.0, 4
# Trials of other modes: their length, s; how often one begins, and how often where the
# incumbent's misfit is beyond MISFIT.
TRIAL_S, PAUSE_S, HASTE_S, MISFIT = 2.0, 2.0, 0.25, 1.4
# Between two modes that are both wrong a trial takes so many times as long, and even the simpler
# must gain: else they would take turns.
LONGER = 16.0
# No trial is longer than this, s.
LONGEST_S = 40.0
# A payload stands still when it has for STILL_S; where that lasts less than LASTS_S, for twice as
# long the next time.
STILL_S, LASTS_S = 0.3, 2.0
# After the start the simplest mode is not judged for this long, s.
WAIT_S = 0.4
# A filter that begins afresh settles in this time, s.
SETTLES_S = 0.1
# The trial of a walking payload begins again where it is behind by this, or after this long.
RESTART, RESTART_S = 2.0, 1.0
# A former incumbent stays for so many trials.
FORMER_TRIALS = 3
# The payload of a fresh start is known to this share of (m + soft mass): closely where it is
# linearised about what a wrong model knows, widely where that knew nothing of its errors.
CLOSE, FRESH = 0.05, 0.3
# And its state to this share of a start's standard deviation, beyond what the incumbent says.
DOUBT = 0.01


def level(mode: Mode) -> int:
    """Return how much freedom a mode has: its place among MODES."""
    return LEVELS[mode.name]


class Modes:
    """
    Incumbent and trials.

    Parameters
    ----------
    stepper : FilterStep

    Attributes
    ----------
    trials : list of Trial
    moved : Trial or None
        The one that told of the change that goes on.

    """

    def __init__(self, stepper: FilterStep):
        self.stepper = stepper
        self.walk = stepper.heaviest / math.sqrt(WALK_S) / 4.0
        self._past = Past(round(PAST_S / stepper.step_time))
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.trials: list[Trial] = []
        self._past.clear()
        self._turn, self._next = 0, 0.0
        self.moved: Trial | None = None
        self._stood, self._moved, self._patience = -math.inf, -math.inf, STILL_S

    def remember(self, sample: Sample, loads: Loads, excited: bool) -> None:
        """Keep a sample for those that begin again."""
        self._past.add(sample, loads, self.stepper.step_time if excited else 0.0)

    def missed(self, sample: Sample, loads: Loads, excited: bool) -> None:
        """Bring the trials across a sample without a measurement."""
        self.remember(sample, loads, excited)
        for trial in self.trials:
            if trial.kind != 'again':
                self.stepper.predict(trial.runner, sample, loads)

    def advance(self, incumbent: Filter, sample: Sample, loads: Loads, excited: bool
                ) -> Filter:
        """Step the trials over a sample that the incumbent has learnt; return who is next."""
        if sample.measured is None:
            self.missed(sample, loads, excited)
            return incumbent
        self.remember(sample, loads, excited)
        step = self.stepper.step_time if self.stepper.tells(incumbent, loads, ROUGH) else 0.0
        lived = self.stepper.step_time if excited else 0.0
        incumbent.age += lived
        for trial in self.trials:
            if trial.kind == 'again':
                self._replay(trial)
                continue
            self.stepper.step(trial.runner, sample, loads)
            trial.runner.age += lived
            took = step if trial.kind in ('other', 'former') else self.stepper.step_time
            trial.age, trial.time = trial.age + took, trial.time + self.stepper.step_time
            trial.square += took * trial.runner.square
            trial.gain += self._gained(trial, incumbent)
            if trial.kind == 'moved' and trial.gain < trial.lowest:
                trial.lowest, trial.since = trial.gain, sample.time
            if level(trial.runner.mode) > level(incumbent.mode):
                if sample.time - self._moved < SEEKS_S:
                    trial.gain = trial.age = 0.0
                # What it was behind before counts no longer: from now on the model may be wrong.
                if trial.gain <= 0.0 or trial.age < 0.0:
                    trial.gain = 0.0
                if trial.gain <= 0.0 < trial.age:
                    trial.gain, trial.age, trial.square = 0.0, 0.0, 0.0
            elif trial.kind == 'still' and trial.age < SETTLES_S:
                trial.gain = 0.0
        for trial in list(self.trials):
            if self._wins(trial, incumbent):
                return self._promote(trial, incumbent, sample.time)
            if self._over(trial, incumbent):
                self.trials.remove(trial)
        if excited:
            self._begin(incumbent, sample.time)
            if self._strays(incumbent):
                incumbent = self.stepper.about(incumbent)
        return incumbent

    def _replay(self, trial: Trial) -> None:
        """Let one that begins again learn the next few samples of the past."""
        for _ in range(REPLAY):
            if trial.place == self._past.end:
                return
            sample, loads, lived = self._past[trial.place]
            if sample.measured is None:
                self.stepper.predict(trial.runner, sample, loads)
            else:
                self.stepper.step(trial.runner, sample, loads)
            trial.runner.age, trial.place = trial.runner.age + lived, trial.place + 1

    def _strays(self, f: Filter) -> bool:
        """Tell whether a filter that has begun again often enough is to be linearised afresh."""
        if f.rounds < ROUNDS or f.mode.walk > 0.0:
            return False
        return f.model is None or f.age >= 2.0 * max(f.linearised, HOLD_S)

    def _gained(self, trial: Trial, incumbent: Filter) -> float:
        if trial.runner.mode.name == incumbent.mode.name:
            return trial.runner.stated - incumbent.stated
        return trial.runner.gained - incumbent.gained

    def _wins(self, trial: Trial, incumbent: Filter) -> bool:
        if trial.kind == 'again':
            return trial.place == self._past.end
        if trial.kind == 'still':
            return trial.age >= self._patience and trial.gain > -SIMPLER
        if trial.kind == 'moved':
            # Nor does one that still seeks where to linearise: its errors look like a change.
            fits = not incumbent.mode.parts or (
                incumbent.rounds == ROUNDS and misfit_of(incumbent.record) < UNFIT)
            return fits and trial.gain > GAIN * WRONG[level(incumbent.mode)]
        if trial.age < self._shortest(trial, incumbent):
            return False
        gain = trial.gain + belief(trial.runner.record) - belief(incumbent.record)
        if trial.runner.mode.parts:
            return gain > MODE_GAIN
        # What the incumbent knows of the payload is evidence too.
        apart = (trial.runner.mass - incumbent.mass)**2
        gain -= 0.5 * apart / (trial.runner.variance + incumbent.variance)
        return gain > -SIMPLER and trial.square < FITS * trial.age

    @staticmethod
    def _shortest(trial: Trial, incumbent: Filter) -> float:
        """Return how long a trial of another mode must have run to win, s."""
        if level(trial.runner.mode) > level(incumbent.mode):
            return PERSISTS_S
        return TRIAL_S * (LONGER if trial.runner.mode.parts else 1.0)

    def _over(self, trial: Trial, incumbent: Filter) -> bool:
        """Tell whether a trial that has not won is at its end; a former one begins again."""
        if trial.kind == 'again':
            return False
        if trial.kind == 'moved':
            return trial.gain < -RESTART or (trial.age > RESTART_S and trial.gain < RESTART)
        if trial.kind == 'still':
            return trial.gain < -GAIN
        long = TRIAL_S * (LONGER if trial.runner.mode.parts else 1.0)
        if trial.age >= long and trial.left > 0:
            if trial.gain < -GAIN and not trial.runner.mode.parts \
                    and trial.left < FORMER_TRIALS:
                # It may have learnt under a wrong noise: it begins afresh, knowing the noise.
                noise = trial.runner.record
                trial.runner = self._renewed(incumbent, trial.runner.mode)
                trial.runner.record[:-5] = noise[:-5]
            trial.left, trial.age, trial.gain, trial.square = trial.left - 1, 0.0, 0.0, 0.0
            return False
        lost = trial.gain < -GAIN and trial.left == 0
        return trial.age >= long or lost or trial.time >= LONGEST_S

    def _promote(self, trial: Trial, incumbent: Filter, time: float) -> Filter:
        """Return the new incumbent; one of another mode that it follows stays beside it."""
        new = trial.runner.mode.name != incumbent.mode.name
        kinds = ('other', 'former') if not new else ('other',)
        self.trials = [other for other in self.trials
                       if other is not trial and other.kind in kinds]
        for other in self.trials:
            other.gain -= trial.gain
        if trial.kind == 'moved':
            # A payload that stood still for a moment only goes on changing.
            hasty = time - self._stood < LASTS_S
            self._patience = min(2.0 * self._patience, LASTS_S) if hasty else STILL_S
            self.moved, self._moved = trial, time
            self._past.clear()
        elif trial.runner.mode.walk == 0.0 and trial.kind != 'again':
            self.moved, self._stood = None, time
            self._past.clear()
        if new:
            self.keep(incumbent, time)
        return trial.runner

    def keep(self, former: Filter, time: float, wait: float = 0.0) -> None:
        """Let one that is not the incumbent go on for a while, with no say for `wait`, s."""
        self.trials.append(Trial('former', former, time, former.mass, age=-wait,
                                 left=FORMER_TRIALS))

    def _begin(self, incumbent: Filter, time: float) -> None:
        """Begin the trials that should run and do not."""
        kinds = {trial.kind for trial in self.trials}
        walking = incumbent.mode.walk > 0.0
        if walking and 'still' not in kinds and time - self._moved > SETTLES_S:
            self._add('still', self._still(incumbent), incumbent, time)
        if not walking and 'moved' not in kinds and level(incumbent.mode) < 2:
            self._add('moved', self._as(incumbent, incumbent.mode, self.walk), incumbent, time)
        if 'again' not in kinds and not walking and incumbent.mode.name == ROUGH.name \
                and incumbent.rounds < ROUNDS and incumbent.age >= HOLD_S:
            self._again(incumbent, time)
        hasty = misfit_of(incumbent.record) > MISFIT
        if 'other' not in kinds and time >= self._next:
            mode = self._candidate(incumbent, hasty)
            self._next = time + (HASTE_S if hasty else PAUSE_S)
            known = [trial.runner.mode.name for trial in self.trials if trial.kind == 'former']
            if mode and mode.name not in known:
                self._add('other', self._converted(incumbent, mode), incumbent, time)

    def _candidate(self, incumbent: Filter, hasty: bool) -> Mode | None:
        """Return the mode whose turn it is; where the incumbent does not fit, a wronger one."""
        place = level(incumbent.mode)
        more = [mode for mode in MODES if level(mode) > place][:1]
        less = [mode for mode in MODES if level(mode) < place][::-1]
        if incumbent.mode.parts and (incumbent.rounds == 0 or not hasty):
            # One that still seeks its parts is not judged.
            more = []
        others = more if hasty and more else more + less
        self._turn += 1
        return others[self._turn % len(others)] if others else None

    def _add(self, kind: str, f: Filter, incumbent: Filter, time: float) -> None:
        self.trials.append(Trial(kind, f, time, incumbent.mass))

    def _again(self, incumbent: Filter, time: float) -> None:
        place = self._past.first
        sample, loads, _ = self._past[place]
        new = self.stepper.again(incumbent, ROUGH, FRESH, sample, loads)
        self.trials.append(Trial('again', new, time, incumbent.mass, place=place + 1))

    def _as(self, incumbent: Filter, mode: Mode, walk: float) -> Filter:
        f = self.stepper.freed(incumbent) if walk else incumbent.copy()
        f.mode = mode._replace(walk=walk)
        return f

    def _still(self, incumbent: Filter) -> Filter:
        """Return one whose payload stands still; an exact one is linearised afresh there."""
        mode = incumbent.mode._replace(walk=0.0)
        if mode.parts:
            return self._as(incumbent, mode, 0.0)
        return self._renewed(incumbent, mode)

    def _renewed(self, incumbent: Filter, mode: Mode) -> Filter:
        return self.stepper.renewed(incumbent, mode, FRESH, DOUBT)

    def _converted(self, incumbent: Filter, mode: Mode) -> Filter:
        """Return a filter of another mode: with less model error all is kept, else fresh."""
        if mode.parts and incumbent.mode.parts and level(mode) < level(incumbent.mode):
            return self._as(incumbent, mode, 0.0)
        return self._renewed(incumbent, SEEK if mode.name == ROUGH.name else mode)
