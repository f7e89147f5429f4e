"""The incumbent beside trials of other hypotheses; transitions.py has the rules."""

from __future__ import annotations

import math

from flex_payload_estimator.estimators.rpe import transitions
from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.filter_step import FilterStep
from flex_payload_estimator.estimators.rpe.likelihood import false_alarm_threshold
from flex_payload_estimator.estimators.rpe.misfit import (
    disagreement,
    misfits,
    payload_score,
    pooled_misfit,
)
from flex_payload_estimator.estimators.rpe.modes import freedom, Mode, ROUGH
from flex_payload_estimator.estimators.rpe.restarts import (
    in_other_mode,
    linearised_every_sample,
    PASSES,
    relinearised,
    with_constant_payload,
    with_payload_walk,
)
from flex_payload_estimator.estimators.rpe.sample_window import SampleWindow, StoredSample
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_payload_estimator.estimators.rpe.transitions import FREER_MODE_S, Situation
from flex_payload_estimator.estimators.rpe.trial import SETTLING_S, Trial
from flex_payload_estimator.estimators.rpe.window_pass import (
    comparison,
    exact_search,
    gauss_newton_pass,
    repeated_exact_search,
    WindowPass,
)
import numpy as np

# A walking payload may be anywhere on its range after this, s. Of a Gaussian 95 % are within a
# range of so many standard deviations.
WALK_S, RANGE_DEVIATIONS = 1.0, 4.0
# Length of the sample window at least, s.
WINDOW_S = 10.0
# A payload counts as constant after CONSTANT_S, s. Where the next change comes within
# SAME_CHANGE_S, s, the last one goes on, and the payload has to be constant for twice as long.
CONSTANT_S, SAME_CHANGE_S = 0.1, 2.0


class ModeCompetition:
    """
    The trials beside the incumbent, and who is the next incumbent.

    Parameters
    ----------
    stepper : FilterStep

    Attributes
    ----------
    window : SampleWindow
    trials : list of Trial
    ongoing_change : Trial or None
        The trial that found the change of the payload that is going on.
    reported_change : Trial or None
        The same once it may be reported, because a model that is wrong would have shown by now:
        FREER_MODE_S later, or when the payload is constant, and for `_settling_s` from then on,
        because a filter that begins afresh does not know at once how large the change was.

    """

    def __init__(self, stepper: FilterStep):
        self.stepper, self._threshold = stepper, false_alarm_threshold(stepper.step_time)
        self.walk = stepper.payload_max / math.sqrt(WALK_S) / RANGE_DEVIATIONS
        self._told_noise = np.ones(stepper.told_variance.size)
        self.window = SampleWindow(round(WINDOW_S / stepper.step_time))
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.trials: list[Trial] = []
        self.window.clear()
        self._pass: WindowPass | None = None
        # Time in the window at the last attempt at `exact`, s.
        self._last_attempt = 0.0
        self._time_in_motion, self._misfit = 0.0, 1.0
        # The last `rough` that led `coarse` to the end of its trial and does not fit.
        self._dissent: list[Filter] = []
        self.ongoing_change: Trial | None = None
        self.reported_change: Trial | None = None
        self._constant_since, self._change_found = -math.inf, -math.inf
        self._constant_s = CONSTANT_S

    def remember(self, sample: Sample, loads: Loads, excited: bool, f: Filter | None = None
                 ) -> None:
        """Put a sample into the window, with what an incumbent f made of it."""
        time = sample.steps * self.stepper.step_time if excited else 0.0
        log_density, noise = (f.log_density, f.noise_scale.copy()) if f \
            else (0.0, self._told_noise)
        self.window.add(StoredSample(sample, loads, time, log_density, noise))
        self._time_in_motion += time if sample.measured is not None else 0.0

    def variance_factor(self, incumbent: Filter) -> float:
        """Return D of an incumbent, with the misfit of those before it in the window; keep it."""
        own, factor = misfits(incumbent, self.stepper.prior)
        self._misfit = pooled_misfit(own, incumbent.age, incumbent.misfit,
                                     min(self._time_in_motion, WINDOW_S))
        factor = max(self._misfit, factor)
        leading = transitions.leading_with_less_freedom(self._situation(incumbent))
        return factor * max([1.0, *(disagreement(incumbent, factor, other)
                                    for other in self._dissent + leading)])

    def predict(self, sample: Sample, loads: Loads, excited: bool) -> None:
        """Bring the trials across a sample without a measurement."""
        self.remember(sample, loads, excited)
        for trial in self.trials:
            for f in trial.filters:
                self.stepper.predict(f, sample, loads)

    def advance(self, incumbent: Filter, sample: Sample, loads: Loads, excited: bool) -> Filter:
        """Step the trials over a sample that the incumbent has learnt; return the next one."""
        if sample.measured is None:
            self.predict(sample, loads, excited)
            return incumbent
        self.remember(sample, loads, excited, incumbent)
        if self.ongoing_change and sample.time - self._change_found >= FREER_MODE_S:
            self.reported_change = self.ongoing_change
        elif self.ongoing_change \
                or sample.time - self._constant_since >= _settling_s(incumbent.mode):
            self.reported_change = None
        time = self.stepper.step_time if excited else 0.0
        incumbent.age += time
        self._step_trials(incumbent, sample, loads, excited)
        now = self._situation(incumbent)
        for trial in list(self.trials):
            if transitions.wins(trial, now):
                return self._promote(trial, incumbent, sample.time)
            if transitions.has_failed(trial, now):
                self._end(trial, incumbent)
        incumbent = self._advance_pass(incumbent, sample.time)
        if excited:
            self._begin_trials(incumbent, sample.time)
            self._pass = self._pass or self._next_pass(incumbent)
            if transitions.relinearisation_due(incumbent) and not now.window_holds_all:
                incumbent = relinearised(incumbent, self.stepper)
                self._drop_walks()
        return incumbent

    def _situation(self, incumbent: Filter) -> Situation:
        return Situation(incumbent, self.trials, self.window, self._time_in_motion,
                         self._constant_s, self._threshold, self.stepper.prior)

    def _step_trials(self, incumbent: Filter, sample: Sample, loads: Loads, excited: bool
                     ) -> None:
        """Let the trials learn a sample; at rest, only those of a constant payload."""
        if not excited:
            # At rest nothing tells one payload, or one model, from another.
            self.trials = [trial for trial in self.trials if trial.kind == 'constant']
        for trial in self.trials:
            self._step(trial, incumbent, sample, loads, excited)

    def _step(self, trial: Trial, incumbent: Filter, sample: Sample, loads: Loads,
              excited: bool) -> None:
        """Let a trial learn a sample, and add its log-likelihood ratio."""
        step = self.stepper.step_time
        for f in trial.filters:
            self.stepper.step(f, sample, loads)
        if trial.kind == 'change':
            self._let_jump(trial, sample, loads)
        trial.kalman.age += step if excited else 0.0
        trial.add(step, trial.sample_log_ratio(incumbent))
        if trial.is_cusum(incumbent) and trial.log_ratio <= 0.0:
            trial.restart_sum(sample.time, self._misfit, payload_score(incumbent))
            if trial.kind == 'change' and (trial.judged is None) != (incumbent.model is None):
                # It jumped for nothing.
                trial.kalman, trial.judged = with_payload_walk(incumbent, self.walk)
        elif trial.is_settling and not trial.is_cusum(incumbent):
            trial.log_ratio = 0.0

    def _let_jump(self, trial: Trial, sample: Sample, loads: Loads) -> None:
        """
        Let a walking payload jump.

        It is judged where it is then; so is one that has left what the incumbent's linearisation
        holds for.
        """
        after = self.stepper.after_jump(trial.kalman, sample, loads)
        left = trial.judged and self.stepper.is_beyond_gate(trial.judged.mean_square)
        if after is not trial.kalman or left:
            trial.kalman, trial.judged = after, None

    def _begin_trials(self, incumbent: Filter, time: float) -> None:
        """Begin the trials that should run and do not."""
        kinds = [trial.kind for trial in self.trials]
        walking = incumbent.mode.payload_walk > 0.0
        if walking and 'constant' not in kinds:
            for f in with_constant_payload(incumbent, self.stepper):
                self._add_trial('constant', f, incumbent, time)
        if not walking and 'change' not in kinds:
            walk, judged = with_payload_walk(incumbent, self.walk)
            self._add_trial('change', walk, incumbent, time, judged)
        for mode in transitions.modes_to_try(incumbent):
            if not any(trial.kind == 'mode' and freedom(trial.kalman.mode) == freedom(mode)
                       for trial in self.trials):
                last = self.window[self.window.end - 1]
                f = in_other_mode(incumbent, mode, last, self.stepper)
                self._add_trial('mode', f, incumbent, time)

    def _add_trial(self, kind: str, f: Filter, incumbent: Filter, time: float,
                   judged: Filter | None = None) -> None:
        self.trials.append(Trial(kind, f, time, incumbent.mass, self._misfit,
                                 payload_score(incumbent), judged=judged))

    def keep(self, former: Filter, time: float) -> None:
        """Let a former incumbent, or the second of the start, go on as a trial."""
        self._add_trial('mode', former, former, time)

    def _end(self, trial: Trial, incumbent: Filter) -> None:
        """End a trial; an exact model may be linearised wrongly, and seeks a better point."""
        self.trials.remove(trial)
        exact = trial.kind == 'mode' and not trial.kalman.mode.free_parts
        if trial.has_less_freedom(incumbent) and not exact:
            self._dissent = [trial.kalman] if trial.log_ratio > self._threshold else []
        if exact and incumbent.mode.payload_walk == 0.0 and not self._pass:
            self._pass = repeated_exact_search(trial.kalman, self.window, self.stepper)

    def _promote(self, trial: Trial, incumbent: Filter, time: float) -> Filter:
        """
        Make a trial the incumbent, and return its filter.

        Trials of other modes go on where the mode stays, and count from the new incumbent; an
        incumbent of another mode goes on as a trial.
        """
        new_mode = trial.kalman.mode.name != incumbent.mode.name
        self.trials = [other for other in self.trials if other.kind == 'mode'
                       and other is not trial and not new_mode and trial.kind != 'constant']
        for other in self.trials:
            log_ratio = other.log_ratio - trial.log_ratio
            other.log_ratio = max(log_ratio, 0.0) if other.is_cusum(trial.kalman) else log_ratio
        if trial.kind == 'change':
            # A payload that was constant for a moment only goes on changing.
            goes_on = time - self._constant_since < SAME_CHANGE_S
            self._constant_s = min(2.0 * self._constant_s, SAME_CHANGE_S) if goes_on \
                else CONSTANT_S
            self.ongoing_change, self._change_found = trial, time
            self.window.clear()
        elif trial.kalman.mode.payload_walk == 0.0:
            self._end_change(trial, incumbent, time)
        self._pass, self._last_attempt = None, 0.0
        if new_mode or trial.kind == 'change':
            self._dissent = []
        if new_mode:
            # What `exact` did not fit, free parts may; and `exact` wins over the whole window.
            trial.kalman.misfit = self._misfit if freedom(trial.kalman.mode) == 2 else 1.0
            self.keep(incumbent, time)
        return trial.kalman

    def _end_change(self, trial: Trial, incumbent: Filter, time: float) -> None:
        """Report the change that is over, or forget what another mode explains."""
        constant = trial.kind == 'constant'
        self.reported_change = self.ongoing_change if constant else None
        if constant:
            # It is linearised by what it learns of this payload from now on.
            trial.kalman.age = trial.kalman.age_linearised = 0.0
            # Before the change: what it has done to the innovations since is no misfit.
            trial.kalman.misfit = self.ongoing_change.misfit if self.ongoing_change else 1.0
        # Another mode of an arm whose payload was constant all the time ends no change.
        if self.ongoing_change:
            self._constant_since = time
        self.ongoing_change = None
        # What `coarse` allows for may have been there all the time: its window stays. What drove
        # it off was over when the trial of `rough` began.
        if constant or freedom(trial.kalman.mode) == 1:
            over = trial.has_less_freedom(incumbent)
            self.window.drop_before(trial.since if over else math.inf)

    def _next_pass(self, f: Filter) -> WindowPass | None:
        """Return the pass over the window that is due beside an incumbent, if any."""
        window, stepper = self.window, self.stepper
        if f.mode.payload_walk > 0.0 or window.first == window.end:
            return None
        if not f.mode.free_parts:
            return gauss_newton_pass(f, window, stepper) if f.passes < PASSES else None
        now = self._situation(f)
        for trial in transitions.exact_trials(now):
            if transitions.exact_trial_is_compared(trial, now):
                return comparison(trial.kalman, f, window, stepper, trial)
        due = transitions.exact_attempt_is_due(now, self._last_attempt)
        search = due and transitions.exact_can_be_searched(f)
        if f.passes < PASSES and not search:
            return gauss_newton_pass(f, window, stepper)
        if not due:
            again = transitions.relinearisation_due(f) and now.window_holds_all
            return gauss_newton_pass(f, window, stepper) if again else None
        self._last_attempt = window.time_in_motion
        if search:
            return exact_search(f, window, stepper)
        # Over a window that begins in the middle of a motion, the parts are thrown far off.
        return gauss_newton_pass(f, window, stepper) if window.is_complete else None

    def _advance_pass(self, incumbent: Filter, time: float) -> Filter:
        """Advance the pass over the window, and return the incumbent after it."""
        if self._pass and self._pass.place < self.window.first:
            # The sample that it would learn next has been dropped.
            self._pass = None
        if self._pass and self._pass.advance(self.window, self.stepper):
            return self._conclude_pass(self._pass, incumbent, time)
        if self._pass and self._pass.exact_is_behind(self.window, self._threshold):
            self._reject_exact(self._pass)
        return incumbent

    def _conclude_pass(self, done: WindowPass, incumbent: Filter, time: float) -> Filter:
        """Return the incumbent after a pass that has caught up."""
        self._pass, best = None, done.best.kalman
        if done.finds_exact:
            if transitions.found_exact_is_compared(best, incumbent):
                self._pass = comparison(best, incumbent, self.window, self.stepper)
            return incumbent
        if done.compares:
            if not transitions.to_exact(done, self._situation(incumbent)):
                self._reject_exact(done)
                return incumbent
            done.store_log_densities(self.window)
            trial = done.trial if done.trial in self.trials else None
            return self._promote(trial or Trial('mode', best, time, incumbent.mass), incumbent,
                                 time)
        # Other modes must beat the better incumbent.
        self._drop_walks()
        for trial in self.trials:
            trial.log_ratio -= done.log_ratio(self.window, trial.since)
        done.store_log_densities(self.window)
        last = best.passes >= PASSES and not best.mode.free_parts
        return linearised_every_sample(best) if last else best

    def _drop_walks(self) -> None:
        """Let a walk begin again from what is known now, and linearised as the incumbent is."""
        self.trials = [trial for trial in self.trials if trial.kind == 'mode']

    def _reject_exact(self, done: WindowPass) -> None:
        """End a comparison that the free parts have won, and the exact model's trial."""
        self._pass = None
        self.trials = [trial for trial in self.trials if trial is not done.trial]


def _settling_s(mode: Mode) -> float:
    """
    Return how long a filter that begins afresh needs to know its payload, s.

    Information goes as time over the square of the model error; up to that of `rough`, the sensors
    set it.
    """
    return SETTLING_S * max(1.0, mode.gauge_error / ROUGH.gauge_error)**2
