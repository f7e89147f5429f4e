"""The start: one filter at rest, then filters over the range of payloads, until one is left."""

from __future__ import annotations

import math

from flex_payload_estimator.estimators.rpe.evidence import misfit_of, NOISIER
from flex_payload_estimator.estimators.rpe.filter import CELLS, FilterStep
from flex_payload_estimator.estimators.rpe.hand_over import hand_over
from flex_payload_estimator.estimators.rpe.hypothesis import EXACT, Filter, PARTS, Sample, SEEK
from flex_payload_estimator.estimators.rpe.kernel import CORIOLIS
from flex_payload_estimator.estimators.rpe.modes import OPEN_S
from flex_payload_estimator.estimators.rpe.past import Past
from flex_payload_estimator.estimators.rpe.replay import CLOSE, DOUBT, FRESH, MISFIT
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_plant_sim.arm.second_order import Array
import numpy as np

# Filters linearised about payloads this close agree: a share of (m + soft mass).
FINE = 0.05
# Behind by this, nats, a filter is given up.
BEHIND = 15.0
# Which mode fits is told by the last so many seconds: the noise must be known first.
RECENT_S = 0.25


class Start:
    """
    A bank of filters that starts over the whole range of payloads.

    A filter is linearised about its payload, so one alone, started at 0.1 kg, is tens of standard
    deviations off at 0.3 kg. Until the arm first moves one is enough: all would know the same of
    state, gauges and noise, and nothing of the payload.

    Parameters
    ----------
    stepper : FilterStep

    Attributes
    ----------
    filters : list of Filter
    at_rest : bool
        Whether the arm has not moved yet.
    moments_before : tuple of float
        Mean and variance of the payload before any sample, kg and kg^2.

    """

    def __init__(self, stepper: FilterStep):
        self.stepper, self._share = stepper, min(1.0, stepper.step_time / RECENT_S)
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.filters: list[Filter] = []
        self.at_rest = True
        self._noise = np.ones(self.stepper.told_variance.size)

    def begin(self, measured: Array) -> None:
        """Begin at rest, anywhere on the range of payloads."""
        self.at_rest = True
        self.filters = self.bank(measured)
        self.moments_before = mass, variance = self.moments()
        self.filters = [self.stepper.begin(EXACT, measured, mass, math.sqrt(variance),
                                           self.stepper.shares[0])]

    def bank(self, measured: Array) -> list[Filter]:
        """Return filters of payloads from 0 to the heaviest, with and without Coriolis forces."""
        bank = []
        for mode, shares in ((EXACT, self.stepper.shares), (PARTS, (None,))):
            for low, high in self.stepper.cells(CELLS):
                bank += [self.stepper.begin(mode, measured, 0.5 * (low + high),
                                            0.5 * (high - low), share) for share in shares]
        return bank

    def leave_rest(self, rested: Filter, sample: Sample, loads: Loads) -> None:
        """
        Go on with the whole bank, which knows of state, gauges and noise what one has learnt.

        Parameters
        ----------
        rested : Filter
            As it was before the sample: what it makes of a motion holds for its payload alone.
        sample, loads : Sample, Loads
            The first that shows a motion.

        """
        self.at_rest = False
        self._noise = rested.noise.copy()
        self.filters = self.bank(rested.reading[0])
        for f in self.filters:
            hand_over(rested, f)
            self.stepper.step(f, sample, loads)

    def heed(self, past: Past, sample: Sample, loads: Loads) -> None:
        """
        Begin the bank anew where it has found that it began with far too little noise.

        What it was sure of by then is wrong, and what it saw next it took for a motion. What is
        dropped is learnt again, see modes.py. Angles tell: links that swing look like noise of
        the gauges, in differences as well.

        Parameters
        ----------
        past : Past
            The samples of late.
        sample, loads : Sample, Loads
            The last one.

        """
        known = NOISIER * self._noise.item(0)
        if self.at_rest or sample.measured is None or self.best().record.item(0) < known:
            return
        noise = past.most_noise(self.stepper.told_variance)
        if noise.item(0) < known:
            return
        self._noise = np.maximum(noise, self._noise)
        self.filters = self.bank(sample.measured)
        for f in self.filters:
            f.noise[:] = self._noise
            self.stepper.begin_at(f, sample, loads, None)

    def best(self) -> Filter:
        """Return the likeliest filter."""
        return max(self.filters, key=lambda f: f.log)

    def decide(self, excited: bool) -> list[Filter]:
        """
        Take the last sample's evidence and drop what is unlikely within its mode.

        Of a mode that is behind another the likeliest is enough, and of each after OPEN_S in
        motion: what is open then, such as Coriolis forces too small to show, another trial of the
        mode settles when it shows. Returns one filter a mode, the likeliest first, once no mode
        has more; else none.
        """
        if self.at_rest:
            return []
        for f in self.filters:
            f.age += self.stepper.step_time if excited else 0.0
            f.log += f.gained
            f.recent += f.gained - self._share * f.recent
        kept: list[Filter] = []
        top = self.best().log
        for f in sorted(self.filters, key=lambda f: -f.log):
            same = [other for other in kept if other.mode == f.mode]
            enough = f.log < top - BEHIND or f.age >= OPEN_S
            if not same or not (enough or f.log < same[0].log - BEHIND
                                or self._agrees(f, same)):
                kept.append(f)
        self.filters = kept
        if len(kept) > len({f.mode for f in kept}):
            return []
        kept.sort(key=lambda f: -f.recent)
        return [self._sound(f, kept[0], top) for f in kept]

    def _sound(self, f: Filter, first: Filter, top: float) -> Filter:
        """Return a filter, or one that begins afresh where it cannot have learnt well."""
        if not f.mode.parts:
            return f if self._learnt_well(f) else self._again(f)
        # With more freedom than another it can only be behind where it went astray; and where it
        # does not fit, more than parts is off.
        fits = misfit_of(f.record) < MISFIT and (f is first or f.log > top - BEHIND)
        return f if fits else self.stepper.renewed(first, SEEK, FRESH, DOUBT)

    def _learnt_well(self, f: Filter) -> bool:
        """Tell whether the noise was about what it was taken for while it learnt."""
        known = NOISIER * self._noise
        return misfit_of(f.record) < MISFIT and bool((f.noise < known).all())

    def _again(self, f: Filter) -> Filter:
        """Return a filter that begins afresh where one is, knowing the noise."""
        return self.stepper.renewed(f, f.mode, CLOSE, DOUBT)

    def _agrees(self, f: Filter, others: list[Filter]) -> bool:
        """Tell whether a filter is linearised about the same as one of others."""
        width = FINE * (f.mass + self.stepper.schedule.soft_mass)
        return f.variance < width**2 and any(
            abs(f.mass - other.mass) < width
            and abs(f.beta[CORIOLIS] - other.beta[CORIOLIS]) < 0.2 for other in others)

    def moments(self) -> tuple[float, float]:
        """
        Return mean and variance of the payload, kg and kg^2.

        The filters count by their evidence. An exact model that needs more noise than it was told,
        or does not fit, has none: its innovations are no noise. The modes then count alike.
        """
        logs = np.array([f.log + f.gained for f in self.filters])
        if not self._learnt_well(self.filters[int(logs.argmax())]):
            parts = np.array([f.mode.parts for f in self.filters])
            for mode in np.unique(parts):
                logs[parts == mode] -= logs[parts == mode].max()
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        found = np.array([self.stepper.payload(f) for f in self.filters])
        mean = float(weights @ found[:, 0])
        return mean, float(weights @ (found[:, 1] + (found[:, 0] - mean)**2))
