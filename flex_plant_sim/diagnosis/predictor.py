"""One-step prediction over the windows of a record, by a scheduled steady Kalman predictor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.noise import load_levels, process_noise, steady_gain
from flex_plant_sim.diagnosis.windows import Record, Windows
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.extended_arm import ExtendedArm
from flex_plant_sim.robot import Robot
from flex_plant_sim.schedule import barycentric_weights
import numpy as np

NODES = 7


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
    ambient : tuple of Effect
        Smooth force effects, always on, evaluated once along the filtered trajectory.
    level : tuple of float
        Process noise as shares of the loads, see process_noise.

    """

    robot: Robot
    model: str = 'assumed_modes'
    modes: int = 3
    effects: tuple[Effect, ...] = ()
    ambient: tuple[Effect, ...] = ()
    level: tuple[float, float] = (0.003, 0.03)

    def arm(self, payload: float, effects: Sequence[Effect] = (),
            robot: Robot | None = None) -> ExtendedArm:
        """Return the arm with further effects."""
        return ExtendedArm(robot or self.robot, self.model, self.modes, payload,
                           (*self.effects, *effects), nodes=NODES)


class Predictor:
    """
    A record, its windows and the base model's filtered trajectory through it.

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
        arm = base.arm(self.record.payload)
        self.arm = arm
        self.force = np.zeros((len(self.record.time), arm.form.order))
        self.weights = barycentric_weights(np.cos(self.record.output[:, 1]), arm.nodes)
        self.gain = steady_gain(arm, self._force_variance(arm), noise)
        for _ in range(2):
            self.states = self._filter(arm)
            self._relinearise(arm)
        self.states = self._filter(arm)

    def _force_variance(self, arm: ExtendedArm) -> Array:
        return process_noise(load_levels(arm, self.record.command, self.record.output),
                             self.base.level)

    def _relinearise(self, arm: ExtendedArm) -> None:
        """Schedule on the angle between the links; evaluate the ambient forces."""
        angle = self.states[:, :arm.form.order] @ arm.form.elbow_angle
        self.weights = barycentric_weights(np.cos(angle), arm.nodes)
        motion = arm.motion(self.states, self._command(arm)[:, 0], self.record.time)
        self.force = np.zeros((len(angle), arm.form.order)) + sum(
            effect.force(motion) for effect in self.base.ambient)

    def _command(self, arm: ExtendedArm) -> Array:
        """Return the command at the drive, (N, B, 2)."""
        limits = np.array([drive.command_limit for drive in arm.robot.drives])
        command = np.clip(self.record.command, -limits, limits)[:, None, :]
        for effect in arm.effects:
            if type(effect).on_command is Effect.on_command:
                continue
            memory = effect.memory(arm.robot.sample_time)
            padded = np.concatenate([np.zeros((memory,) + command.shape[1:]), command])
            history = np.stack([padded[k:k + len(command)] for k in range(memory)], axis=-2) \
                if memory else np.zeros(command.shape[:-1] + (0, 2))
            command = effect.on_command(command, history, self.record.time[:, None],
                                        arm.robot.sample_time)
        return command

    def _matrices(self, arm: ExtendedArm, gain: Array) -> tuple[Array, Array, Array]:
        """Return F - K C (N, n, n), G u + E f + K y (N, B, n), and E (N, n, N)."""
        n, c, order = arm.states, arm.output_matrix, arm.form.order
        weights, table = self._payload_schedule(arm)
        copies = len(table) // NODES
        table = table.reshape(len(table), n, -1)
        k = np.tile(gain, (copies, 1, 1))
        closed = np.concatenate([table[..., :n] - k @ c, table[..., n:], k], axis=-1)
        every = (weights @ closed.reshape(len(closed), -1)).reshape(len(weights), n, -1)
        fixed = np.concatenate([self._padded(order), self.record.output], axis=1)
        inputs = _times(every[..., n + 2:], fixed)[:, None] + np.matmul(
            self._command(arm), np.swapaxes(every[..., n:n + 2], 1, 2))
        return every[..., :n], inputs, every[..., n + 2:n + 2 + order]

    def _payload_schedule(self, arm: ExtendedArm) -> tuple[Array, Array]:
        """Return weights over schedule nodes, times payload nodes while the payload changes."""
        mass = np.full(len(self.record.time), arm.payload)
        for effect in arm.effects:
            if type(effect).payload_at is not Effect.payload_at:
                mass = np.array([effect.payload_at(t, m)
                                 for t, m in zip(self.record.time, mass)])
        nodes = np.unique([mass.min(), mass.max()])
        if nodes.size == 1:
            return self.weights, arm.at_payload(float(nodes[0])).schedule.table
        if np.any((mass > nodes[0]) & (mass < nodes[1])):
            nodes = np.array([nodes[0], nodes.mean(), nodes[1]])
        tables = [arm.at_payload(float(m)).schedule.table for m in nodes]
        share = np.linalg.solve(np.vander(nodes, increasing=True).T,
                                np.vander(mass, nodes.size, increasing=True).T).T
        weights = (share[:, :, None] * self.weights[:, None, :]).reshape(len(mass), -1)
        return weights, np.concatenate(tables)

    def _padded(self, order: int) -> Array:
        extra = order - self.force.shape[1]
        return np.pad(self.force, ((0, 0), (0, extra)))[:, :order]

    def _filter(self, arm: ExtendedArm) -> Array:
        """Return the predicted states of the base over the whole record, (N, n)."""
        f, inputs, e = self._matrices(arm, self.gain)
        state = np.zeros((1, 1, arm.states))
        state[..., :2] = self.record.output[0, :2]
        states = np.empty((len(f), arm.states))
        command = self._command(arm)
        gain = self._gain_at(arm, self.gain) if _nonlinear(arm) else None
        for k in range(len(f)):
            states[k] = state[0, 0]
            at = slice(k, k + 1)
            state = self._step(arm, f[at], inputs[at], e[at], gain[at] if gain is not None
                               else None, state, command[at], at)
        return states

    def _gain_at(self, arm: ExtendedArm, gain: Array) -> Array:
        return (self.weights @ gain.reshape(NODES, -1)).reshape(
            len(self.weights), arm.states, -1)

    def _step(self, arm: ExtendedArm, f: Array, inputs: Array, e: Array, gain: Array | None,
              state: Array, command: Array, rows: Any) -> Array:
        """Return the states (W, B, n) one sample later, corrected by the innovation."""
        after = np.matmul(state, np.swapaxes(f, 1, 2)) + inputs
        if gain is None:
            return after
        time = self.record.time[rows][:, None]
        output = arm.output(state, time)
        linear = state @ arm.output_matrix.T
        after = after - np.matmul(output - linear, np.swapaxes(gain, 1, 2))
        return arm.apply_effects(e[:, None], state, after, command, time)

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
            (K, n, m); the base's by default, which needs the same states.

        """
        arm = self.base.arm(self.record.payload, effects, robot)
        gain = self.gain_of(arm) if gain is None else gain
        f, inputs, e = self._matrices(arm, gain)
        indices, command = self.windows.indices, self._command(arm)
        gains = self._gain_at(arm, gain) if _nonlinear(arm) else None
        batch, start = _batch(effects), self._start(arm)
        state = np.zeros((len(indices), batch, arm.states))
        state[..., :start.shape[1]] = start[indices[:, 0], None]
        outputs = np.empty((indices.shape[1], len(indices), batch, self.noise.size))
        for k, rows in enumerate(indices.T):
            outputs[k] = arm.output(state, self.record.time[rows][:, None])
            state = self._step(arm, f[rows], inputs[rows], e[rows],
                               gains[rows] if gains is not None else None, state,
                               command[rows], rows)
        measured = self.record.output[indices.T][:, :, None]
        scored = (measured - outputs)[self.windows.warm_up:]
        return np.ascontiguousarray(scored.transpose(2, 1, 0, 3))

    def gain_of(self, arm: ExtendedArm) -> Array:
        """Return the base's gain, or a new one where the arm has other states."""
        if arm.states == self.states.shape[1] and np.array_equal(
                arm.output_matrix, self.arm.output_matrix):
            return self.gain
        return steady_gain(arm, self._force_variance(arm), self.noise)

    def _start(self, arm: ExtendedArm) -> Array:
        """Return the base's states; where coordinates were added, positions stay in place."""
        extra = arm.form.order - self.arm.form.order
        if extra <= 0:
            return self.states[:, :min(self.states.shape[1], arm.states)]
        n = self.arm.form.order
        zeros = np.zeros((len(self.states), extra))
        return np.concatenate([self.states[:, :n], zeros, self.states[:, n:2 * n], zeros],
                              axis=1)


def _times(matrices: Array, vectors: Array) -> Array:
    return (matrices @ vectors[..., None])[..., 0]


def _nonlinear(arm: ExtendedArm) -> bool:
    """Tell whether any effect acts on forces or outputs, sample by sample."""
    return arm.acts_on_motion or arm.acts_on_output


def _batch(effects: Sequence[Effect]) -> int:
    """Return B, from effects whose values are arrays (B, 1)."""
    shapes = [np.shape(value) for effect in effects for value in effect.values]
    return max([shape[0] for shape in shapes if shape], default=1)
