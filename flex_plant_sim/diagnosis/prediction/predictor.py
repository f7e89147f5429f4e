"""One-step prediction over the windows of a record, by a scheduled steady Kalman predictor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.schedule import barycentric_weights
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.common import as_late, Common, missed
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude, Discrepancy
from flex_plant_sim.diagnosis.prediction.matrices import Matrices
from flex_plant_sim.diagnosis.prediction.noise import (
    load_levels,
    process_noise,
    Steady,
    steady_filter,
)
from flex_plant_sim.diagnosis.prediction.passage import (
    matrices_of,
    Run,
    sensor_gain,
    undo_sensors,
)
from flex_plant_sim.diagnosis.record.windows import Indices, Record, Windows
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Over cos theta_2: leaves 1e-4 of the matrices; with 5 a size moved by a tenth of its interval.
NODES = 7
# About the angles that the last one found: with 4 no digit changes, with 1 a size by a twentieth
# of its interval.
PASSES = 2
# s, of the reference arm: noise levels are those of a step so long.
LEVEL_STEP = 0.01


@dataclass(frozen=True)
class Base:
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
    level: tuple[float, float] = (0.01, 0.02)
    discrepancy: Amplitude = Amplitude()

    def arm(self, payload: float, effects: Sequence[Effect] = (),
            robot: Robot | None = None, in_step: bool = False) -> ExtendedArm:
        """Return the arm with further effects; see ExtendedArm."""
        return ExtendedArm(robot or self.robot, self.model, self.modes, payload,
                           (*self.effects, *effects), nodes=NODES, in_step=in_step)


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

    def __init__(self, base: Base, windows: Windows, noise: Array, judging: bool = False,
                 around: Sequence[Effect] = (), robot: Robot | None = None):
        self.base, self.windows, self.noise, self.judging = base, windows, noise, judging
        self.around, self.robot = tuple(around), robot or base.robot
        self._filters: dict[bytes, Steady] = {}
        self._stated: tuple[tuple[Effect, ...], Common] | None = None
        self._shift: tuple[ExtendedArm, Array] | None = None
        self.record: Record = windows.record
        period = windows.warm_up * base.robot.sample_time
        self.discrepancy = Discrepancy.of(base.discrepancy, period)
        self.arm = arm = self.arm_with(around, robot)
        self.weights = barycentric_weights(np.cos(self.record.output[:, 1]), arm.nodes)
        self.steady = self.steady_of(arm)
        self.gain = self.steady.gain
        self.states = np.zeros((len(self.record.time), arm.states))
        for _ in range(PASSES):
            self.states = self._filter(arm)
            self.angle = self.states[:, :arm.form.order] @ arm.form.elbow_angle
            self.weights = barycentric_weights(np.cos(self.angle), arm.nodes)

    def arm_with(self, effects: Sequence[Effect] = (), robot: Robot | None = None) -> ExtendedArm:
        """Return the base's arm with further effects, or another robot's."""
        if not self.judging:
            return self.base.arm(self.record.payload, effects, robot)
        # The discrepancy comes first, so that its states are behind the arm's own.
        known = *self.base.effects, *self.base.discrepancy.laws
        judged = replace(self.base, effects=(self.discrepancy, *known))
        return judged.arm(self.record.payload, effects, robot, in_step=True)

    def _force_variance(self, arm: ExtendedArm) -> Array:
        # White force noise of the same density moves a shorter step by less than its share.
        share = np.sqrt(LEVEL_STEP / arm.robot.sample_time)
        return process_noise(load_levels(arm, *self.record.deviations),
                             (share * self.base.level[0], share * self.base.level[1]))

    def steady_of(self, arm: ExtendedArm) -> Steady:
        """Return an arm's steady filter: another arm's may be unstable with it."""
        own = self.discrepancy.step_variance(
            arm, self.record, self.base.discrepancy) if self.judging else np.zeros(arm.states)
        force = self._force_variance(arm)
        # Many effects leave the plant alone, or differ from another in what it does not hold.
        key = blake2b(b''.join(part.tobytes() for part in (
            arm.schedule.table, arm.output_matrix, force, own))).digest()
        if key not in self._filters:
            self._filters[key] = steady_filter(arm, force, self.noise, own)
        return self._filters[key]

    def innovations(self, effects: Sequence[Effect] = (), robot: Robot | None = None,
                    steady: Steady | None = None) -> Array:
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
        if self._reshaped(effects):
            return self._with_other_shapes(effects, robot).innovations(effects, robot, steady)
        arm = self.arm_with(effects, robot)
        errors, _ = self._passed(arm, effects, robot, steady)
        return np.ascontiguousarray(errors[self.windows.warm_up:].transpose(2, 1, 0, 3))

    def _passed(self, arm: ExtendedArm, effects: Sequence[Effect], robot: Robot | None,
                steady: Steady | None) -> tuple[Array, Matrices]:
        """Return one-step errors before the sensors' effects, warm-up first, (S, W, B, m)."""
        if (steady is None or steady is self.steady) and self._same_plant(effects, robot):
            matrices = self.matrices
        else:
            matrices = matrices_of(self, arm, (steady or self.steady_of(arm)).gain, self.used)
        run = Run(self, arm, matrices, self.used, _batch(effects))
        rows = self.rows
        states = run.states(rows, run.trajectory[rows[0], 0])
        return run.measured[rows] - states @ arm.output_matrix.T, matrices

    @cached_property
    def used(self) -> Indices:
        """Return the samples that windows use, (N,)."""
        return np.unique(self.windows.indices)

    @cached_property
    def rows(self) -> Indices:
        """Return the places of the windows' samples among those used, warm-up first, (S, W)."""
        return np.searchsorted(self.used, self.windows.indices.T)

    def whitened(self, effects: Sequence[Effect] = (), robot: Robot | None = None,
                 keep: bool = False, alike: bool = True) -> Array:
        """
        Return L^-1 (y - y_h), (B, W, length, m), y_h what a hypothesis says of the record.

        L L' is the covariance of the record that the base alone states, the same for all, see
        Common. With `keep`, the trajectory's own gain serves an arm with the same states, for
        small changes. Unless `alike`, each arm's own filter follows the record: what that errs
        compares no causes, but tells a fit from afar where to go. Other parameters are those of
        `innovations`.
        """
        if self._reshaped(effects):
            return self._with_other_shapes(effects, robot).whitened(effects, robot, alike=alike)
        arm = self.arm_with(effects, robot)
        kept = keep and self.gain.shape[1] == arm.states
        errors, matrices = self._passed(arm, effects, robot, self.steady if kept else None)
        errors, rows = errors[self.windows.warm_up:], self.rows[self.windows.warm_up:]
        common = self._common(arm, effects, robot) if alike else None
        if common is not None:
            left = missed(matrices, arm.output_matrix, errors, rows)
            if arm.acts_on_output:
                left = np.matmul(sensor_gain(arm, self.record), left[..., None])[..., 0]
            late = 0 if self.base.discrepancy.sensed else arm.late
            errors = common.whitened(as_late(left, late), rows)
        elif arm.acts_on_output:
            errors = np.matmul(sensor_gain(arm, self.record), errors[..., None])[..., 0]
        errors = errors.transpose(2, 1, 0, 3)
        return np.asarray((self.whitener @ errors[..., None])[..., 0], dtype=float)

    def _common(self, arm: ExtendedArm, effects: Sequence[Effect], robot: Robot | None
                ) -> Common | None:
        """Return the covariance to judge effects in; None where their own filter states it."""
        moved = robot is not None and robot != self.base.robot
        plant = _structural(effects)
        if self.base.discrepancy.sensed:
            sensors = tuple(e for e in plant if e.family == 'sensors')
            return self._stated_by(sensors) if moved or sensors != plant else None
        acts = moved or bool(plant) or arm.acts_on_output
        return self.common if acts else None

    def _stated_by(self, effects: tuple[Effect, ...]) -> Common:
        """Return the covariance that the base with some effects states."""
        if effects and self._same_plant(effects, self.base.robot):
            return Common(self.matrices, self.arm.output_matrix)
        if not effects:
            return self.common
        # The parts of an arm are asked one after another, with the same sensors.
        kept = self._stated
        if kept is None or kept[0] != effects:
            arm = self.arm_with(effects)
            kept = self._stated = effects, Common(
                matrices_of(self, arm, self.steady_of(arm).gain, self.used), arm.output_matrix)
        return kept[1]

    @cached_property
    def common(self) -> Common:
        """Return the covariance that the base alone states."""
        plain = self.arm_with()
        if self._same_plant((), self.base.robot):
            return Common(self.matrices, plain.output_matrix)
        return Common(matrices_of(self, plain, self.steady_of(plain).gain, self.used),
                      plain.output_matrix)

    @cached_property
    def whitener(self) -> Array:
        """Return L^-1 at the scored samples, (W, length, m, m)."""
        plain = self.arm_with()
        table = self.steady_of(plain).whitener
        rows = self.windows.indices[:, self.windows.warm_up:]
        weights = barycentric_weights(np.cos(self.record.output[rows, 1]).ravel(), plain.nodes)
        m = table.shape[-1]
        return np.asarray((weights @ table.reshape(len(table), -1)).reshape(*rows.shape, m, m))

    def _reshaped(self, effects: Sequence[Effect]) -> bool:
        return _reshaping(effects) != _reshaping(self.around)

    def _same_plant(self, effects: Sequence[Effect], robot: Robot | None) -> bool:
        """Tell whether effects and robot leave the trajectory's matrices as they are."""
        same = robot is None or robot == self.robot
        return same and _structural(effects) == _structural(self.around)

    def _with_other_shapes(self, effects: Sequence[Effect], robot: Robot | None) -> Predictor:
        """Return a predictor with a trajectory of its own: its coordinates mean other shapes."""
        return Predictor(self.base, self.windows, self.noise, self.judging, effects, robot)

    @cached_property
    def matrices(self) -> Matrices:
        """Return the trajectory's matrices, which serve all effects that leave the plant alone."""
        return matrices_of(self, self.arm, self.gain, self.used)

    def thinned(self, every: int) -> Predictor:
        """Return the same predictor, asked about every so-manieth window alone."""
        other = object.__new__(Predictor)
        other.__dict__.update({k: v for k, v in self.__dict__.items()
                               if k not in ('matrices', 'whitener', 'common', 'used', 'rows')})
        other.windows, other._stated = self.windows.thinned(every), None
        return other

    def _filter(self, arm: ExtendedArm) -> Array:
        """Return the predicted states of the base over the whole record, (N, n)."""
        rows = np.arange(len(self.record.time))
        run = Run(self, arm, matrices_of(self, arm, self.gain, rows), rows, 1)
        start = np.zeros((1, arm.states))
        start[0, :2] = self.record.output[0, :2]
        return run.states(rows[:, None], start)[:, 0, 0]

    def weights_of(self, arm: ExtendedArm) -> Array:
        """Return the weights over schedule nodes where an arm's sensors put the elbow, (N, K)."""
        shift = self._angle_shift(arm)[:, 1]
        if not shift.any():
            return self.weights
        return barycentric_weights(np.cos(self.angle + shift), arm.nodes)

    def _angle_shift(self, arm: ExtendedArm) -> Array:
        """Return how far the joints are from where the base sees them, (N, 2)."""
        if not arm.acts_on_output:
            return np.zeros((len(self.record.time), 2))
        # Asked three times in a pass.
        if self._shift is None or self._shift[0] is not arm:
            self._shift = arm, undo_sensors(arm, self.record)[:, 0, :2] - self.own_angle
        return self._shift[1]

    @cached_property
    def own_angle(self) -> Array:
        """Return where the base sees the joints, rad, (N, 2)."""
        return undo_sensors(self.arm, self.record)[:, 0, :2]

    def started(self, arm: ExtendedArm, rows: Indices) -> Array:
        """Return the trajectory's states at samples (N,), (N, n); what it lacks is at zero."""
        states = self._started(arm, rows)
        if arm.acts_on_output:
            states[:, :2] += self._angle_shift(arm)[rows]
        return states

    def _started(self, arm: ExtendedArm, rows: Indices) -> Array:
        n, own = arm.form.order, self.arm.form.order
        states, known = np.zeros((len(rows), arm.states)), self.states[rows]
        for place, name in enumerate(arm.form.names):
            if name in self.arm.form.names:
                there = self.arm.form.names.index(name)
                states[:, [place, n + place]] = known[:, [there, own + there]]
        rest = min(known.shape[1] - 2 * own, arm.states - 2 * n)
        states[:, 2 * n:2 * n + rest] = known[:, 2 * own:2 * own + rest]
        return states


def _structural(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    return tuple(effect for effect in effects if effect.structural)


def _reshaping(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    return tuple(effect for effect in effects if effect.reshapes)


def _batch(effects: Sequence[Effect]) -> int:
    """Return B, from effects whose values are arrays (B, 1)."""
    shapes = [np.shape(value) for effect in effects for value in effect.values]
    return max([shape[0] for shape in shapes if shape], default=1)
