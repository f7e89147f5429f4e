"""
One-step prediction of the windows of a record by a scheduled steady-state Kalman predictor.

It takes a record cut into windows and a base model, and gives `Likelihood` the whitened residual
of any hypothesis; the report and the latent forces use its filtered trajectory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from hashlib import blake2b

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.schedule import barycentric_weights
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.added_states import (
    integrals,
    integrators,
    matched_states,
    slip_variance,
    states_at_rest,
)
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import Discrepancy
from flex_plant_sim.diagnosis.prediction.filter_run import FilterRun, predictor_matrices
from flex_plant_sim.diagnosis.prediction.first_state import first_state
from flex_plant_sim.diagnosis.prediction.process_noise import (
    load_deviations,
    process_noise_variance,
    REFERENCE_STEP,
)
from flex_plant_sim.diagnosis.prediction.scheduled_matrices import interpolated, ScheduledMatrices
from flex_plant_sim.diagnosis.prediction.sensor_map import SensorMap, shifted
from flex_plant_sim.diagnosis.prediction.steady_filter import steady_filter, SteadyFilter
from flex_plant_sim.diagnosis.prediction.whitening import (
    output_error,
    WhiteningFilter,
)
from flex_plant_sim.diagnosis.record.windows import Indices, Record, Windows
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.inputs.first_rates import first_rows
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Times that the trajectory is filtered, each with matrices at the angles that the last one found.
# With 4 no digit of a diagnosis changes; with 1 a size changes by a twentieth of its interval.
TRAJECTORY_PASSES = 2


class Predictor:
    """
    A record, its windows, and the base model's filtered trajectory through the record.

    Smooth forces are evaluated along that trajectory and affine sensors are inverted, so that the
    prediction of most hypotheses is linear in the state. Dry friction and contact are stepped.

    Parameters
    ----------
    base : BaseModel
    windows : Windows
    noise : Array
        Standard deviation of each output channel's noise, (m,).
    for_comparison : bool
        Whether hypotheses are compared with it. Then the filter contains the model discrepancy,
        and what is read whole samples late is advanced to the motion it belongs to. A
        likelihood does not depend on the order of the samples, so this is exact for a delay of
        any length; a prediction for use in real time must not do it.
    trajectory_effects : sequence of Effect
        Effects of the arm whose trajectory is filtered, in addition to the base's.
    robot : Robot, optional
        Robot of that arm, in place of the base's.

    """

    def __init__(self, base: BaseModel, windows: Windows, noise: Array,
                 for_comparison: bool = False, trajectory_effects: Sequence[Effect] = (),
                 robot: Robot | None = None):
        self.base, self.windows, self.noise = base, windows, noise
        self.for_comparison = for_comparison
        self.trajectory_effects, self.robot = tuple(trajectory_effects), robot or base.robot
        self._filters: dict[bytes, SteadyFilter] = {}
        self._last_sensors: SensorMap | None = None
        self._last_shift: tuple[SensorMap, Array | None] | None = None
        self.record: Record = windows.record
        period = windows.warm_up * base.robot.sample_time
        self.discrepancy = Discrepancy.of(base.discrepancy, period)
        self.arm = arm = self.arm_with(trajectory_effects, robot)
        self.weights = barycentric_weights(np.cos(self.record.output[:, 1]), arm.nodes)
        self.steady = self.steady_filter_of(arm)
        self.gain = self.steady.gain
        self.states = np.zeros((len(self.record.time), arm.states))
        for _ in range(TRAJECTORY_PASSES):
            self.states = self._filtered_states(arm)
            self.angle = self.states[:, :arm.form.order] @ arm.form.elbow_angle
            self.weights = barycentric_weights(np.cos(self.angle), arm.nodes)

    def arm_with(self, effects: Sequence[Effect] = (), robot: Robot | None = None) -> ExtendedArm:
        """Return the base's arm with further effects, or the arm of another robot."""
        if not self.for_comparison:
            return self.base.arm(self.record.payload, effects, robot)
        # The discrepancy comes first, so that its states follow the arm's own.
        always = *self.base.effects, *self.base.discrepancy.laws
        base = replace(self.base, effects=(self.discrepancy, *always))
        return base.arm(self.record.payload, effects, robot, in_step=True)

    def _force_variance(self, arm: ExtendedArm) -> Array:
        # White force noise of the same spectral density has a smaller share in a shorter step.
        share = np.sqrt(REFERENCE_STEP / arm.robot.sample_time)
        joints, deflections = self.base.noise_shares
        return process_noise_variance(load_deviations(arm, self.windows),
                                      (share * joints, share * deflections))

    def steady_filter_of(self, arm: ExtendedArm) -> SteadyFilter:
        """Return an arm's own steady filter; with the gain of another the arm may be unstable."""
        own = slip_variance(arm, self.noise)
        if self.for_comparison:
            own += self.discrepancy.step_variance(arm, self.windows, self.base.discrepancy)
        force = self._force_variance(arm)
        # Many effects leave the plant alone; arms with equal matrices share one filter.
        key = blake2b(b''.join(part.tobytes() for part in (
            arm.schedule.table, arm.output_matrix, force, own))).digest()
        if key not in self._filters:
            self._filters[key] = steady_filter(arm, force, self.noise, own)
        return self._filters[key]

    def innovations(self, effects: Sequence[Effect] = (), robot: Robot | None = None,
                    steady: SteadyFilter | None = None) -> Array:
        """
        Return the one-step errors y - y_predicted of the scored samples, (B, W, length, m).

        Parameters
        ----------
        effects : sequence of Effect
            In addition to the base's; their values may be batches (B, 1).
        robot : Robot, optional
            In place of the base's.
        steady : SteadyFilter, optional
            The arm's own by default.

        """
        if self.changes_shapes(effects):
            return self._with_own_shapes(effects, robot).innovations(effects, robot, steady)
        arm = self.arm_with(effects, robot)
        errors, _ = self._one_step_errors(arm, effects, robot, steady)
        return np.ascontiguousarray(errors[self.windows.warm_up:].transpose(2, 1, 0, 3))

    def _one_step_errors(self, arm: ExtendedArm, effects: Sequence[Effect], robot: Robot | None,
                         steady: SteadyFilter | None = None, corrected: int | None = None
                         ) -> tuple[Array, ScheduledMatrices]:
        """
        Return errors before the sensors' effects, warm-up first, (S, W, B, m), and matrices.

        Only so many first steps are corrected by measurements; all by default.
        """
        if (steady is None or steady is self.steady) and self._same_plant(effects, robot):
            matrices = self.matrices
        else:
            gain = (steady or self.steady_filter_of(arm)).gain
            matrices = predictor_matrices(self, arm, gain, self.used_samples)
        batch = _batch_size(effects)
        run = FilterRun(self, arm, matrices, self.used_samples, batch, self.own_run)
        rows = self.window_rows
        states = run.states(rows, run.trajectory[rows[0], 0], corrected)
        return run.measured[rows] - states @ arm.output_matrix.T, matrices

    @cached_property
    def own_run(self) -> FilterRun:
        """Return the run of the trajectory's own arm through the samples used."""
        return FilterRun(self, self.arm, self.matrices, self.used_samples, 1)

    @cached_property
    def used_samples(self) -> Indices:
        """Return the numbers of the samples that the windows use, (N,)."""
        return np.unique(self.windows.indices)

    @cached_property
    def window_rows(self) -> Indices:
        """Return where the windows' samples are among those used, warm-up first, (S, W)."""
        return np.searchsorted(self.used_samples, self.windows.indices.T)

    def whitened_residual(self, effects: Sequence[Effect] = (), robot: Robot | None = None,
                          shared_covariance: bool = True) -> Array:
        """
        Return L^-1 (y - y_h), (B, W, length, m), with y_h the mean of the record under h.

        Parameters
        ----------
        effects, robot
            The hypothesis h, as in `innovations`.
        shared_covariance : bool
            Whether L L' is the covariance that the base alone states, the same for all hypotheses,
            see `whitening`. Otherwise the errors are those of each arm's own filter. These must
            not be compared between hypotheses, but guide a fit that starts far from its optimum.

        """
        if self.changes_shapes(effects):
            return self._with_own_shapes(effects, robot).whitened_residual(
                effects, robot, shared_covariance=shared_covariance)
        arm, warm_up = self.arm_with(effects, robot), self.windows.warm_up
        whitening = self._whitening_filter(arm, effects, robot) if shared_covariance else None
        # What an arm without contact does on average it does without corrections as well.
        open_loop = whitening is not None and not arm.has_contact
        errors, matrices = self._one_step_errors(
            arm, effects, robot, corrected=warm_up if open_loop else None)
        errors, rows = errors[warm_up:], self.window_rows[warm_up:]
        sensors, samples = self._sensors_of(arm), self.used_samples[rows]
        if whitening is not None:
            residual = errors if open_loop else output_error(
                matrices, arm.output_matrix, errors, rows)
            residual = shifted(sensors.reading_of_error(residual, samples), -arm.late)
            errors = whitening.whitened(residual, rows)
        else:
            errors = sensors.reading_of_error(errors, samples)
        errors = errors.transpose(2, 1, 0, 3)
        return np.asarray((self.whitener @ errors[..., None])[..., 0], dtype=float)

    def _whitening_filter(self, arm: ExtendedArm, effects: Sequence[Effect], robot: Robot | None
                          ) -> WhiteningFilter | None:
        """Return the filter that whitens a hypothesis; None where its own filter is that one."""
        other_robot = robot is not None and robot != self.base.robot
        structural = _structural_effects(effects)
        differs = other_robot or bool(structural) or arm.acts_on_output
        return self.nominal_whitening if differs else None

    @cached_property
    def nominal_whitening(self) -> WhiteningFilter:
        """Return the whitening filter of the base alone."""
        plain = self.arm_with()
        if self._same_plant((), self.base.robot):
            return WhiteningFilter(self.matrices, plain.output_matrix)
        gain = self.steady_filter_of(plain).gain
        return WhiteningFilter(predictor_matrices(self, plain, gain, self.used_samples),
                               plain.output_matrix)

    @cached_property
    def whitener(self) -> Array:
        """Return L^-1 of the base's innovations at the scored samples, (W, length, m, m)."""
        plain = self.arm_with()
        table = self.steady_filter_of(plain).whitener
        rows = self.windows.indices[:, self.windows.warm_up:]
        weights = barycentric_weights(np.cos(self.record.output[rows, 1]).ravel(), plain.nodes)
        m = table.shape[-1]
        return np.asarray((weights @ table.reshape(len(table), -1)).reshape(*rows.shape, m, m))

    def changes_shapes(self, effects: Sequence[Effect]) -> bool:
        """Tell whether an arm with effects bends in other shapes than the trajectory's."""
        return _shape_effects(effects) != _shape_effects(self.trajectory_effects)

    def _same_plant(self, effects: Sequence[Effect], robot: Robot | None) -> bool:
        """Tell whether effects and robot leave the trajectory's matrices as they are."""
        same = robot is None or robot == self.robot
        return same and (_structural_effects(effects)
                         == _structural_effects(self.trajectory_effects))

    def _with_own_shapes(self, effects: Sequence[Effect], robot: Robot | None) -> Predictor:
        """Return a predictor with a trajectory of its own: its coordinates are other shapes."""
        return Predictor(self.base, self.windows, self.noise, self.for_comparison, effects, robot)

    @cached_property
    def matrices(self) -> ScheduledMatrices:
        """Return the trajectory's matrices, shared by all effects that leave the plant alone."""
        return predictor_matrices(self, self.arm, self.gain, self.used_samples)

    def at(self, chosen: Indices) -> Predictor:
        """Return the same predictor for some of its windows alone."""
        depend_on_windows = ('matrices', 'own_run', 'whitener', 'nominal_whitening',
                             'used_samples', 'window_rows')
        other = object.__new__(Predictor)
        other.__dict__.update({k: v for k, v in self.__dict__.items()
                               if k not in depend_on_windows})
        other.windows = self.windows.at(chosen)
        return other

    def _filtered_states(self, arm: ExtendedArm) -> Array:
        """Return the predicted states of the base over the whole record, (N, n)."""
        rows = np.arange(len(self.record.time))
        run = FilterRun(self, arm, predictor_matrices(self, arm, self.gain, rows), rows, 1)
        count = first_rows(self.windows.warm_up)
        whitener = interpolated(self.weights[:count], self.steady.whitener)
        first = first_state(arm, run, self.noise, whitener)
        return run.states(rows[:, None], first[None])[:, 0, 0]

    def weights_of(self, arm: ExtendedArm) -> Array:
        """Return weights over the schedule nodes at the elbow angles an arm has, (N, K)."""
        shift = self._joint_shift(arm)
        if shift is None or not shift[:, 1].any():
            return self.weights
        return barycentric_weights(np.cos(self.angle + shift[:, 1]), arm.nodes)

    def _joint_shift(self, arm: ExtendedArm) -> Array | None:
        """Return joint angles as an arm's sensors mean them less as the base's, rad, (N, 2)."""
        sensors = self._sensors_of(arm)
        if self._last_shift is None or self._last_shift[0] is not sensors:
            shift = sensors.outputs[:, 0, :2] - self.base_joint_angle \
                if arm.acts_on_output else np.zeros((1, 2))
            self._last_shift = sensors, shift if shift.any() else None
        return self._last_shift[1]

    def measured_by(self, arm: ExtendedArm) -> Array:
        """Return the record's outputs before an arm's sensor effects, (N, 1 or B, m)."""
        return self._sensors_of(arm).outputs

    def _sensors_of(self, arm: ExtendedArm) -> SensorMap:
        # Needed five times in a pass with the same arm.
        if self._last_sensors is None or self._last_sensors.arm is not arm:
            self._last_sensors = SensorMap(arm, self.record)
        return self._last_sensors

    @cached_property
    def base_joint_angle(self) -> Array:
        """Return the joint angles as the base's sensors mean them, rad, (N, 2)."""
        return SensorMap(self.arm, self.record).outputs[:, 0, :2]

    def trajectory_states(self, arm: ExtendedArm, rows: Indices) -> Array:
        """
        Return the trajectory in an arm's states at samples (N,), (N, n).

        New coordinates are zero. New first-order states, of lags, filters and delays, are at rest
        with the others: a delayed angle that began at zero would jump. Integrals have no rest and
        have summed up since the record began.
        """
        states, known = matched_states(arm, self.arm, self.states[rows])
        shift = self._joint_shift(arm)
        if shift is not None:
            states[:, :2] += shift[rows]
        if known < arm.states:
            states[:, known:] = states_at_rest(arm, states[:, :known], self.record.command[rows])
            summing = integrators(arm, known)
            if summing.size:
                every, _ = matched_states(arm, self.arm, self.states)
                every[:, known:] = states_at_rest(arm, every[:, :known], self.record.command)
                states[:, summing] = integrals(arm, summing, every, self.record)[rows]
        return states


def _structural_effects(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    return tuple(effect for effect in effects if effect.structural)


def _shape_effects(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    return tuple(effect for effect in effects if effect.reshapes)


def _batch_size(effects: Sequence[Effect]) -> int:
    """Return B, from effects whose values are arrays (B, 1)."""
    shapes = [np.shape(value) for effect in effects for value in effect.values]
    return max([shape[0] for shape in shapes if shape], default=1)
