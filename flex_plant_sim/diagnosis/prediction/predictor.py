"""One-step prediction over the windows of a record, by a scheduled steady Kalman predictor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.schedule import barycentric_weights
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.discrepancy import Discrepancy, DiscrepancyModel
from flex_plant_sim.diagnosis.prediction.filter_run import (
    FilterRun,
    invert_sensors,
    predictor_matrices,
    sensor_gain,
)
from flex_plant_sim.diagnosis.prediction.noise import (
    process_noise_variance,
    rms_loads,
    steady_filter,
    SteadyFilter,
)
from flex_plant_sim.diagnosis.prediction.scheduled_matrices import ScheduledMatrices
from flex_plant_sim.diagnosis.prediction.whitening import (
    delay_strain,
    output_error,
    WhiteningFilter,
)
from flex_plant_sim.diagnosis.record.windows import Indices, Record, Windows
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Over cos theta_2: leaves 1e-4 of the matrices; with 5 a size moved by a tenth of its interval.
SCHEDULE_NODES = 7
# About the angles that the last one found: with 4 no digit changes, with 1 a size by a twentieth
# of its interval.
TRAJECTORY_PASSES = 2
# s, of the reference arm: noise levels are those of a step so long.
REFERENCE_STEP = 0.01


@dataclass(frozen=True)
class BaseModel:
    """
    The model that hypotheses are added to.

    Attributes
    ----------
    robot : Robot
    model : str
    modes : int
    effects : tuple of Effect
        Always on.
    level : tuple of float
        Process noise as shares of the loads in a 10 ms step, see process_noise.
    discrepancy : Amplitude
        What every model lacks, where causes are judged.

    """

    robot: Robot
    model: str = 'assumed_modes'
    modes: int = 3
    effects: tuple[Effect, ...] = ()
    noise_shares: tuple[float, float] = (0.01, 0.02)
    discrepancy: DiscrepancyModel = DiscrepancyModel()

    def arm(self, payload: float, effects: Sequence[Effect] = (),
            robot: Robot | None = None, in_step: bool = False) -> ExtendedArm:
        """Return the arm with further effects; see ExtendedArm."""
        return ExtendedArm(robot or self.robot, self.model, self.modes, payload,
                           (*self.effects, *effects), nodes=SCHEDULE_NODES, in_step=in_step)


class Predictor:
    """
    A record, its windows and the base model's filtered trajectory through it.

    Smooth forces are evaluated along that trajectory, sensors that are affine are inverted, so
    that most hypotheses stay linear in the state; dry friction and contact are not.

    Parameters
    ----------
    base : Base
    windows : Windows
    noise : Array
        Standard deviation of each output channel, (m,).
    judging : bool
        Whether it serves to tell causes apart. Then it knows of a discrepancy, and strain that
        reads whole samples late is brought forward to the angles it belongs to: the likelihood of
        a record is the same in any order of its samples, and so exact for delays of any length.
        What is predicted in real time must not be brought forward.
    around : sequence of Effect
        On top of the base's, for the trajectory.
    robot : Robot, optional
        In place of the base's, for the trajectory.

    """

    def __init__(self, base: BaseModel, windows: Windows, noise: Array, for_comparison: bool = False,
                 trajectory_effects: Sequence[Effect] = (), robot: Robot | None = None):
        self.base, self.windows, self.noise, self.for_comparison = base, windows, noise, for_comparison
        self.trajectory_effects, self.robot = tuple(trajectory_effects), robot or base.robot
        self._filters: dict[bytes, SteadyFilter] = {}
        self._last_whitening: tuple[tuple[Effect, ...], WhiteningFilter] | None = None
        self._shift: tuple[ExtendedArm, Array] | None = None
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
        """Return the base's arm with further effects, or another robot's."""
        if not self.for_comparison:
            return self.base.arm(self.record.payload, effects, robot)
        # The discrepancy comes first, so that its states are behind the arm's own.
        known = *self.base.effects, *self.base.discrepancy.laws
        base = replace(self.base, effects=(self.discrepancy, *known))
        return base.arm(self.record.payload, effects, robot, in_step=True)

    def _force_variance(self, arm: ExtendedArm) -> Array:
        # White force noise of the same density moves a shorter step by less than its share.
        share = np.sqrt(REFERENCE_STEP / arm.robot.sample_time)
        return process_noise_variance(rms_loads(arm, *self.record.deviations),
                             (share * self.base.noise_shares[0], share * self.base.noise_shares[1]))

    def steady_filter_of(self, arm: ExtendedArm) -> SteadyFilter:
        """Return an arm's steady filter: another arm's may be unstable with it."""
        own = self.discrepancy.step_variance(
            arm, self.record, self.base.discrepancy) if self.for_comparison else np.zeros(arm.states)
        force = self._force_variance(arm)
        # Many effects leave the plant alone, or differ from another in what it does not hold.
        key = blake2b(b''.join(part.tobytes() for part in (
            arm.schedule.table, arm.output_matrix, force, own))).digest()
        if key not in self._filters:
            self._filters[key] = steady_filter(arm, force, self.noise, own)
        return self._filters[key]

    def innovations(self, effects: Sequence[Effect] = (), robot: Robot | None = None,
                    steady: SteadyFilter | None = None) -> Array:
        """
        Return y - y_predicted over the scored samples, (B, W, length, m).

        Parameters
        ----------
        effects : sequence of Effect
            On top of the base's; their values may be arrays (B, 1).
        robot : Robot, optional
            In place of the base's.
        steady : Steady, optional
            The arm's own by default.

        """
        if self._changes_shapes(effects):
            return self._with_own_shapes(effects, robot).innovations(effects, robot, steady)
        arm = self.arm_with(effects, robot)
        errors, _ = self._one_step_errors(arm, effects, robot, steady)
        return np.ascontiguousarray(errors[self.windows.warm_up:].transpose(2, 1, 0, 3))

    def _one_step_errors(self, arm: ExtendedArm, effects: Sequence[Effect], robot: Robot | None,
                steady: SteadyFilter | None) -> tuple[Array, ScheduledMatrices]:
        """Return one-step errors before the sensors' effects, warm-up first, (S, W, B, m)."""
        if (steady is None or steady is self.steady) and self._same_plant(effects, robot):
            matrices = self.matrices
        else:
            matrices = predictor_matrices(self, arm, (steady or self.steady_filter_of(arm)).gain, self.used_samples)
        run = FilterRun(self, arm, matrices, self.used_samples, _batch_size(effects))
        window_rows = self.window_rows
        states = run.states(window_rows, run.trajectory[window_rows[0], 0])
        return run.measured[window_rows] - states @ arm.output_matrix.T, matrices

    @cached_property
    def used_samples(self) -> Indices:
        """Return the samples that windows use, (N,)."""
        return np.unique(self.windows.indices)

    @cached_property
    def window_rows(self) -> Indices:
        """Return the places of the windows' samples among those used, warm-up first, (S, W)."""
        return np.searchsorted(self.used_samples, self.windows.indices.T)

    def whitened_residual(self, effects: Sequence[Effect] = (), robot: Robot | None = None,
                 reuse_gain: bool = False, shared_covariance: bool = True) -> Array:
        """
        Return L^-1 (y - y_h), (B, W, length, m), y_h what a hypothesis says of the record.

        L L' is the covariance of the record that the base alone states, the same for all, see
        Common. With `keep`, the trajectory's own gain serves an arm with the same states, for
        small changes. Unless `alike`, each arm's own filter follows the record: what that errs
        compares no causes, but tells a fit from afar where to go. Other parameters are those of
        `innovations`.
        """
        if self._changes_shapes(effects):
            return self._with_own_shapes(effects, robot).whitened_residual(effects, robot, shared_covariance=shared_covariance)
        arm = self.arm_with(effects, robot)
        reused = reuse_gain and self.gain.shape[1] == arm.states
        errors, matrices = self._one_step_errors(arm, effects, robot, self.steady if reused else None)
        errors, window_rows = errors[self.windows.warm_up:], self.window_rows[self.windows.warm_up:]
        nominal_whitening = self._whitening_filter(arm, effects, robot) if shared_covariance else None
        if nominal_whitening is not None:
            left = output_error(matrices, arm.output_matrix, errors, window_rows)
            if arm.acts_on_output:
                left = np.matmul(sensor_gain(arm, self.record), left[..., None])[..., 0]
            late = 0 if self.base.discrepancy.behind_sensors else arm.late
            errors = nominal_whitening.whitened(delay_strain(left, late), window_rows)
        elif arm.acts_on_output:
            errors = np.matmul(sensor_gain(arm, self.record), errors[..., None])[..., 0]
        errors = errors.transpose(2, 1, 0, 3)
        return np.asarray((self.whitener @ errors[..., None])[..., 0], dtype=float)

    def _whitening_filter(self, arm: ExtendedArm, effects: Sequence[Effect], robot: Robot | None
                ) -> WhiteningFilter | None:
        """Return the covariance to judge effects in; None where their own filter states it."""
        moved = robot is not None and robot != self.base.robot
        plant = _structural_effects(effects)
        if self.base.discrepancy.behind_sensors:
            sensors = tuple(e for e in plant if e.family == 'sensors')
            return self._whitening_filter_of(sensors) if moved or sensors != plant else None
        acts = moved or bool(plant) or arm.acts_on_output
        return self.nominal_whitening if acts else None

    def _whitening_filter_of(self, effects: tuple[Effect, ...]) -> WhiteningFilter:
        """Return the covariance that the base with some effects states."""
        if effects and self._same_plant(effects, self.base.robot):
            return WhiteningFilter(self.matrices, self.arm.output_matrix)
        if not effects:
            return self.nominal_whitening
        # The parts of an arm are asked one after another, with the same sensors.
        reused = self._last_whitening
        if reused is None or reused[0] != effects:
            arm = self.arm_with(effects)
            reused = self._last_whitening = effects, WhiteningFilter(
                predictor_matrices(self, arm, self.steady_filter_of(arm).gain, self.used_samples), arm.output_matrix)
        return reused[1]

    @cached_property
    def nominal_whitening(self) -> WhiteningFilter:
        """Return the covariance that the base alone states."""
        plain = self.arm_with()
        if self._same_plant((), self.base.robot):
            return WhiteningFilter(self.matrices, plain.output_matrix)
        return WhiteningFilter(predictor_matrices(self, plain, self.steady_filter_of(plain).gain, self.used_samples),
                      plain.output_matrix)

    @cached_property
    def whitener(self) -> Array:
        """Return L^-1 at the scored samples, (W, length, m, m)."""
        plain = self.arm_with()
        table = self.steady_filter_of(plain).whitener
        window_rows = self.windows.indices[:, self.windows.warm_up:]
        weights = barycentric_weights(np.cos(self.record.output[window_rows, 1]).ravel(), plain.nodes)
        m = table.shape[-1]
        return np.asarray((weights @ table.reshape(len(table), -1)).reshape(*window_rows.shape, m, m))

    def _changes_shapes(self, effects: Sequence[Effect]) -> bool:
        return _shape_effects(effects) != _shape_effects(self.trajectory_effects)

    def _same_plant(self, effects: Sequence[Effect], robot: Robot | None) -> bool:
        """Tell whether effects and robot leave the trajectory's matrices as they are."""
        same = robot is None or robot == self.robot
        return same and _structural_effects(effects) == _structural_effects(self.trajectory_effects)

    def _with_own_shapes(self, effects: Sequence[Effect], robot: Robot | None) -> Predictor:
        """Return a predictor with a trajectory of its own: its coordinates mean other shapes."""
        return Predictor(self.base, self.windows, self.noise, self.for_comparison, effects, robot)

    @cached_property
    def matrices(self) -> ScheduledMatrices:
        """Return the trajectory's matrices, which serve all effects that leave the plant alone."""
        return predictor_matrices(self, self.arm, self.gain, self.used_samples)

    def thinned(self, every: int) -> Predictor:
        """Return the same predictor, asked about every so-manieth window alone."""
        other = object.__new__(Predictor)
        other.__dict__.update({k: v for k, v in self.__dict__.items()
                               if k not in ('matrices', 'whitener', 'nominal_whitening', 'used_samples', 'window_rows')})
        other.windows, other._last_whitening = self.windows.thinned(every), None
        return other

    def _filtered_states(self, arm: ExtendedArm) -> Array:
        """Return the predicted states of the base over the whole record, (N, n)."""
        window_rows = np.arange(len(self.record.time))
        run = FilterRun(self, arm, predictor_matrices(self, arm, self.gain, window_rows), window_rows, 1)
        start = np.zeros((1, arm.states))
        start[0, :2] = self.record.output[0, :2]
        return run.states(window_rows[:, None], start)[:, 0, 0]

    def weights_of(self, arm: ExtendedArm) -> Array:
        """Return the weights over schedule nodes where an arm's sensors put the elbow, (N, K)."""
        shift = self._joint_shift(arm)[:, 1]
        if not shift.any():
            return self.weights
        return barycentric_weights(np.cos(self.angle + shift), arm.nodes)

    def _joint_shift(self, arm: ExtendedArm) -> Array:
        """Return how far the joints are from where the base sees them, (N, 2)."""
        if not arm.acts_on_output:
            return np.zeros((len(self.record.time), 2))
        # Asked three times in a pass.
        if self._shift is None or self._shift[0] is not arm:
            self._shift = arm, invert_sensors(arm, self.record)[:, 0, :2] - self.base_joint_angle
        return self._shift[1]

    @cached_property
    def base_joint_angle(self) -> Array:
        """Return where the base sees the joints, rad, (N, 2)."""
        return invert_sensors(self.arm, self.record)[:, 0, :2]

    def trajectory_states(self, arm: ExtendedArm, window_rows: Indices) -> Array:
        """Return the trajectory's states at samples (N,), (N, n); what it lacks is at zero."""
        states = self._matched_states(arm, window_rows)
        if arm.acts_on_output:
            states[:, :2] += self._joint_shift(arm)[window_rows]
        return states

    def _matched_states(self, arm: ExtendedArm, window_rows: Indices) -> Array:
        n, own = arm.form.order, self.arm.form.order
        states, known = np.zeros((len(window_rows), arm.states)), self.states[window_rows]
        for place, name in enumerate(arm.form.names):
            if name in self.arm.form.names:
                there = self.arm.form.names.index(name)
                states[:, [place, n + place]] = known[:, [there, own + there]]
        rest = min(known.shape[1] - 2 * own, arm.states - 2 * n)
        states[:, 2 * n:2 * n + rest] = known[:, 2 * own:2 * own + rest]
        return states


def _structural_effects(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    return tuple(effect for effect in effects if effect.structural)


def _shape_effects(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    return tuple(effect for effect in effects if effect.reshapes)


def _batch_size(effects: Sequence[Effect]) -> int:
    """Return B, from effects whose values are arrays (B, 1)."""
    shapes = [np.shape(value) for effect in effects for value in effect.values]
    return max([shape[0] for shape in shapes if shape], default=1)
