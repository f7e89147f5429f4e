"""What steps a hypothesis: a filter at one level of model error, started at one payload."""

from __future__ import annotations

import math
from typing import Any

from flex_payload_estimator.estimators.rpe.effects import EffectStep
from flex_payload_estimator.estimators.rpe.hypothesis import Hypothesis, Sample, Weighed
from flex_payload_estimator.estimators.rpe.kernel import (
    correct,
    learn,
    MASS_COLUMNS,
    predict,
    step,
    weigh,
)
from flex_payload_estimator.estimators.rpe.levels import Level, speed_feedback
from flex_payload_estimator.estimators.rpe.schedule import PayloadSchedule, PayloadSlice
from flex_payload_estimator.estimators.rpe.windows import Windows
from flex_plant_sim.arm.second_order import Array
import numpy as np

MISFIT_MEMORY_S = 0.5
# P's diagonal grows by this share a sample, well above what rounding takes, so that P stays
# positive definite where damped modes have forgotten everything; a memory of 1e12 samples.
JITTER = 1e-12
# A state is lost where its outputs have this many times a start's variance: beyond, rounding takes
# what the sensors tell. In the second sample they have up to a thousand times.
LOST = 1e5


class Stepper:
    """
    Steps hypotheses through one schedule.

    Parameters
    ----------
    schedule : PayloadSchedule
    levels : tuple of Level
    told : Array
        Standard deviation of each channel, rad and m/m, (m,).
    effects : EffectStep
    heaviest : float
        kg.
    gains : Array
        Where a strain gain acts among the part parameters, (m, p).
    spread : Array
        Standard deviation of the state at the start, (n,).

    """

    def __init__(self, schedule: PayloadSchedule, levels: tuple[Level, ...], told: Array,
                 effects: EffectStep, heaviest: float, gains: Array, spread: Array):
        self.schedule, self.levels, self.told = schedule, levels, told
        self.effects, self.heaviest = effects, heaviest
        self.output = np.ascontiguousarray(effects.output_matrix() / told[:, None])
        step = effects.arm.step_time
        self.memory = min(1.0, step / MISFIT_MEMORY_S)
        self._gains, self._no_gains = gains, np.zeros((told.size, 0))
        self._no_parts, self._no_offset = np.zeros((1, 0)), np.zeros(told.size)
        self._told_noise = np.ones(told.size)
        states = self.output.shape[1]
        self._halves = 0.5 * (np.ones((states, states)) + JITTER * np.eye(states))
        self._speed = speed_feedback(effects.arm)
        # Where nothing comes between prediction and correction one call does both.
        self._plain = not (effects.moves or effects.arm.acts_on_output)
        self._cov = np.diag(spread**2)
        self._limit = LOST * float(((self.output * spread)**2).sum())

    def start(self, level: int, measured: Array, mass: float, std: float) -> Hypothesis:
        """Return a hypothesis of an arm at rest that knows of the payload mass and std, kg."""
        parts = 0 if self.levels[level].exact else self._gains.shape[1]
        states = len(self._cov)
        return Hypothesis(level, self._standing(measured), self._cov,
                          np.zeros((states, MASS_COLUMNS + parts)), mass, std**2,
                          np.zeros(parts))

    def _standing(self, measured: Array) -> Array:
        x = np.zeros(len(self._cov))
        x[:2] = measured[:2] * self.told[:2]
        return x

    def warm(self) -> None:
        """Compile the kernels where they are compiled, so that no sample waits for it."""
        channels = self.told.size
        sample = Sample(0.0, np.zeros(channels), np.zeros(2), 1.0, 1.0)
        for level in (0, len(self.levels) - 1):
            h = self.start(level, np.zeros(channels), 0.5 * self.heaviest, self.heaviest)
            self.predict(h, sample)
            self.correct(h, sample)
            self.correct(h, sample, self.weigh(h, sample))
            self.step(h, sample)

    def predict(self, h: Hypothesis, sample: Sample, trial: bool = False) -> None:
        """Advance one sample; in a trial, roughly."""
        level, start, piece = self.levels[h.level], h.x, self.schedule.cut(h.mass, trial)
        h.x, h.cov, h.sens = predict(*self._before(h, level, piece, sample))
        if level.drift:
            self.drift(h, level.drift**2 * self.effects.arm.step_time)
        if self.effects.moves:
            h.x = self.effects.push(piece.payload, start, h.x, sample.command,
                                    sample.time - self.effects.arm.step_time)

    def _before(self, h: Hypothesis, level: Level, piece: PayloadSlice, sample: Sample
                ) -> tuple[Any, ...]:
        """Return what the kernel's prediction takes."""
        parts, torque, floor = self._no_parts, level.told_torque, level.floor
        if not level.exact:
            parts = self.schedule.parts_at(h.mass)
            torque = level.torque(sample.before, sample.command - self._speed @ h.x)
            floor = sample.before**2 * floor
        if sample.scatter is not None:
            torque = np.hypot(torque, sample.scatter)
        return (h.x, h.cov, h.sens, self.schedule.order, piece.value, piece.slopes, parts,
                h.mass - piece.payload, sample.command, torque, floor)

    def _at(self, h: Hypothesis, level: Level, sample: Sample) -> tuple[Any, ...]:
        """Return what the kernel's correction takes after x, P and s."""
        gains, noise = self._no_gains, self._told_noise
        if not level.exact:
            gains, noise = self._gains, level.noise(sample.activity)
        return (h.mass, h.variance, h.lean, h.sums, sample.measured,
                self._offset(h.x, sample.time), self.output, gains, noise, self.told,
                self._halves, self._limit, self.heaviest)

    def step(self, h: Hypothesis, sample: Sample, trial: bool = False) -> None:
        """Advance one sample, and learn from it."""
        level = self.levels[h.level]
        if self._plain and sample.measured is not None and not level.drift:
            piece = self.schedule.cut(h.mass, trial)
            if self._take(h, *step(*self._before(h, level, piece, sample),
                                   *self._at(h, level, sample))):
                return
        self.predict(h, sample, trial)
        self.correct(h, sample)

    def weigh(self, h: Hypothesis, sample: Sample) -> Weighed | None:
        """Return what its measurement will be worth, where the noise does not depend on it."""
        if not self.levels[h.level].exact:
            return None
        found = Weighed(*weigh(
            h.x, h.cov, h.sens, h.variance, h.lean, self._offset(h.x, sample.time), self.output,
            self._no_gains, self._told_noise, self._halves, self._limit))
        return found if math.isfinite(found.log_det) else None

    def correct(self, h: Hypothesis, sample: Sample, weighed: Weighed | None = None) -> None:
        """Learn from a sample that has a measurement, which may have been weighed before."""
        if sample.measured is None or self._learn(h, sample, sample.measured, weighed):
            return
        # Across a gap, linearised about a state that it hardly knew, a filter may diverge.
        self.relocate(h, sample.measured)
        self._learn(h, sample, sample.measured, None)

    def _learn(self, h: Hypothesis, sample: Sample, measured: Array, w: Weighed | None) -> bool:
        """Correct, and tell whether the state was one that can be."""
        if w:
            x, mass, sums, reading, misfit = learn(
                h.x, h.mass, h.sums, measured, w.expected, self.told, self.heaviest, w.sens,
                w.gain, w.inverse, w.weighted, w.known, w.deviation, w.variance)
            return self._take(h, x, w.cov, w.sens, mass, w.variance, w.lean, sums, reading,
                              misfit, w.log_det)
        return self._take(h, *correct(h.x, h.cov, h.sens,
                                      *self._at(h, self.levels[h.level], sample)))

    def _take(self, h: Hypothesis, x: Array, cov: Array, sens: Array, mass: float,
              variance: float, lean: Array, sums: Array, reading: Array, misfit: float,
              log_det: float) -> bool:
        """Take the kernel's results, where they are finite."""
        gained = -0.5 * (misfit + log_det)
        if not math.isfinite(gained):
            return False
        h.x, h.cov, h.sens, h.mass, h.variance, h.lean = x, cov, sens, mass, variance, lean
        h.sums, h.reading = sums, reading
        h.log_likelihood += gained
        h.recent += gained - self.memory * h.recent
        h.misfit += self.memory * (misfit / self.told.size - h.misfit)
        return True

    def _offset(self, x: Array, time: float) -> Array:
        """Return what the sensors' effects add to C x, (m,)."""
        arm = self.effects.arm
        if not arm.acts_on_output:
            return self._no_offset
        return np.asarray(arm.output(x, time) / self.told - self.output @ x)

    def turn(self, h: Hypothesis, column: int) -> None:
        """Close a block, and begin the window of a column (1 or 2) again."""
        h.windows = h.windows.turned(h.sums, column)
        h.sens, h.sums = h.sens.copy(), h.sums.copy()
        h.sens[:, column] = 0.0
        h.sums[:, [0, column]] = 0.0

    def reopen(self, h: Hypothesis, std: float) -> None:
        """Forget the payload, which may have changed just now; std in kg."""
        s = h.sens[:, 0].copy()
        h.cov = h.cov + h.variance * np.outer(s, s)
        h.sens = h.sens.copy()
        h.sens[:, MASS_COLUMNS:] += np.outer(s, h.lean)
        h.sens[:, :MASS_COLUMNS] = 0.0
        h.lean, h.variance = np.zeros_like(h.lean), std**2
        h.watch(h.windows.emptied())

    def loosen(self, h: Hypothesis, level: int) -> None:
        """Move to another level; from an exact one, it leans on its parts from here on."""
        if self.levels[h.level].exact and not self.levels[level].exact:
            parts = self._gains.shape[1]
            h.sens = np.hstack([h.sens, np.zeros((h.x.size, parts))])
            h.lean = np.zeros(parts)
        h.level = level
        h.watch(Windows())

    def drift(self, h: Hypothesis, variance: float) -> None:
        """Let the payload walk at random, kg^2: exact for the joint covariance with x."""
        s, after = h.sens[:, 0], h.variance + variance
        h.cov = h.cov + h.variance * variance / after * np.outer(s, s)
        h.sens = h.sens.copy()
        h.sens[:, 0] *= h.variance / after
        h.variance = after

    def follow_trend(self, h: Hypothesis) -> float:
        """Let an inexact model's payload go where recent windows pull it; return how far, kg."""
        step = 0.0 if self.levels[h.level].exact else h.windows.trend()
        if step:
            self.drift(h, step**2)
            h.watch(h.windows.emptied())
        return step

    def relocate(self, h: Hypothesis, measured: Array) -> None:
        """Keep the payload, and start the state again."""
        h.x, h.cov, h.sens = self._standing(measured), self._cov, np.zeros_like(h.sens)
        h.watch(h.windows.emptied())
