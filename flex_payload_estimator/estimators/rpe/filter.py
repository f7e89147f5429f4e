"""A filter of the joint posterior: what one hypothesis about the arm knows, and how it learns."""

from __future__ import annotations

from dataclasses import replace
import math
from typing import Any

from flex_payload_estimator.estimators.rpe import onward
from flex_payload_estimator.estimators.rpe.effects import EffectStep
from flex_payload_estimator.estimators.rpe.evidence import misfit_of, new_record, NOISIER
from flex_payload_estimator.estimators.rpe.hand_over import hand_over
from flex_payload_estimator.estimators.rpe.hypothesis import assumed, Filter, Mode, Sample
from flex_payload_estimator.estimators.rpe.kernel import (
    CORIOLIS,
    FIRST_BIAS,
    FORCES,
    MASS,
    walk,
)
from flex_payload_estimator.estimators.rpe.knowledge import joined
from flex_payload_estimator.estimators.rpe.linearised import held, Lineariser
from flex_payload_estimator.estimators.rpe.model_average import model_averaged
from flex_payload_estimator.estimators.rpe.prior import Prior, SHARE_STD, SHARES, tolerances_off
from flex_payload_estimator.estimators.rpe.schedule import PayloadSchedule
from flex_payload_estimator.estimators.rpe.sensors import Loads, speed_feedback
from flex_plant_sim.arm.second_order import Array
import numpy as np

# A model error of so many standard deviations of the noise tells between modes.
TELLING = 3.0
# The model error is white with the density of a share that is drawn afresh every 10 ms.
ERROR_STEP_S = 0.01
# And it is not quite white: on arms of eight modes in the demo's loop, told five, the error stays
# at this share of the payload from 10 to 30 s, while the filter's own deviation goes on falling
# (benchmarks/loop_band.py, seeds 10, 13, 16 and 22).
LASTING = 0.01
# Parts of the range of payloads: a filter linearised in the middle of one, where nothing else is
# wrong, finds any payload of it.
CELLS = 8


class FilterStep:
    """
    Steps filters.

    Parameters
    ----------
    schedule : PayloadSchedule
    motion : tuple of Array
        As the simulator makes them of the robot file, and nature's, see forces.motion_rows.
    lineariser : Lineariser
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

    def __init__(self, schedule: PayloadSchedule, motion: tuple[Array, Array],
                 lineariser: Lineariser, prior: Prior, effects: EffectStep, told: Array,
                 torque: Array, heaviest: float, start: Array):
        self.schedule, self.motion, self.prior, self.effects = schedule, motion, prior, effects
        # An arm without forces of motion has none to add, and one may be told all.
        self.bends = len(motion[False]) < len(motion[True])
        self.exact, self.heaviest, self.start_cov = prior.exact(), heaviest, np.diag(start**2)
        free = prior.std[CORIOLIS] >= SHARE_STD
        self.shares = SHARES if free else (float(prior.mean[CORIOLIS]),)
        gauges = self.exact.std[FIRST_BIAS:]
        self._lasting = gauges, prior.std[FIRST_BIAS:][:gauges.size + FORCES].copy()
        self.told_variance, self._torque = told**2, torque**2
        self._told: list[float] = self.told_variance.tolist()
        self.output = np.ascontiguousarray(effects.output_matrix())
        self.lineariser, self.step_time = lineariser, effects.arm.step_time
        self._density = ERROR_STEP_S / self.step_time
        self._speed, self._offsets = speed_feedback(effects.arm), effects.arm.acts_on_output
        # Whether an effect acts between prediction and measurement.
        self._apart = effects.moves or self._offsets
        self._no_parts, self._no_offset = np.zeros((0, 1)), np.zeros(told.size)
        self._limits = self._density, float(prior.gains), heaviest, self.step_time

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
        known = joined(x, self.start_cov, np.zeros((x.size, beta.size)), beta, prior.spread(std),
                       new_record(channels), np.repeat([[0.0], [np.inf]], channels, axis=1))
        return Filter(mode, known, (x.size, beta.size, channels))

    def _ahead(self, f: Filter, sample: Sample, loads: Loads) -> tuple[Any, ...]:
        """Return what `onward.ahead` takes."""
        parts, model = self._no_parts, f.model
        if model is not None:
            about, series, away, motion = model.nominal, model.series, 0.0, model.motion
            if f.mode.parts:
                parts = model.parts_at(f.x.item(1))
        else:
            # Plain numbers are quicker than NumPy's.
            mass, about, motion = f.mass, f.beta, self.motion[f.mode.bent]
            piece = self.schedule.cut(mass, f.variance)
            series, away = piece.series, mass - piece.payload
            if f.mode.parts:
                parts = self.schedule.parts_at(mass, f.x.item(1))
        doubt = self._torque if sample.doubt is None else self._torque + sample.doubt
        return (f.room(), f.known, f.anchor, model is not None, about, series, parts, away, motion,
                sample.command, doubt, self._speed, loads.table, sample.steps,
                assumed(f.mode, *self._limits))

    def predict(self, f: Filter, sample: Sample, loads: Loads) -> None:
        """Advance to a sample; a state that is lost stays so until a measurement tells it."""
        if not math.isfinite(f.x.item(1)):
            f.kept = None
            return
        before, payload = f.x, float(f.beta[MASS] if f.model is None else f.anchor[MASS])
        if self.effects.moves:
            before = before.copy()
        onward.ahead(*self._ahead(f, sample, loads))
        if self.effects.moves:
            f.x[:] = self.effects.push(self.schedule.cut(payload).payload, before, f.x,
                                       sample.command, sample.time - self.step_time)

    def drift(self, f: Filter, variance: float) -> None:
        """Let the payload walk at random, kg^2."""
        state = f.state
        walk(f.cov, f.sens, f.spread, variance)
        f.x += state - f.state

    def said(self, f: Filter) -> onward.Said:
        """Return what a filter says: payload, kg, and its variance, kg^2."""
        return model_averaged(f.beta, f.spread, self._lasting[f.mode.parts])

    def payload(self, f: Filter, told: onward.Said | None = None, doubt: float | None = None
                ) -> tuple[float, float]:
        """Return payload and variance, kg and kg^2; the rest of f, where it is known."""
        mass, variance = map(float, told or self.said(f))
        if f.mode.parts:
            variance += (LASTING * mass)**2
            if f.rounds == 0:
                variance += self.prior.considered(f.spread)
            # Gauss and Newton's last step: the next is smaller, if at all.
            variance += (mass - f.anchor.item(MASS))**2
            variance += self.prior.scale_variance * mass**2
            variance *= self.doubt(f) if doubt is None else doubt
        return mass, variance

    def doubt(self, f: Filter) -> float:
        """
        Return what the variance of one of parts is multiplied by, at least 1.

        The mean squares of innovations and of parts over what they should be.
        """
        doubt = max(1.0, misfit_of(f.record))
        if f.mode.parts:
            doubt *= max(1.0, tolerances_off(f.beta, f.spread, self.prior.mean,
                                             self.prior.weights))
        return doubt

    def step(self, f: Filter, sample: Sample, loads: Loads) -> None:
        """Advance one sample, and learn from it."""
        if self._apart or sample.measured is None or not math.isfinite(f.x.item(1)):
            self.predict(f, sample, loads)
            self.correct(f, sample, loads)
            return
        self._weighed(f, sample, onward.stepped(
            sample.measured, self._no_offset, self.output, self.told_variance,
            *self._ahead(f, sample, loads)))

    def jumped(self, after: Filter, sample: Sample, loads: Loads) -> Filter:
        """
        Return a filter of a walking payload after a sample.

        Where that is past the gate the payload may have jumped: the likeliest of jumps to
        anywhere, each linearised there, if that is likelier.

        Parameters
        ----------
        after : Filter
            One that has learnt it.
        sample, loads : Sample, Loads
            What it learnt from, and the loads then.

        """
        if after.square * self.told_variance.size < onward.GATE:
            return after
        return max([after, *(self._jumped(after.before(), *cell, sample, loads)
                             for cell in self.cells(CELLS))], key=lambda f: f.stated)

    def _jumped(self, f: Filter, low: float, high: float, sample: Sample, loads: Loads) -> Filter:
        """Let a filter's payload jump, kg, before it learns a sample."""
        self.drift(f, self.heaviest**2)
        f.beta[MASS], f.spread[MASS], f.spread[:, MASS] = 0.5 * (low + high), 0.0, 0.0
        f.spread[MASS, MASS] = 0.25 * (high - low)**2
        self.step(f, sample, loads)
        return f

    def cells(self, count: int) -> list[tuple[float, float]]:
        """Return the range of payloads in parts over which an arm changes alike, kg."""
        soft = self.schedule.soft_mass
        edges = soft * (1.0 + self.heaviest / soft)**(np.arange(count + 1) / count) - soft
        return list(zip(edges[:-1].tolist(), edges[1:].tolist()))

    def correct(self, f: Filter, sample: Sample, loads: Loads) -> None:
        """Learn from a sample that was predicted."""
        if sample.measured is None:
            return
        self._weighed(f, sample, onward.learnt(
            f.known, f.anchor, f.model is not None, loads.table, sample.measured,
            self._offset(f.x, sample.time), self.output, self.told_variance,
            assumed(f.mode, *self._limits)))

    def _weighed(self, f: Filter, sample: Sample, found: tuple[float, ...]) -> None:
        gained, stated, square, f.fallen = found
        if math.isnan(square):
            self.relocate(f, sample.measured)
        else:
            f.gained, f.stated, f.square = gained, stated, square

    def _offset(self, x: Array, time: float) -> Array:
        """Return what the sensors' effects add to C x, (m,)."""
        if not self._offsets:
            return self._no_offset
        return np.asarray(self.effects.arm.output(x, time) - self.output @ x)

    def followed(self, f: Filter, command: Array, output: Array, loads: Loads, swing: float
                 ) -> tuple[Loads, bool, onward.Said]:
        """Return the loads after a sample, whether it swings, and what is said then."""
        after = Loads(loads.share, np.zeros(loads.table.shape))
        swings, told = onward.followed(
            after.table, f.known, f.anchor, f.model is not None, self._lasting[f.mode.parts],
            loads.table, loads.share, output, command, self._speed, self.told_variance, swing)
        return after, swings, told

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
        prior = self.prior_of(mode)
        std = max(3.0 * math.sqrt(f.variance), fresh * (f.mass + self.schedule.soft_mass))
        beta = prior.mean.copy()
        beta[MASS] = f.beta[MASS]
        if not mode.parts:
            beta[CORIOLIS] = min(self.shares, key=lambda told: abs(told - f.beta[CORIOLIS]))
        return self._begun_again(replace(f, mode=mode, model=None, rounds=0), f, f.state, beta,
                                 prior.spread(std), doubt)

    def _begun_again(self, new: Filter, f: Filter, x: Array, beta: Array, spread: Array,
                     doubt: float) -> Filter:
        """Return a filter that knows of f's what it does of state and noise, and nothing else."""
        states, _, channels = f.sizes
        cov = f.cov + f.sens @ f.spread @ f.sens.T + doubt**2 * self.start_cov
        record = new_record(channels)
        record[:channels] = f.noise
        known = joined(x, cov, np.zeros((states, beta.size)), beta, spread, record, f.reading)
        return replace(new, known=known, sizes=(states, beta.size, channels), age=0.0,
                       linearised=0.0, kept=None)

    def freed(self, f: Filter) -> Filter:
        """Return the same filter, linearised about its estimate at every sample."""
        new = replace(f, known=f.known.copy(), model=None, kept=None)
        new.x[:] = f.state
        return new

    def about(self, f: Filter) -> Filter:
        """Return the same filter, linearised about its estimate from now on."""
        if f.mode.parts:
            model = self.lineariser.about(self.prior.within(f.beta))
        else:
            model = held(self.schedule, f.beta.copy(), self.motion[f.mode.bent])
        new = replace(f, known=f.known.copy(), model=model, linearised=f.age, kept=None)
        new.x += f.sens @ (new.anchor - f.anchor)
        return new

    def again(self, f: Filter, fresh: float, first: Sample, loads: Loads,
              rested: Filter | None) -> Filter:
        """
        Return a filter that begins at an earlier sample, linearised about what one has found.

        Parameters
        ----------
        f : Filter
            Whose mode, payload, forces of motion and parts it is linearised about.
        fresh : float
            See `renewed`.
        first, loads : Sample, Loads
            Where it begins.
        rested : Filter or None
            What was known then of an arm at rest.

        """
        prior, new = self.prior_of(f.mode), self.about(f)
        beta = prior.mean.copy()
        beta[MASS] = new.anchor[MASS]
        if not f.mode.parts:
            beta[CORIOLIS] = new.anchor[CORIOLIS]
        spread = prior.spread(fresh * (f.mass + self.schedule.soft_mass))
        new = self._begun_again(new, f, new.x, beta, spread, 0.0)
        new.rounds, new.log = f.rounds + 1, 0.0
        self.begin_at(new, first, loads, rested)
        return new

    def begin_at(self, new: Filter, first: Sample, loads: Loads, rested: Filter | None) -> None:
        """Let a filter begin at a sample, with what a rest told if its noise was known."""
        if rested is not None and (new.noise < NOISIER * rested.noise).all():
            hand_over(rested, new)
            new.x -= new.sens @ (new.beta - new.anchor)
            return
        self.relocate(new, first.measured)
        if first.measured is not None:
            self.correct(new, first, loads)

    def tells(self, f: Filter, loads: Loads, mode: Mode) -> bool:
        """Tell whether a mode's model error is beyond the noise now, so that modes differ."""
        # All gauges have one scale of noise; plain numbers are quicker for a few.
        scale = TELLING**2 / (mode.gauge**2 * self._density) * float(f.record[2])
        return any(load > scale * told for load, told in zip(loads.strain.tolist(), self._told))

    def relocate(self, f: Filter, measured: Array | None) -> None:
        """Keep what is known of payload and parts, and start the state again."""
        f.x[:], f.cov[:], f.sens[:] = 0.0, self.start_cov, 0.0
        if measured is not None:
            f.x[:2] = measured[:2]
