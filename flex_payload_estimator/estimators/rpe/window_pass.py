"""
Passes over the sample window: filters that learn its samples again from the prior on.

A filter that is linearised about its running estimate learns from its first samples what it
linearises the later ones about. A pass learns the same samples linearised about one point, that
which was found before: Gauss and Newton's iteration. A pass advances a few samples for each new
one, until it has caught up; competition.py then decides what becomes of its filters.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.filter_step import FilterStep
from flex_payload_estimator.estimators.rpe.likelihood import (
    false_alarm_threshold,
    POOR_FIT,
    reduced_chi_square,
)
from flex_payload_estimator.estimators.rpe.linearised import LinearisedModel
from flex_payload_estimator.estimators.rpe.modes import (
    EXACT,
    EXACT_BENDING,
    freedom,
    Mode,
    MODES,
    PARTS_FREE,
)
from flex_payload_estimator.estimators.rpe.restarts import (
    about_cells,
    begin_at,
    restarted,
    restarted_at,
)
from flex_payload_estimator.estimators.rpe.sample_window import SampleWindow, StoredSample
from flex_payload_estimator.estimators.rpe.time_update import CORIOLIS
from flex_payload_estimator.estimators.rpe.trial import SETTLING_S, Trial
import numpy as np

# Samples of the window that a pass learns for each new sample.
SAMPLES_PER_STEP = 4
# The first pass begins after so long in motion, s.
FIRST_PASS_S = 0.5


@dataclass(eq=False)
class PassFilter:
    """
    A filter that learns the window again.

    Attributes
    ----------
    kalman : Filter
        Its Kalman filter.
    log_densities : list of float
        Log-likelihood of each sample learnt, nats; see Filter.log_density.

    """

    kalman: Filter
    log_densities: list[float] = field(default_factory=list)


@dataclass(eq=False)
class WindowPass:
    """
    Filters that learn the window again, until they have caught up with the newest sample.

    Attributes
    ----------
    filters : list of PassFilter
    place : int
        Number of the next sample.
    finds_exact : bool
        Whether it is a pass of an exact model beside an incumbent with free parts, which only
        finds where to linearise the exact model.
    compares : bool
        Whether exact models and one with free parts compete by their marginal likelihoods.
    trial : Trial or None
        Trial of the exact model that is compared, if there is one.

    """

    filters: list[PassFilter]
    place: int
    finds_exact: bool = False
    compares: bool = False
    trial: Trial | None = None

    @property
    def best(self) -> PassFilter:
        """Return the likeliest filter."""
        return max(self.filters, key=lambda candidate: candidate.kalman.log_likelihood)

    def advance(self, window: SampleWindow, stepper: FilterStep) -> bool:
        """Learn the next few samples; return whether none is left."""
        for _ in range(SAMPLES_PER_STEP):
            if self.place == window.end:
                break
            for candidate in self.filters:
                self._learn(candidate, window[self.place], stepper)
            self.place += 1
        return self.place == window.end

    def exact_is_behind(self, window: SampleWindow, threshold: float) -> bool:
        """
        Tell whether free parts lead every exact model of a comparison by a threshold, nats.

        Only in the later half of the window: an earlier burst of noise sets an exact model back,
        and it catches up later.
        """
        if not self.compares or 2 * self.place < window.first + window.end:
            return False
        # Less the handicap of exact models, see `comparison`.
        exact = [candidate.kalman.log_likelihood + threshold for candidate in self.filters
                 if not candidate.kalman.mode.free_parts]
        return self.best.kalman.log_likelihood > max(exact) + threshold

    def log_ratio(self, window: SampleWindow, since: float) -> float:
        """Return the log-likelihood ratio of the best over the incumbent after a time, s."""
        return sum(log_density - stored.log_density for log_density, stored in self._learnt(window)
                   if stored.sample.time > since)

    def store_log_densities(self, window: SampleWindow) -> None:
        """Make the log-likelihoods of the best those of the window's incumbent."""
        for log_density, stored in self._learnt(window):
            stored.log_density = log_density

    def _learnt(self, window: SampleWindow) -> list[tuple[float, StoredSample]]:
        """Return what the best made of the window's samples; others may be dropped by now."""
        densities = self.best.log_densities[-(window.end - window.first):]
        return list(zip(densities, window.newest(len(densities))))

    @staticmethod
    def _learn(candidate: PassFilter, stored: StoredSample, stepper: FilterStep) -> None:
        f = candidate.kalman
        if stored.sample.measured is None:
            stepper.predict(f, stored.sample, stored.loads)
        else:
            stepper.step(f, stored.sample, stored.loads)
            f.log_likelihood += f.log_density
        f.age += stored.time_in_motion
        candidate.log_densities.append(f.log_density)


def gauss_newton_pass(f: Filter, window: SampleWindow, stepper: FilterStep) -> WindowPass | None:
    """
    Return a pass of a filter's own mode about its estimate; None where it knows too little yet.

    It begins after FIRST_PASS_S in motion: of the window, and of the filter where the window does
    not begin at rest. After a lost state the filter has learnt more than the window holds. An
    exact model that does not fit begins as soon as it has settled, because it may be linearised
    about the wrong payload.
    """
    unfit = not f.mode.free_parts and reduced_chi_square(f.statistics) > POOR_FIT
    # `coarse` begins while the arm moves, and free parts begin again in the start: the window
    # counts, not their own time, if it begins with a state that is known.
    by_window = freedom(f.mode) == 2 or f.mode.free_parts and window.rested is not None
    learnt = window.time_in_motion if by_window else min(f.age, window.time_in_motion)
    if min(f.age, window.time_in_motion) < SETTLING_S or learnt < FIRST_PASS_S and not unfit:
        return None
    return WindowPass(_variants(f, window, stepper), window.first + 1)


def exact_search(f: Filter, window: SampleWindow, stepper: FilterStep) -> WindowPass:
    """Return a pass of an exact model linearised about the payload of one with free parts."""
    stored = window[window.first]
    new = restarted(f, EXACT, 0.0, stepper)
    # Free parts take noise for their model error. With too little noise the exact model would be
    # sure of a wrong state and take all that follows for a motion; too much soon shows.
    new.noise_scale[:] = np.maximum(np.maximum(new.noise_scale, stored.noise_scale),
                                    window.largest_noise(stepper.told_variance))
    begin_at(new, stored.sample, stored.loads, window.rested, stepper)
    return WindowPass([PassFilter(new)], window.first + 1, finds_exact=True)


def repeated_exact_search(exact: Filter, window: SampleWindow, stepper: FilterStep) -> WindowPass:
    """Return a pass of an exact model whose trial has failed, linearised about what it found."""
    return WindowPass(_variants(exact, window, stepper), window.first + 1, finds_exact=True)


def comparison(exact: Filter, f: Filter, window: SampleWindow, stepper: FilterStep,
               trial: Trial | None = None) -> WindowPass:
    """
    Return a pass in which exact models compete with one of free parts.

    Each begins from its prior and is linearised about its own estimate, so that the marginal
    likelihood charges free parts for the width of their prior (Occam's factor). They have hardly
    a model error: beside the model error of `rough`, any exact model would be the likelier.

    Parameters
    ----------
    exact : Filter
        An exact model.
    f : Filter
        The incumbent, with free parts.
    window : SampleWindow
        What is learnt again.
    stepper : FilterStep
        Model and prior.
    trial : Trial or None
        Of the exact model.

    """
    base = exact.copy()
    base.passes = 0
    filters = _variants(base, window, stepper)
    # Whoever takes the incumbent's place must lead by the false-alarm threshold: a handicap.
    for candidate in filters:
        candidate.kalman.log_likelihood -= false_alarm_threshold(stepper.step_time)
    filters.append(_from_prior(f, PARTS_FREE, float(f.beta[CORIOLIS]), window, stepper))
    return WindowPass(filters, window.first + 1, compares=True, trial=trial)


def _variants(f: Filter, window: SampleWindow, stepper: FilterStep) -> list[PassFilter]:
    """
    Return f's mode from the prior on, about what f found; at its first pass, each variant.

    Variants of an exact model have one of the possible shares of the forces of motion, or bending
    links; of one with free parts, any payload, because a model that is wrong, or that was, may
    have led f to where Gauss and Newton's iteration does not come back from.
    """
    mode = MODES[freedom(f.mode)] if f.mode.free_parts else f.mode
    share = float(f.beta[CORIOLIS])
    if f.mode.free_parts or f.passes > 0:
        filters = [_from_prior(f, mode, share, window, stepper)]
        for model in [] if f.passes > 0 else about_cells(f, mode, stepper):
            filters.append(_from_prior(f, mode, share, window, stepper, model))
            # It must lead by the false-alarm threshold.
            filters[-1].kalman.log_likelihood = -false_alarm_threshold(stepper.step_time)
        return filters
    filters = [_from_prior(f, mode, share, window, stepper) for share in stepper.shares]
    if stepper.has_bending:
        filters.append(_from_prior(f, EXACT_BENDING, stepper.shares[-1], window, stepper))
        # What the robot file does not name must lead by the false-alarm threshold.
        if mode != EXACT_BENDING:
            filters[-1].kalman.log_likelihood = -false_alarm_threshold(stepper.step_time)
    return filters


def _from_prior(f: Filter, mode: Mode, share: float, window: SampleWindow, stepper: FilterStep,
                model: LinearisedModel | None = None) -> PassFilter:
    """Return a filter at the window's begin, linearised about a model, or f's estimate."""
    stored, base = window[window.first], f.copy()
    base.mode, base.beta[CORIOLIS] = mode, share
    # The noise may have been larger then than it is now.
    base.noise_scale[:] = np.maximum(base.noise_scale, stored.noise_scale)
    return PassFilter(
        restarted_at(base, stored.sample, stored.loads, window.rested, stepper, model))
