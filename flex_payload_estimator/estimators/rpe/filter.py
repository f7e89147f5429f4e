"""A filter of the joint posterior: what one hypothesis about the arm knows, and how it learns."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any, NamedTuple

from flex_payload_estimator.estimators.rpe.effects import EffectStep
from flex_payload_estimator.estimators.rpe.evidence import misfit_of, new_record, weigh
from flex_payload_estimator.estimators.rpe.kernel import (
    CORIOLIS,
    correct,
    FIRST_BIAS,
    MASS,
    predict,
    step,
    walk,
    without_bias,
)
from flex_payload_estimator.estimators.rpe.prior import Prior, SHARE_STD, SHARES
from flex_payload_estimator.estimators.rpe.schedule import PayloadSchedule
from flex_payload_estimator.estimators.rpe.sensors import Loads, speed_feedback
from flex_plant_sim.arm.second_order import Array
import numpy as np

# e' Sigma^-1 e beyond which a sample's noise counts as larger: six normal draws squared sum to
# more once in 10^7 samples.
GATE = 44.0


class Mode(NamedTuple):
    """
    What a hypothesis takes to be wrong with the model.

    Attributes
    ----------
    name : str
    parts : bool
        Parts and gauge gains may be off within their tolerances.
    gauge, drive : float
        Model error of what a gauge sees and of a drive's net torque, as a share of its root mean
        square of late; white, in ERROR_STEP_S.
    walk : float
        Random walk of the payload, kg per square root of a second.

    """

    name: str
    parts: bool
    gauge: float
    drive: float
    walk: float = 0.0


# What a wrong model says of the parts is forgotten in this time, s: its error is no noise, and
# more of it tells no more.
MEMORY_S = 10.0
# A model error of so many standard deviations of the noise tells between modes.
TELLING = 3.0
# The model error is white with the density of a share that is drawn afresh every 10 ms.
ERROR_STEP_S = 0.01


class Sample(NamedTuple):
    """
    A sample: time, s; outputs, rad and m/m, (m,), or None; command at the drives, (2,).

    `doubt` is the variance of that command, (2,) or 0.
    """

    time: float
    measured: Array | None
    command: Array
    doubt: Array | float = 0.0


@dataclass(slots=True)
class Filter:
    """
    One hypothesis; its arrays are replaced at every step, never changed.

    Attributes
    ----------
    mode : Mode
    x, cov, sens, beta, spread : Array
        See kernel.py.
    record : Array
        What `evidence.weigh` remembers.
    innovation, variances : Array
        Of the last sample, rad and m/m, and squared, (m,).
    log, recent, gained, stated : float
        Log-likelihood since it began, of late, and of the last sample as judged and as stated, see
        `evidence.weigh`.
    square : float
        Mean square of the last sample's whitened innovations.

    """

    mode: Mode
    x: Array
    cov: Array
    sens: Array
    beta: Array
    spread: Array
    record: Array
    innovation: Array
    variances: Array
    log: float = 0.0
    recent: float = 0.0
    gained: float = 0.0
    stated: float = 0.0
    square: float = 1.0

    @property
    def mass(self) -> float:
        """Return the payload, kg."""
        return float(self.beta[MASS])

    @property
    def variance(self) -> float:
        """Return the variance of the payload's error, kg^2."""
        return float(self.spread[MASS, MASS])

    def copy(self) -> Filter:
        """Return an independent filter that knows the same."""
        return Filter(self.mode, self.x, self.cov, self.sens, self.beta, self.spread,
                      self.record, self.innovation, self.variances, self.log, self.recent,
                      self.gained, self.stated, self.square)


class FilterStep:
    """
    Steps filters.

    Parameters
    ----------
    schedule : PayloadSchedule
    turning : Array
        See schedule.turning_rows.
    prior : Prior
    effects : EffectStep
    told : Array
        Standard deviation of each channel, rad and m/m, (m,).
    torque : Array
        Told process noise in the command's unit, (2,).
    heaviest : float
        kg.
    start : Array
        Standard deviation of the state at the start, (n,).

    """

    def __init__(self, schedule: PayloadSchedule, turning: Array, prior: Prior,
                 effects: EffectStep, told: Array, torque: Array, heaviest: float, start: Array):
        self.schedule, self.turning, self.prior, self.effects = schedule, turning, prior, effects
        self.exact, self.heaviest, self.start_cov = prior.exact(), heaviest, np.diag(start**2)
        free = prior.std[CORIOLIS] >= SHARE_STD
        self.shares = SHARES if free else (float(prior.mean[CORIOLIS]),)
        self.bias_std = prior.std[FIRST_BIAS:FIRST_BIAS + told.size - 2].copy()
        self.told_variance, self._torque = told**2, torque**2
        self.output = np.ascontiguousarray(effects.output_matrix())
        self.step_time = effects.arm.step_time
        self._forgotten = min(1.0, self.step_time / MEMORY_S)
        self._prior_spread = prior.spread(0.0)[1:, 1:]
        self._density = ERROR_STEP_S / self.step_time
        self._speed = speed_feedback(effects.arm)
        self._no_parts, self._no_offset = np.zeros((0, 1)), np.zeros(told.size)
        # Where nothing comes between prediction and correction one call does both.
        self.plain = not (effects.moves or effects.arm.acts_on_output)

    def prior_of(self, mode: Mode) -> Prior:
        """Return the prior of the columns that a mode has."""
        return self.prior if mode.parts else self.exact

    def begin(self, mode: Mode, measured: Array, mass: float, std: float,
              share: float | None = None) -> Filter:
        """Return a filter of an arm that is anywhere and knows of the payload mass, std, kg."""
        prior, channels = self.prior_of(mode), measured.size
        x, beta = np.zeros(len(self.start_cov)), prior.mean.copy()
        x[:2], beta[MASS] = measured[:2], mass
        if share is not None:
            beta[CORIOLIS] = share
        return Filter(mode, x, self.start_cov, np.zeros((x.size, beta.size)), beta,
                      prior.spread(std), new_record(channels), np.zeros(channels),
                      np.full(channels, np.inf))

    def predict(self, f: Filter, sample: Sample, loads: Loads) -> None:
        """Advance one sample."""
        before, payload = f.x, f.mass
        self._fade(f)
        f.x, f.cov, f.sens = predict(*self._before(f, sample, loads))
        variance = f.mode.walk**2 * self.step_time
        if variance > 0.0:
            f.cov, f.sens, f.spread = walk(f.cov, f.sens, f.spread, variance)
        if self.effects.moves:
            f.x = self.effects.push(self.schedule.cut(payload).payload, before, f.x,
                                    sample.command, sample.time - self.step_time)

    def drift(self, f: Filter, variance: float) -> None:
        """Let the payload walk at random, kg^2."""
        f.cov, f.sens, f.spread = walk(f.cov, f.sens, f.spread, variance)

    def payload(self, f: Filter) -> tuple[float, float]:
        """Return payload and variance, kg and kg^2; a misfit counts as that much variance."""
        mass, variance = without_bias(f.beta, f.spread, self.bias_std)
        variance = float(variance)
        if f.mode.parts:
            variance = (variance + self.prior_of(f.mode).considered(f.spread)) \
                * max(1.0, misfit_of(f.record))
        return float(mass), variance + self.prior_of(f.mode).scale_variance * float(mass)**2

    def _fade(self, f: Filter) -> None:
        """Let what a wrong model says of parts fade, towards their prior."""
        if f.mode.parts:
            spread = f.spread.copy()
            spread[1:, 1:] += self._forgotten * (self._prior_spread - spread[1:, 1:])
            f.spread = spread

    def _before(self, f: Filter, sample: Sample, loads: Loads) -> tuple[Any, ...]:
        piece, parts = self.schedule.cut(f.beta[MASS]), self._no_parts
        if f.mode.parts:
            parts = self.schedule.parts_at(f.beta[MASS], f.x[1])
        torque = np.sqrt(self._torque + sample.doubt
                         + f.mode.drive**2 * self._density * loads.drive)
        return (f.x, f.cov, f.sens, f.beta, self.schedule.order, piece.value, piece.slopes,
                parts, f.beta[MASS] - piece.payload, sample.command, self.turning, torque)

    def _after(self, f: Filter, sample: Sample, loads: Loads) -> tuple[Any, ...]:
        noise = self.told_variance * f.record[:self.told_variance.size] \
            + f.mode.gauge**2 * self._density * loads.strain
        return (sample.measured, self._offset(f.x, sample.time), self.output, noise,
                self.prior.gains if f.mode.parts else 0, GATE, self.heaviest)

    def step(self, f: Filter, sample: Sample, loads: Loads) -> None:
        """Advance one sample, and learn from it."""
        if self.plain:
            self._fade(f)
            variance = f.mode.walk**2 * self.step_time
            before = self._before(f, sample, loads)
            arguments: tuple[Any, ...] = (*before[:4], f.spread, *before[4:], variance,
                                          *self._after(f, sample, loads))
            self._take(f, sample, step(*arguments))
            return
        self.predict(f, sample, loads)
        self.correct(f, sample, loads)

    def correct(self, f: Filter, sample: Sample, loads: Loads) -> None:
        """Learn from a sample that was predicted."""
        self._take(f, sample, correct(f.x, f.cov, f.sens, f.beta, f.spread,
                                      *self._after(f, sample, loads)))

    def _take(self, f: Filter, sample: Sample, found: tuple[Any, ...]) -> None:
        x, cov, sens, beta, spread, innovation, variances, scores, log_det = found
        if not math.isfinite(log_det + x.sum() + spread[MASS, MASS]):
            self.relocate(f, sample.measured)
            return
        f.x, f.cov, f.sens, f.beta, f.spread = x, cov, sens, beta, spread
        f.record, f.gained, f.stated = weigh(f.record, innovation, f.innovation, variances, scores,
                                             log_det, self.told_variance, GATE, self.step_time)
        f.innovation, f.variances = innovation, variances
        f.square = min(scores @ scores, GATE) / scores.size

    def _offset(self, x: Array, time: float) -> Array:
        """Return what the sensors' effects add to C x, (m,)."""
        arm = self.effects.arm
        if not arm.acts_on_output:
            return self._no_offset
        return np.asarray(arm.output(x, time) - self.output @ x)

    def net_command(self, f: Filter, command: Array) -> Array:
        """Return the drives' net torques in the command's unit, (2,)."""
        return command - self._speed @ f.x

    def renewed(self, f: Filter, mode: Mode, fresh: float, doubt: float) -> Filter:
        """
        Return a filter of another mode at the state of one, which has forgotten all parameters.

        Parameters
        ----------
        f : Filter
            Whose state it takes over.
        mode : Mode
            Its own.
        fresh : float
            Standard deviation of the payload, as a share of (m + soft mass), at least.
        doubt : float
            Of the state, as a share of a start's, beyond all that f says.

        """
        prior, new = self.prior_of(mode), f.copy()
        std = max(3.0 * math.sqrt(f.variance), fresh * (f.mass + self.schedule.soft_mass))
        new.mode, new.beta, new.spread = mode, prior.mean.copy(), prior.spread(std)
        new.beta[MASS] = f.beta[MASS]
        if not mode.parts:
            new.beta[CORIOLIS] = self.nearest_share(f.beta[CORIOLIS])
        new.cov = f.cov + f.sens @ f.spread @ f.sens.T + doubt**2 * self.start_cov
        new.sens = np.zeros((f.x.size, new.beta.size))
        new.record = new_record(self.told_variance.size)
        new.record[:-5] = f.record[:-5]
        return new

    def tells(self, f: Filter, loads: Loads, mode: Mode) -> bool:
        """Tell whether a mode's model error is beyond the noise now, so that modes differ."""
        error = mode.gauge**2 * self._density * loads.strain[2:]
        noise = self.told_variance[2:] * f.record[2:self.told_variance.size]
        return bool((error > TELLING**2 * noise).any())

    def nearest_share(self, share: float) -> float:
        """Return the share of Coriolis forces that an exact model may have."""
        return min(self.shares, key=lambda told: abs(told - share))

    def relocate(self, f: Filter, measured: Array | None) -> None:
        """Keep what is known of payload and parts, and start the state again."""
        x = np.zeros_like(f.x)
        if measured is not None:
            x[:2] = measured[:2]
        f.x, f.cov, f.sens = x, self.start_cov, np.zeros_like(f.sens)
