"""What brings a filter from sample to sample, and what it states of the payload."""

from __future__ import annotations

from functools import cache, partial
import math
from typing import Any

from flex_payload_estimator.estimators.base import within_range
from flex_payload_estimator.estimators.rpe import compiled_step
from flex_payload_estimator.estimators.rpe.effects import EffectStep
from flex_payload_estimator.estimators.rpe.far_part import far_part_averaged
from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.likelihood import gate_of, initial_statistics, SCORE
from flex_payload_estimator.estimators.rpe.linearised import Lineariser
from flex_payload_estimator.estimators.rpe.misfit import misfits
from flex_payload_estimator.estimators.rpe.model_average import model_averaged
from flex_payload_estimator.estimators.rpe.modes import Mode, noise_model
from flex_payload_estimator.estimators.rpe.packing import pack
from flex_payload_estimator.estimators.rpe.prior import Prior, SHARE_STD, SHARES
from flex_payload_estimator.estimators.rpe.schedule import PayloadSchedule
from flex_payload_estimator.estimators.rpe.score import bending_error
from flex_payload_estimator.estimators.rpe.sensors import Loads, speed_feedback
from flex_payload_estimator.estimators.rpe.time_update import (
    CORIOLIS,
    DISTURBANCES,
    FIRST_BIAS,
    MASS,
    walk,
)
from flex_payload_estimator.estimators.rpe.zero import zero_column
from flex_plant_sim.arm.second_order import Array
import numpy as np

# A model error, a share of the load, is white noise that is drawn afresh every 10 ms; at other
# sampling times its spectral density is the same.
ERROR_STEP_S = 0.01
# The model error is not quite white: on arms of eight modes in the demo's loop, with an estimator
# of five, the error of the payload stays at this share from 10 to 30 s, while the filter's own
# standard deviation goes on falling (benchmarks/loop_band.py, seeds 10, 13, 16 and 22).
PERSISTENT_ERROR = 0.01
# Intervals of the range of payloads: a filter linearised in the middle of one converges to any
# payload of it, where nothing else is wrong.
PAYLOAD_CELLS = 8


class FilterStep:
    """
    The arm's model and prior, and the steps of the filters that use them.

    Parameters
    ----------
    schedule : PayloadSchedule
        The sampled arm over angle and payload.
    motion : tuple of Array
        Forces of motion as the robot file has them, and with the bending of the links; see
        forces.motion_rows. Indexed by Mode.bending.
    lineariser : Lineariser
    prior : Prior
    effects : EffectStep
    noise_std : Array
        The robot file's standard deviation of each channel, rad and m/m, (m,).
    torque : Array
        Standard deviation of the process noise in the command's unit, (2,).
    payload_max : float
        Largest payload, kg.
    start_std : Array
        Standard deviation of the state at the start, (n,).

    Attributes
    ----------
    has_bending : bool
        Whether the forces of motion with and without bending differ.
    exact_prior : Prior
        Where all parts are those of the robot file.
    shares : tuple of float
        Shares of the forces of motion that an exact model may have.
    told_variance : Array
        The robot file's noise variance of each channel, rad^2 and (m/m)^2, (m,).
    output : Array
        C, the outputs over the state, (m, n).
    start_cov : Array
        Covariance of the state at the start, (n, n).
    step_time : float
        Sampling time, s.

    """

    def __init__(self, schedule: PayloadSchedule, motion: tuple[Array, Array],
                 lineariser: Lineariser, prior: Prior, effects: EffectStep, noise_std: Array,
                 torque: Array, payload_max: float, start_std: Array):
        self.schedule, self.motion, self.prior, self.effects = schedule, motion, prior, effects
        # An arm without forces of motion has no bending terms; a robot file may name them all.
        self.has_bending = len(motion[False]) < len(motion[True])
        self.exact_prior, self.payload_max = prior.exact(), payload_max
        self.start_cov = np.diag(start_std**2)
        self.shares = SHARES if prior.std[CORIOLIS] >= SHARE_STD else (prior.mean.item(CORIOLIS),)
        biases = self.exact_prior.std[FIRST_BIAS:]
        # Of what the published payload averages over, without and with free parts.
        self._averaged_std = biases, prior.std[FIRST_BIAS:][:biases.size + DISTURBANCES].copy()
        self.told_variance, self._torque_variance = noise_std**2, torque**2
        self.output = np.ascontiguousarray(effects.output_matrix())
        self._speed, self._moved_mass = speed_feedback(effects.arm), effects.arm.robot.moved_mass
        # As compiled_step.ArmConstants: a named tuple takes Numba a microsecond longer.
        self._constants = self.output, effects.bend_rows(), self.told_variance, self._speed
        self.lineariser, self.step_time = lineariser, effects.arm.step_time
        self._error_samples, self._gate = ERROR_STEP_S / self.step_time, gate_of(noise_std.size)
        self._offsets = effects.arm.acts_on_output
        # Whether an effect acts between prediction and measurement, so that a step is two calls.
        self._two_calls = effects.moves or self._offsets
        self._no_parts, self._no_offset = np.zeros((0, 1)), np.zeros(noise_std.size)
        # Called for each step: a mode alone is quicker to look up than with what is the same.
        self._noise_model = cache(partial(
            noise_model, error_samples=self._error_samples, gains=float(prior.gains),
            payload_max=payload_max, step=self.step_time, gate=self._gate))

    def prior_of(self, mode: Mode) -> Prior:
        """Return the prior of the parameters that a mode has."""
        return self.prior if mode.free_parts else self.exact_prior

    def payload_cells(self) -> list[tuple[float, float]]:
        """Return the range of payloads in intervals over which an arm changes alike, kg."""
        soft = self.schedule.soft_mass
        edges = soft * (1.0 + self.payload_max / soft)**(
            np.arange(PAYLOAD_CELLS + 1) / PAYLOAD_CELLS) - soft
        return list(zip(edges[:-1].tolist(), edges[1:].tolist()))

    def begin(self, mode: Mode, measured: Array, mass: float, std: float,
              share: float | None = None) -> Filter:
        """
        Return a filter at the prior.

        Parameters
        ----------
        mode : Mode
            Decides which parameters it has.
        measured : Array
            First outputs, rad and m/m, (m,).
        mass, std : float
            Mean and standard deviation of the payload, kg.
        share : float or None
            Share of the forces of motion; None takes the prior's mean.

        """
        prior, channels = self.prior_of(mode), measured.size
        x, beta = np.zeros(len(self.start_cov)), prior.mean.copy()
        x[:2], beta[MASS] = measured[:2], mass
        if share is not None:
            beta[CORIOLIS] = share
        packed = pack(x, self.start_cov, np.zeros((x.size, beta.size)), beta,
                      prior.covariance(std), initial_statistics(channels),
                      np.repeat([[0.0], [np.inf]], channels, axis=1))
        return Filter(mode, packed, (x.size, beta.size, channels))

    def step(self, f: Filter, sample: Sample, loads: Loads) -> None:
        """Predict a sample, and learn from it where it has a measurement."""
        if self._two_calls or sample.measured is None or not math.isfinite(f.x.item(1)):
            self.predict(f, sample, loads)
            self.correct(f, sample, loads)
            return
        self._take_likelihood(f, sample, compiled_step.step_packed(
            sample.measured, self._no_offset, *self._prediction_arguments(f, sample, loads)))

    def predict(self, f: Filter, sample: Sample, loads: Loads) -> None:
        """Predict a sample; a state that is not finite waits for the next measurement."""
        # A sample without a measurement says nothing.
        f.log_density = f.stated_log_density = 0.0
        if not math.isfinite(f.x.item(1)):
            f.previous = None
            return
        before = f.x.copy() if self.effects.moves else f.x
        payload = float(f.beta[MASS] if f.model is None else f.reference[MASS])
        compiled_step.predict_packed(*self._prediction_arguments(f, sample, loads))
        if self.effects.moves:
            self.effects.push(f, self.schedule.cut(payload).payload, before, sample.command,
                              sample.time - self.step_time)

    def correct(self, f: Filter, sample: Sample, loads: Loads) -> None:
        """Learn from the measurement of a sample that has been predicted."""
        if sample.measured is None:
            return
        self._take_likelihood(f, sample, compiled_step.correct_packed(
            f.packed, f.reference, f.model is not None, loads.table, self._noise_model(f.mode),
            self._constants, sample.measured, self._offset(f.x, sample.time)))

    def _prediction_arguments(self, f: Filter, sample: Sample, loads: Loads) -> tuple[Any, ...]:
        """Return the arguments of `compiled_step.predict_packed`."""
        parts, model = self._no_parts, f.model
        if model is not None:
            about, series, away, motion = model.nominal, model.series, 0.0, model.motion
            if f.mode.free_parts:
                parts = model.parts_at(f.x.item(1))
        else:
            # Plain numbers are quicker than NumPy's.
            mass, about, motion = f.mass, f.beta, self.motion[f.mode.bending]
            piece = self.schedule.cut(mass, f.variance)
            series, away = piece.series, mass - piece.payload
            if f.mode.free_parts:
                parts = self.schedule.parts_at(mass, f.x.item(1))
        variance = self._torque_variance if sample.command_variance is None \
            else self._torque_variance + sample.command_variance
        return (f.previous_buffer(), f.packed, f.reference, model is not None,
                (about, series, parts, away, motion), sample.command, variance, loads.table,
                sample.steps, self._noise_model(f.mode), self._constants)

    def _take_likelihood(self, f: Filter, sample: Sample, found: tuple[float, ...]) -> None:
        """Keep what a correction returned; where the state is lost, begin the state again."""
        log_density, stated, mean_square = found
        if math.isnan(mean_square) or self._is_lost(f, mean_square):
            self.relocate(f, sample.measured)
        else:
            f.log_density, f.stated_log_density, f.mean_square = log_density, stated, mean_square

    def _is_lost(self, f: Filter, mean_square: float) -> bool:
        """Tell whether a state is lost: beyond the gate, and known less than at the start."""
        # Beyond the gate the gain falls, and P grows for as long as samples stay there.
        return self.is_beyond_gate(mean_square) \
            and bool((f.cov.diagonal() > self.start_cov.diagonal()).any())

    def is_beyond_gate(self, mean_square: float) -> bool:
        """Tell whether a sample of that Filter.mean_square is more than noise does."""
        return mean_square >= self._gate / self.told_variance.size

    def _offset(self, x: Array, time: float) -> Array:
        """Return what the sensors' effects add to C x, (m,)."""
        if not self._offsets:
            return self._no_offset
        return np.asarray(self.effects.arm.output(x, time) - self.output @ x)

    def relocate(self, f: Filter, measured: Array | None) -> None:
        """Begin the state again at the measured angles; keep payload and parts, not the score."""
        f.x[:], f.cov[:], f.sensitivity[:], f.statistics[SCORE] = 0.0, self.start_cov, 0.0, 0.0
        if measured is not None:
            f.x[:2] = measured[:2]
            f.x[1] -= f.reference[zero_column(measured.size)]

    def drift(self, f: Filter, variance: float) -> None:
        """Let the payload walk at random by a variance, kg^2."""
        state = f.state
        walk(f.cov, f.sensitivity, f.beta_cov, variance)
        f.x += state - f.state

    def after_jump(self, after: Filter, sample: Sample, loads: Loads) -> Filter:
        """
        Return the likeliest filter of a walking payload that may have jumped before a sample.

        Where the sample is beyond the gate, the payload may be in any of the payload cells, and
        the filter is linearised in the middle of it.

        Parameters
        ----------
        after : Filter
            Has learnt the sample without a jump.
        sample, loads : Sample, Loads
            The sample, and the loads before it.

        """
        if not self.is_beyond_gate(after.mean_square):
            return after
        return max([after, *(self._jumped(after.before_prediction(), *cell, sample, loads)
                             for cell in self.payload_cells())],
                   key=lambda f: f.stated_log_density)

    def _jumped(self, f: Filter, low: float, high: float, sample: Sample, loads: Loads) -> Filter:
        """Move a filter's payload to the middle of a cell, kg, and let it learn a sample."""
        self.drift(f, self.payload_max**2)
        f.beta[MASS], f.beta_cov[MASS], f.beta_cov[:, MASS] = 0.5 * (low + high), 0.0, 0.0
        f.beta_cov[MASS, MASS] = 0.25 * (high - low)**2
        self.step(f, sample, loads)
        return f

    def update_loads(self, f: Filter, command: Array, output: Array, loads: Loads,
                     swing_variance: float) -> tuple[Loads, bool, compiled_step.Moments]:
        """
        Return the loads after a sample, whether the arm moves, and the payload's moments.

        Parameters
        ----------
        f : Filter
            The incumbent.
        command, output : Array
            Of the sample, (2,) and (m,).
        loads : Loads
            Before it.
        swing_variance : float
            Variance of a channel, over that of its noise, from which it swings.

        """
        share, table = loads.share, loads.table.copy()
        swings, moments = compiled_step.update_loads(
            table, f.packed, f.reference, f.model is not None,
            self._averaged_std[f.mode.free_parts], share, output, command, self._speed,
            self.told_variance, swing_variance)
        return Loads(share, table), swings, moments

    def moments(self, f: Filter) -> compiled_step.Moments:
        """Return payload, kg, and its variance, kg^2, averaged; see model_average.py."""
        return model_averaged(f.beta, f.beta_cov, self._averaged_std[f.mode.free_parts])

    def published(self, f: Filter, moments: compiled_step.Moments | None = None,
                  factor: float | None = None) -> tuple[float, float]:
        """
        Return the payload, kg, and the variance to publish, kg^2.

        With free parts that is D [V_mm + (0.01 m)^2 + V_f + (m - m_a)^2 + sigma_s^2 m^2] + V_b,
        see docs/estimator_method.md; else the model-averaged variance.

        Parameters
        ----------
        f : Filter
            Usually the incumbent.
        moments : Moments or None
            Of f, where they are known.
        factor : float or None
            D, see `variance_factor`, where it is known.

        """
        mass, variance = map(float, moments or self.moments(f))
        if f.mode.free_parts:
            variance += (PERSISTENT_ERROR * mass)**2
            # The last Gauss-Newton step: the next one is no larger.
            variance += (mass - f.reference.item(MASS))**2
            variance += self.prior.scale_variance * mass**2
            if f.passes == 0:
                variance += self.prior.consider_variance(f.beta_cov)
            else:
                shift, further = self._far_part(f)
                mass, variance = mass + shift, variance + further
            variance *= self.variance_factor(f) if factor is None else factor
            variance += (bending_error(f.statistics[SCORE]) * (self._moved_mass + mass))**2
        return within_range(mass, variance, self.payload_max)

    def _far_part(self, f: Filter) -> tuple[float, float]:
        prior, told = self.prior, self.prior.tolerated
        return far_part_averaged(f.beta, f.beta_cov, (f.beta - prior.mean)[told], prior.std[told],
                                 prior.scale[told], prior.scale_variance)

    def variance_factor(self, f: Filter) -> float:
        """Return D, by which a variance is multiplied; see misfit.py."""
        return misfits(f, self.prior)[1]
