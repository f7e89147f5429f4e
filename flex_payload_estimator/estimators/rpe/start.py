"""The start: one filter at rest, then a bank over the range of payloads, until one is left."""

from __future__ import annotations

from dataclasses import replace
import math

from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.filter_step import FilterStep
from flex_payload_estimator.estimators.rpe.likelihood import (
    NOISE_RATIO,
    POOR_FIT,
    reduced_chi_square,
)
from flex_payload_estimator.estimators.rpe.misfit import misfits
from flex_payload_estimator.estimators.rpe.modes import EXACT, PARTS_FREE, ROUGH_ON_TRIAL
from flex_payload_estimator.estimators.rpe.restarts import (
    about_file,
    begin_at,
    hand_over_rest,
    RESTART_STATE_STD,
    restarted,
)
from flex_payload_estimator.estimators.rpe.sample_window import SampleWindow
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_payload_estimator.estimators.rpe.time_update import CORIOLIS
from flex_payload_estimator.estimators.rpe.transitions import MODES_OPEN_S
from flex_plant_sim.arm.second_order import Array
import numpy as np

# Filters linearised about payloads this close are taken for one, as a share of (m + soft mass).
SAME_LINEARISATION = 0.05
# So are shares of the forces of motion this close, where 0 is none of them and 1 all. Chosen.
SAME_SHARE = 0.2
# A filter this far behind the likeliest is given up, nats.
GIVE_UP_NATS = 15.0
# Memory of the log-likelihood that chooses the mode, s: until the noise is known, the whole
# log-likelihood says little.
RECENT_S = 0.25


class StartBank:
    """
    A bank of filters over the whole range of payloads.

    A filter is linearised about its payload, so that one alone, begun at 0.1 kg, is tens of
    standard deviations off at 0.3 kg. Until the arm first moves one is enough: all would learn
    the same of state, gauges and noise, and nothing of the payload.

    Parameters
    ----------
    stepper : FilterStep

    Attributes
    ----------
    filters : list of Filter
    at_rest : bool
        Whether the arm has not moved yet.
    prior_moments : tuple of float
        Mean and variance of the payload before any sample, kg and kg^2.

    """

    def __init__(self, stepper: FilterStep):
        self.stepper, self._share = stepper, min(1.0, stepper.step_time / RECENT_S)
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.filters: list[Filter] = []
        self.at_rest = True
        # The noise variance over that of the robot file with which the bank began, (m,).
        self._assumed_noise = np.ones(self.stepper.told_variance.size)

    def begin(self, measured: Array) -> None:
        """Begin at rest, with outputs (m,), and with any payload of the range."""
        self.at_rest = True
        self.filters = self.bank(measured)
        self.prior_moments = mass, variance = self.moments()
        self.filters = [self.stepper.begin(EXACT, measured, mass, math.sqrt(variance),
                                           self.stepper.shares[0])]

    def bank(self, measured: Array) -> list[Filter]:
        """Return filters of each payload cell: exact with each share of the forces, and rough."""
        bank = []
        for mode, shares in ((EXACT, self.stepper.shares), (PARTS_FREE, (None,))):
            for low, high in self.stepper.payload_cells():
                for share in shares:
                    f = self.stepper.begin(mode, measured, 0.5 * (low + high),
                                           0.5 * (high - low), share)
                    if mode.free_parts:
                        # About moving estimates it would seem to learn of the parts what it
                        # does not, and be sure of a payload that it began far from.
                        f = replace(f, model=about_file(f.beta, mode, self.stepper))
                    bank.append(f)
        return bank

    def leave_rest(self, last: Filter, window: SampleWindow, sample: Sample, loads: Loads) -> None:
        """
        Go on with the whole bank, which takes over what was learnt at rest.

        What a filter at rest makes of a motion holds for its payload alone, and for parts as
        told: the bank learns again what came before the motion showed.

        Parameters
        ----------
        last : Filter
            As it was before the sample.
        window : SampleWindow
            Its begin is what was known at rest, if it begins at rest.
        sample, loads : Sample, Loads
            The first sample that shows a motion, and the loads before it.

        """
        rested, self.at_rest = window.rested or last, False
        since = window.since_rest()
        self._assumed_noise = rested.noise_scale.copy()
        self.filters = self.bank(rested.innovations[0])
        for f in self.filters:
            hand_over_rest(rested, f)
            for stored in since:
                self.stepper.step(f, stored.sample, stored.loads)
                self._add_log_density(f)
            self.stepper.step(f, sample, loads)

    def restart_if_noisier(self, window: SampleWindow, sample: Sample, loads: Loads) -> None:
        """
        Begin the bank again where it has found that it began with far too little noise.

        What it was sure of by then is wrong, and it took what it saw next for a motion. The
        samples are not lost: a pass over the window learns them again. Only the angles tell,
        because links that swing look like noise of the gauges, in differences as well.

        Parameters
        ----------
        window : SampleWindow
            Its last samples bound the noise.
        sample, loads : Sample, Loads
            The last sample, and the loads before it.

        """
        limit = NOISE_RATIO * self._assumed_noise.item(0)
        if self.at_rest or sample.measured is None \
                or self.best().statistics.item(0) < limit:
            return
        noise = window.largest_noise(self.stepper.told_variance)
        if noise.item(0) < limit:
            return
        self._assumed_noise = np.maximum(noise, self._assumed_noise)
        self.filters = self.bank(sample.measured)
        for f in self.filters:
            f.noise_scale[:] = self._assumed_noise
            begin_at(f, sample, loads, None, self.stepper)

    @property
    def fits(self) -> bool:
        """Return whether the likeliest filter fits."""
        return self._fits(self.best())

    def best(self) -> Filter:
        """Return the likeliest filter."""
        return max(self.filters, key=lambda f: f.log_likelihood)

    def select(self, excited: bool) -> list[Filter]:
        """
        Add the last sample's log-likelihoods, drop unlikely filters, and return who is left.

        The likeliest filter of each mode stays. Of the others of its mode, those stay that are
        likely, linearised elsewhere, and no older than MODES_OPEN_S in motion; exact ones, while
        the mode itself is likely. What is still open then, such as forces of motion too small to
        show, a later trial settles. Returns one filter a mode, the first incumbent first, once no
        mode has more than one; else none.
        """
        if self.at_rest:
            return []
        for f in self.filters:
            f.age += self.stepper.step_time if excited else 0.0
            self._add_log_density(f)
        kept: list[Filter] = []
        top = self.best().log_likelihood
        for f in sorted(self.filters, key=lambda f: -f.log_likelihood):
            same = [other for other in kept if other.mode == f.mode]
            # Free parts are behind while noise hides the parts, and the best of them by then may
            # be linearised anywhere: they give up by their own best alone.
            one_is_enough = f.age >= MODES_OPEN_S or not f.mode.free_parts \
                and f.log_likelihood < top - GIVE_UP_NATS
            if not same or not (one_is_enough
                                or f.log_likelihood < same[0].log_likelihood - GIVE_UP_NATS
                                or self._is_same_linearisation(f, same)):
                kept.append(f)
        self.filters = kept
        if len(kept) > len({f.mode for f in kept}):
            return []
        # An exact model that does not fit may still lead by what it was ahead before.
        kept.sort(key=lambda f: (not f.mode.free_parts and not self._fits(f),
                                 -f.recent_log_likelihood))
        return [self._checked(f, kept[0], top) for f in kept]

    def _add_log_density(self, f: Filter) -> None:
        f.log_likelihood += f.log_density
        f.recent_log_likelihood += f.log_density - self._share * f.recent_log_likelihood

    def _checked(self, f: Filter, first: Filter, top: float) -> Filter:
        """Return a filter, or a restarted one where it cannot have learnt well."""
        if not f.mode.free_parts:
            return f if self._has_learnt_well(f) \
                else restarted(f, f.mode, RESTART_STATE_STD, self.stepper)
        # Free parts contain the exact model: they are behind it only if they went astray. Where
        # they do not fit, more than parts is off.
        fits = self._fits(f)
        if fits and (f is first or f.log_likelihood > top - GIVE_UP_NATS):
            return f
        new = restarted(first, ROUGH_ON_TRIAL, RESTART_STATE_STD, self.stepper)
        if not fits:
            # That is no better for being forgotten: it counts until a pass learns it again.
            new.misfit = misfits(f, self.stepper.prior)[0]
        return new

    def _has_learnt_well(self, f: Filter) -> bool:
        """Tell whether a filter fits, and the noise was about what it was taken for."""
        limit = NOISE_RATIO * self._assumed_noise
        return self._fits(f) and bool((f.noise_scale < limit).all())

    @staticmethod
    def _fits(f: Filter) -> bool:
        return reduced_chi_square(f.statistics) < POOR_FIT

    def _is_same_linearisation(self, f: Filter, others: list[Filter]) -> bool:
        """Tell whether a filter is linearised about the same as one of others."""
        width = SAME_LINEARISATION * (f.mass + self.stepper.schedule.soft_mass)
        return f.variance < width**2 and any(
            abs(f.mass - other.mass) < width
            and abs(f.beta[CORIOLIS] - other.beta[CORIOLIS]) < SAME_SHARE for other in others)

    def moments(self) -> tuple[float, float]:
        """
        Return mean and variance of the payload over the bank, kg and kg^2.

        The filters are weighted by their likelihoods. Where the likeliest does not fit, or needs
        more noise than the bank began with, its innovations are no noise and its likelihood says
        nothing about modes: both modes then weigh the same.
        """
        logs = np.array([f.log_likelihood + f.log_density for f in self.filters])
        if not self._has_learnt_well(self.filters[int(logs.argmax())]):
            parts = np.array([f.mode.free_parts for f in self.filters])
            for mode in np.unique(parts):
                logs[parts == mode] -= logs[parts == mode].max()
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        found = np.array([self.stepper.published(f) for f in self.filters])
        mean = float(weights @ found[:, 0])
        return mean, float(weights @ (found[:, 1] + (found[:, 0] - mean)**2))
