"""One-step prediction over the windows of a record, by a scheduled steady Kalman predictor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.noise import load_levels, process_noise, steady_gain
from flex_plant_sim.diagnosis.nuisance import nuisances, settled
from flex_plant_sim.diagnosis.scan import Friction, scan
from flex_plant_sim.diagnosis.windows import Indices, Record, Windows
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.extended_arm import ExtendedArm
from flex_plant_sim.robot import Robot
from flex_plant_sim.schedule import barycentric_weights
import numpy as np

NODES = 7
PASSES = 2
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
    deviations : tuple of float
        Of the robot's parameters from its file, as `nuisances` lists them, (p,); or none.

    """

    robot: Robot
    model: str = 'assumed_modes'
    modes: int = 3
    effects: tuple[Effect, ...] = ()
    level: tuple[float, float] = (0.01, 0.02)
    deviations: tuple[float, ...] = ()

    def settled(self, payload: float) -> Base:
        """Return the base with its deviations in the robot and the effects."""
        robot, effects = settled(self.robot, nuisances(self.robot, payload),
                                 np.array(self.deviations))
        return replace(self, robot=robot, effects=(*self.effects, *effects), deviations=())

    def arm(self, payload: float, effects: Sequence[Effect] = (),
            robot: Robot | None = None) -> ExtendedArm:
        """Return the arm with further effects."""
        return ExtendedArm(robot or self.robot, self.model, self.modes, payload,
                           (*self.effects, *effects), nodes=NODES)


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

    """

    def __init__(self, base: Base, windows: Windows, noise: Array):
        self.base, self.windows, self.noise = base, windows, noise
        self.record: Record = windows.record
        self.arm = arm = base.arm(self.record.payload)
        self.weights = barycentric_weights(np.cos(self.record.output[:, 1]), arm.nodes)
        self.gain = self.gain_of(arm)
        self.states = np.zeros((len(self.record.time), arm.states))
        for _ in range(PASSES):
            self.states = self._filter(arm)
            self.angle = self.states[:, :arm.form.order] @ arm.form.elbow_angle
            self.weights = barycentric_weights(np.cos(self.angle), arm.nodes)

    def _force_variance(self, arm: ExtendedArm) -> Array:
        # White force noise of the same density moves a shorter step by less than its share.
        share = np.sqrt(LEVEL_STEP / arm.robot.sample_time)
        return process_noise(load_levels(arm, self.record.command, self.record.output),
                             (share * self.base.level[0], share * self.base.level[1]))

    def gain_of(self, arm: ExtendedArm) -> Array:
        """Return an arm's steady gain: another arm's may be unstable with it."""
        return steady_gain(arm, self._force_variance(arm), self.noise)

    def innovations(self, effects: Sequence[Effect] = (), robot: Robot | None = None,
                    gain: Array | None = None) -> Array:
        """
        Return y - y_predicted over the scored samples, (B, W, length, m).

        Parameters
        ----------
        effects : sequence of Effect
            On top of the base's; their values may be arrays (B, 1).
        robot : Robot, optional
            In place of the base's.
        gain : Array, optional
            (K, n, m); the arm's own by default.

        """
        if any(hasattr(effect, 'modes') for effect in effects):
            return self._with_other_shapes(effects, robot).innovations(gain=gain)
        arm = self.base.arm(self.record.payload, effects, robot)
        used = np.unique(self.windows.indices)
        if gain is None and robot is None and not any(e.structural for e in effects):
            matrices = self.matrices
        else:
            gain = self.gain_of(arm) if gain is None else gain
            matrices = _Matrices.of(self, arm, gain, used)
        run = _Run(self, arm, matrices, used, _batch(effects))
        rows = np.searchsorted(used, self.windows.indices.T)
        states = run.states(rows, run.trajectory[rows[0], 0])
        scored, rows = states[self.windows.warm_up:], rows[self.windows.warm_up:]
        errors = run.measured[rows] - scored @ arm.output_matrix.T
        return np.ascontiguousarray(errors.transpose(2, 1, 0, 3))

    def _with_other_shapes(self, effects: Sequence[Effect], robot: Robot | None) -> Predictor:
        """Return a predictor with a trajectory of its own: its coordinates mean other shapes."""
        other = replace(self.base, robot=robot or self.base.robot,
                        effects=(*self.base.effects, *effects))
        return Predictor(other, self.windows, self.noise)

    @cached_property
    def matrices(self) -> _Matrices:
        """Return the base's matrices, which serve all effects that leave the plant alone."""
        return _Matrices.of(self, self.arm, self.gain, np.unique(self.windows.indices))

    def thinned(self, every: int) -> Predictor:
        """Return the same predictor, asked about every so-manieth window alone."""
        other = object.__new__(Predictor)
        other.__dict__.update({k: v for k, v in self.__dict__.items() if k != 'matrices'})
        other.windows = self.windows.thinned(every)
        return other

    def _filter(self, arm: ExtendedArm) -> Array:
        """Return the predicted states of the base over the whole record, (N, n)."""
        rows = np.arange(len(self.record.time))
        run = _Run(self, arm, _Matrices.of(self, arm, self.gain, rows), rows, 1)
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
        undone = _undo_sensors(arm, self.record)
        return undone[:, 0, :2] - _undo_sensors(self.arm, self.record)[:, 0, :2]

    def started(self, arm: ExtendedArm) -> Array:
        """Return the base's states, (N, n); where coordinates were added, they are at zero."""
        states = self._started(arm)
        states[:, :2] += self._angle_shift(arm)
        return states

    def _started(self, arm: ExtendedArm) -> Array:
        n, extra = self.arm.form.order, arm.form.order - self.arm.form.order
        states = np.zeros((len(self.states), arm.states))
        if extra > 0:
            states[:, :n] = self.states[:, :n]
            states[:, n + extra:2 * n + extra] = self.states[:, n:2 * n]
            return states
        known = min(self.states.shape[1], arm.states)
        states[:, :known] = self.states[:, :known]
        return states


@dataclass(frozen=True)
class _Matrices:
    """
    The predictor's matrices at some samples of a record.

    Attributes
    ----------
    closed : Array
        F - K C, (N, n, n).
    drive : Array
        [G, E, K], (N, n, 2 + order + m).

    """

    closed: Array
    drive: Array

    @classmethod
    def of(cls, predictor: Predictor, arm: ExtendedArm, gain: Array, used: Indices) -> _Matrices:
        """Interpolate them at the samples used, (N,)."""
        n = arm.states
        weights, table = payload_schedule(arm, predictor.record.time[used],
                                          predictor.weights_of(arm)[used])
        table = table.reshape(len(table), n, -1)
        k = np.tile(gain, (len(table) // NODES, 1, 1))
        closed = (table[..., :n] - k @ arm.output_matrix).reshape(len(table), -1)
        drive = np.concatenate([table[..., n:], k], axis=-1).reshape(len(table), -1)
        return cls((weights @ closed).reshape(len(weights), n, n),
                   (weights @ drive).reshape(len(weights), n, -1))


class _Run:
    """One arm driven through some samples of a record, (N,): their inputs."""

    def __init__(self, predictor: Predictor, arm: ExtendedArm, matrices: _Matrices,
                 used: Indices, batch: int):
        record = predictor.record
        self.arm, self.time = arm, record.time[used][:, None]
        self.command = at_drive(arm, record)[used]
        measured = _undo_sensors(arm, record)[used]
        m, order = record.output.shape[1], arm.form.order
        self.closed, self.response = matrices.closed, matrices.drive[..., 2:2 + order]
        trajectory = predictor.started(arm)[:, None]
        self.measured, self.trajectory = measured, trajectory[used]
        ahead = trajectory[np.minimum(used + 1, len(trajectory) - 1)]
        motion = arm.motion(0.5 * (self.trajectory + ahead), self.command, self.time)
        parts = (self.command, arm.smooth_force(motion), measured)
        drive = np.concatenate([np.broadcast_to(part, (len(used), batch, width))
                                for part, width in zip(parts, (2, order, m))], axis=-1)
        self.inputs = np.matmul(drive, np.swapaxes(matrices.drive, 1, 2))

    def states(self, rows: Indices, start: Array) -> Array:
        """Return the predicted states along windows, rows (S, W): (S, W, B, n)."""
        if not self.arm.has_contact:
            return scan(self.closed, self.inputs, start, rows)
        if not self.arm.has_gap:
            return scan(self.closed, self.inputs, start, rows, self._friction())
        states = np.empty(rows.shape + self.inputs.shape[1:])
        state = np.repeat(start[:, None], self.inputs.shape[1], axis=1)
        for k, row in enumerate(rows):
            states[k] = state
            after = np.matmul(state, np.swapaxes(self.closed[row], 1, 2)) + self.inputs[row]
            motion = self.arm.motion(state, self.command[row], self.time[row])
            state = self.arm.apply_contact(self.response[row][:, None], state, after, motion)
        return states

    def _friction(self) -> Friction:
        # Its levels, like smooth forces, are those at the speeds of the base's trajectory.
        motion = self.arm.motion(self.trajectory, self.command, self.time)
        shape = self.inputs.shape[:2] + (2,)
        limits = np.stack([np.broadcast_to(limit, shape)
                           for limit in self.arm.friction_limits(motion)], axis=2)
        columns, reach = self.arm.friction_columns(self.response)
        return Friction(columns, reach, limits, self.arm.form.order)


def at_drive(arm: ExtendedArm, record: Record) -> Array:
    """Return the command at the drive, (N, 1 or B, 2)."""
    limits = np.array([drive.command_limit for drive in arm.robot.drives])
    command = np.clip(record.command, -limits, limits)[:, None, :]
    for effect in arm.effects:
        if type(effect).on_command is not Effect.on_command:
            memory = effect.memory(arm.robot.sample_time)
            padded = np.concatenate([np.zeros((memory,) + command.shape[1:]), command])
            history = np.zeros(command.shape[:-1] + (0, 2)) if memory == 0 else np.stack(
                [padded[k:k + len(command)] for k in range(memory)], axis=-2)
            command = effect.on_command(command, history, record.time[:, None],
                                        arm.robot.sample_time)
    return command


def _undo_sensors(arm: ExtendedArm, record: Record) -> Array:
    """Return the outputs before the (affine) sensor effects, (N, 1 or B, m)."""
    measured = record.output[:, None, :]
    if not arm.acts_on_output:
        return measured
    time, m = record.time[:, None], record.output.shape[1]
    zero = arm.sense(np.zeros((len(time), 1, m)), time)
    columns = [arm.sense(np.broadcast_to(unit, (1, 1, m)), time[:1]) - zero[:1]
               for unit in np.eye(m)]
    # One inverse for all samples: a sensor's gain does not change with time.
    inverse = np.linalg.inv(np.stack(columns, axis=-1))
    return np.asarray(np.matmul(inverse, (measured - zero)[..., None])[..., 0], dtype=float)


def payload_schedule(arm: ExtendedArm, time: Array, weights: Array) -> tuple[Array, Array]:
    """Return weights over schedule nodes, times payload nodes while the payload changes."""
    mass = np.full(len(time), arm.payload)
    for effect in arm.effects:
        mass = np.asarray(effect.payload_at(time, mass), dtype=float)
    nodes = np.unique([mass.min(), mass.max()])
    if nodes.size == 1:
        return weights, arm.at_payload(float(nodes[0])).schedule.table
    if np.any((mass > nodes[0]) & (mass < nodes[1])):
        nodes = np.array([nodes[0], nodes.mean(), nodes[1]])
    tables = [arm.at_payload(float(m)).schedule.table for m in nodes]
    share = np.linalg.solve(np.vander(nodes, increasing=True).T,
                            np.vander(mass, nodes.size, increasing=True).T).T
    both = (share[:, :, None] * weights[:, None, :]).reshape(len(mass), -1)
    return both, np.concatenate(tables)


def _batch(effects: Sequence[Effect]) -> int:
    """Return B, from effects whose values are arrays (B, 1)."""
    shapes = [np.shape(value) for effect in effects for value in effect.values]
    return max([shape[0] for shape in shapes if shape], default=1)
