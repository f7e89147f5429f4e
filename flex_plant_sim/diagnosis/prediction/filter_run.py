"""
One arm's predictor run through a record: its matrices and its inputs at every sample.

`Predictor` and the latent forces drive hypotheses through records with it; the recursion itself
is in `recursion`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import Any, NamedTuple, Protocol

from flex_plant_sim.arm.schedule import barycentric_weights, Schedule
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.diagnosis.prediction.recursion import (
    Backlashes,
    JointFriction,
    propagate,
    propagate_with_gaps,
)
from flex_plant_sim.diagnosis.prediction.scheduled_matrices import ScheduledMatrices
from flex_plant_sim.diagnosis.record.windows import Indices, Record
from flex_plant_sim.effects.base import Effect, Motion
from flex_plant_sim.effects.joint.backlash import Backlash
from flex_plant_sim.simulation.drive_input import DriveInput
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# A payload m adds m b b' to the mass matrix, whose inverse is then linear in m / (m + m_e) with
# m_e = 1 / (b' M^-1 b), the bare tip's own mass (Sherman and Morrison 1950): the n-th part of a
# quarter of a clamped link's mass for n modes. One mode's is 0.25, two modes' 0.125.
TIP_SHARE = 0.2

# Steps in a sample where a gap opens and closes. The joint errors of an arm that is stepped a
# hundred times as finely are then 0.85 and 0.86 of those stated (gap of 12 mrad at 100 Hz; sensor
# behind the gear, on the motor). With one step they are 1.20 and 1.31, with ten as with five.
GAP_SUBSTEPS = 5


class FilteredTrajectory(Protocol):
    """The filtered motion of a base model, along which the forces on an arm are evaluated."""

    record: Record

    def weights_of(self, arm: ExtendedArm) -> Array:
        """Return weights over the schedule nodes at the elbow angles an arm has, (N, K)."""

    def trajectory_states(self, arm: ExtendedArm, rows: Indices) -> Array:
        """Return an arm's states at samples (N,), (N, n); other coordinates are zero."""

    def measured_by(self, arm: ExtendedArm) -> Array:
        """Return the record's outputs before an arm's sensor effects, (N, 1 or B, m)."""


class Push(NamedTuple):
    """The smooth force of an effect at samples, (N, B, order), and what `pushed_by` says."""

    force: Any
    reasons: Sequence[Any] | None


def predictor_matrices(trajectory: FilteredTrajectory, arm: ExtendedArm, gain: Array,
                       used_samples: Indices) -> ScheduledMatrices:
    """Return the predictor of an arm with a gain (nodes, n, m), at the samples used, (N,)."""
    n = arm.states
    share, tables = payload_tables(arm, trajectory.record.time[used_samples])
    tables = tables.reshape(*tables.shape[:2], n, -1)
    k = np.broadcast_to(gain, (len(tables), *gain.shape))
    rows = np.concatenate([tables[..., :n] - k @ arm.output_matrix, tables[..., n:], k], axis=-1)
    cosine = trajectory.weights_of(arm)[used_samples] @ arm.nodes
    return ScheduledMatrices.along(cosine, share, arm.nodes, np.swapaxes(rows, 2, 3))


class FilterRun:
    """
    One arm's predictor run through some samples of a record.

    Effects push as they did in another run, `like`, where that is of the same motion.

    Attributes
    ----------
    drive : Array
        Command at the drive, smooth force and measured output at each sample, (N, B, d).
    trajectory : Array
        States along which the forces are evaluated, (N, 1, n).
    measured : Array
        Outputs before the sensors' effects, (N, 1 or B, m).
    pushes : dict
        Smooth force of each effect, by its identity.

    """

    def __init__(self, trajectory: FilteredTrajectory, arm: ExtendedArm,
                 matrices: ScheduledMatrices, used_samples: Indices, batch: int,
                 like: FilterRun | None = None):
        record = trajectory.record
        self.arm, self.matrices, self.time = arm, matrices, record.time[used_samples][:, None]
        self.command = drive_command(arm, record)[used_samples]
        self.measured = trajectory.measured_by(arm)[used_samples]
        m, order = record.output.shape[1], arm.form.order
        states = trajectory.trajectory_states(arm, used_samples)
        ahead = _one_later(trajectory, arm, used_samples, states)[:, None]
        self.trajectory = states[:, None]
        motion = arm.motion_between(self.trajectory, ahead, self.command, self.time)
        load = payload_masses(arm, self.time)
        self.pushes = {id(effect): _push(effect, motion, load, like) for effect in arm.pushing}
        force = np.zeros(order) + sum(push.force for push in self.pushes.values())
        parts = (self.command, force, self.measured)
        self.drive = np.concatenate([np.broadcast_to(part, (len(used_samples), batch, width))
                                     for part, width in zip(parts, (2, order, m))], axis=-1)

    def states(self, rows: Indices, start: Array, corrected: int | None = None) -> Array:
        """
        Return the predicted states along windows of samples `rows`, (S, W): (S, W, B, n).

        Only so many first steps are corrected by measurements; all by default.
        """
        friction = self._friction() if self.arm.has_friction else None
        if not self.arm.gaps:
            return propagate(self.matrices, self.drive, start, rows, friction,
                             self.arm.output_matrix, len(rows) if corrected is None else corrected)
        if COMPILED:
            return propagate_with_gaps(self.matrices, self.drive, start, rows, friction,
                                       self._backlashes())
        states = np.empty((*rows.shape, self.drive.shape[1], start.shape[1]))
        state = np.repeat(start[:, None], self.drive.shape[1], axis=1)
        for k, row in enumerate(rows):
            states[k] = state
            state = self._gap_step(state, row)
        return states

    def _gap_step(self, state: Array, row: Indices) -> Array:
        """Return the states of samples, (W, B, n), one sample later."""
        share, arms = self.fine_arms
        share, fine, cosine = share[row], arms[0], np.cos(self.elbow[row])
        f, g, e = over_payloads(share, [arm.schedule for arm in arms], cosine)
        openings = [[part[:, None] for part in over_payloads(share, opening, cosine)]
                    for opening in zip(*(arm.openings for arm in arms))]
        push = np.matmul(self.drive[row][..., :2 + self.arm.form.order],
                         np.swapaxes(np.concatenate([g, e], axis=-1), 1, 2))
        after = state
        for _ in range(GAP_SUBSTEPS):
            motion = fine.motion(after, self.command[row], self.time[row])
            after = fine.apply_gaps(after, np.matmul(after, np.swapaxes(f, 1, 2)) + push, motion,
                                    openings)
        after = self._measurement_update(after, state, row)
        response = self.matrices.at(row).interpolated(self._force_response)[:, None]
        return self.arm.apply_friction(
            response, state, after, self.arm.motion(state, self.command[row], self.time[row]))

    def _measurement_update(self, after: Array, state: Array, row: Indices) -> Array:
        """
        Return the states after a step, corrected by the output errors at its start.

        A joint sensor before an open gap corrects the rotor, all others what is behind the gap.
        """
        order, c = self.arm.form.order, self.arm.output_matrix
        gain = self.matrices.at(row).interpolated(self.matrices.table[:, -len(c):])
        moved = gain[:, None] * (self.drive[row][..., -len(c):] - state @ c.T)[..., None]
        after = after + moved.sum(axis=-2)
        for effect in self.arm.gaps:
            assert isinstance(effect, Backlash)
            j, lead, half = (effect.index, self.arm.form.names.index(effect.coordinate),
                             0.5 * effect['gap_rad'])
            apart = np.abs(after[..., lead:lead + 1]) < half
            if c[j, lead] != 0.0:
                after[..., :2 * order] -= apart * moved[..., j, :2 * order]
            side = np.where(c[:, lead] == 0.0, 1.0, -1.0)
            turn = apart * (side[:, None] * moved[..., [j, order + j]]).sum(axis=-2)
            after[..., [lead, order + lead]] += turn
            after[..., lead] = np.clip(after[..., lead], -half, half)
        return after

    @cached_property
    def fine_arms(self) -> tuple[Array, list[ExtendedArm]]:
        """
        Return the arm in the steps within which gaps open and close, at payload nodes (P,).

        Also return the samples' weights over these, (N, P).
        """
        share, arms = payload_arms(self.arm, self.time[:, 0])
        return share, [arm.finer(GAP_SUBSTEPS) for arm in arms]

    @property
    def elbow(self) -> Array:
        """Return the elbow angle along the trajectory, rad, (N,)."""
        order = self.arm.form.order
        return np.asarray(self.trajectory[:, 0, :order] @ self.arm.form.elbow_angle)

    @property
    def force_response(self) -> Array:
        """Return the change of the state by unit forces during a step, (N, n, order)."""
        return self.matrices.interpolated(self._force_response)

    @property
    def _force_response(self) -> Array:
        n, order = self.matrices.table.shape[2], self.arm.form.order
        return np.swapaxes(self.matrices.table[:, n + 2:n + 2 + order], 1, 2)

    def _backlashes(self) -> Backlashes:
        """Return the backlashes, with the matrices at the trajectory's elbow angles."""
        share, arms = self.fine_arms
        fine, order = arms[0], self.arm.form.order
        weights = over_both(share, barycentric_weights(np.cos(self.elbow), fine.nodes))
        n, count = fine.states, weights.shape[1]
        separation, impulse, rotor, indices = [], [], [], []
        for effect, openings in zip(fine.gaps, zip(*(arm.openings for arm in arms))):
            assert isinstance(effect, Backlash)
            j, columns = effect.index, _transposed(openings)
            separation.append(columns[:, :n + 2].reshape(count, -1))
            impulse.append(columns[:, [n + 2 + j, n + 4 + j]].reshape(count, -1))
            rotor.append((fine.robot.drives[j].torque_gain,
                          *effect.rotor(fine.robot, fine.step_time), 0.5 * effect['gap_rad']))
            indices.append((j, fine.form.names.index(effect.coordinate)))
        engaged = _transposed(arm.schedule for arm in arms)
        return Backlashes(
            weights, engaged.reshape(count, -1), np.stack(separation), np.stack(impulse),
            np.array(rotor), np.array(indices), np.ascontiguousarray(fine.output_matrix.T),
            order, GAP_SUBSTEPS)

    def _friction(self) -> JointFriction:
        # Its limits, like smooth forces, are evaluated along the trajectory.
        motion = self.arm.motion(self.trajectory, self.command, self.time)
        shape = self.drive.shape[:2] + (2,)
        limits = np.stack([np.broadcast_to(limit, shape)
                           for limit in self.arm.friction_limits(motion)], axis=2)
        response, velocity_response = (
            self.matrices.interpolated(table)
            for table in self.arm.friction_columns(self._force_response))
        compliance = np.ascontiguousarray(np.broadcast_to(self.arm.yielding(), shape[1:]))
        return JointFriction(response, velocity_response, limits, self.arm.form.order, compliance,
                             np.array(self.arm.bends), self.arm.step_time)


def _push(effect: Effect, motion: Motion, load: Array, like: FilterRun | None) -> Push:
    """Return an effect's force with payloads (N, 1), that in another run with the same reasons."""
    ends = [replace(motion, payload=float(mass)) for mass in np.unique([load.min(), load.max()])]
    pushed = [effect.pushed_by(end) for end in ends]
    reasons = None if None in pushed else [load, *chain.from_iterable(filter(None, pushed))]
    other = None if like is None else like.pushes.get(id(effect))
    if reasons is not None and other is not None and other.reasons is not None:
        if all(map(np.array_equal, reasons, other.reasons)):
            return other
    force, *heavy = (effect.force(end) for end in ends)
    if heavy:
        # The arm's kinetic energy is linear in the payload.
        share = (load - ends[0].payload) / (ends[1].payload - ends[0].payload)
        force = force + share[..., None] * (heavy[0] - force)
    return Push(force, reasons)


def _one_later(trajectory: FilteredTrajectory, arm: ExtendedArm, rows: Indices, states: Array
               ) -> Array:
    """Return the trajectory one sample after increasing rows, (N, n), with its states there."""
    later = np.empty_like(states)
    later[:-1] = states[1:]
    ends = np.append(np.flatnonzero(np.diff(rows) != 1), len(rows) - 1)
    after = np.minimum(rows[ends] + 1, len(trajectory.record.time) - 1)
    later[ends] = trajectory.trajectory_states(arm, after)
    return later


def drive_command(arm: ExtendedArm, record: Record) -> Array:
    """Return the command at the drive, (N, 1 or B, 2)."""
    return DriveInput(arm).of_record(record.command, record.time)


def payload_schedule(arm: ExtendedArm, time: Array, weights: Array) -> tuple[Array, Array]:
    """Return weights over the schedule's nodes (times payload nodes if it changes), and table."""
    share, tables = payload_tables(arm, time)
    return over_both(share, weights), np.concatenate(tables)


def payload_tables(arm: ExtendedArm, time: Array) -> tuple[Array, Array]:
    """Return weights over payload nodes, (N, P), and the schedule's tables there, (P, K, …)."""
    share, arms = payload_arms(arm, time)
    return share, np.array([loaded.schedule.table for loaded in arms])


def payload_masses(arm: ExtendedArm, time: Array) -> Array:
    """Return the payload at times, kg, (…,)."""
    mass = np.full(time.shape, arm.payload)
    for effect in arm.effects:
        mass = np.asarray(effect.payload_at(time, mass), dtype=float)
    return mass


def payload_arms(arm: ExtendedArm, time: Array) -> tuple[Array, list[ExtendedArm]]:
    """Return weights over payload nodes, (N, P), and the arm there."""
    mass = payload_masses(arm, time)
    soft = TIP_SHARE * arm.robot.links[1].mass
    nodes = np.unique([mass.min(), mass.max()])
    places = nodes / (nodes + soft)
    if np.any((mass > nodes[0]) & (mass < nodes[-1])):
        places = np.insert(places, 1, places.mean())
        nodes = np.insert(nodes, 1, soft * places[1] / (1.0 - places[1]))
    basis = np.vander(places, increasing=True)
    share = np.vander(mass / (mass + soft), places.size, increasing=True) @ np.linalg.inv(basis)
    # The arm itself keeps its schedule, which its steady filter needs as well.
    return share, [arm if m == arm.payload else arm.at_payload(float(m)) for m in nodes]


def over_both(share: Array, weights: Array) -> Array:
    """Return weights over payload nodes times schedule nodes, from those over each, (N, P K)."""
    return np.asarray((share[:, :, None] * weights[:, None, :]).reshape(len(share), -1))


def over_payloads(share: Array, schedules: Iterable[Schedule], cosine: Array) -> list[Array]:
    """Return the matrices of schedules at payload nodes, weighted by (N, P), at angles (N,)."""
    parts = zip(*(schedule.at(cosine) for schedule in schedules))
    return [np.einsum('ap,pa...->a...', share, np.stack(part)) for part in parts]


def _transposed(schedules: Iterable[Schedule]) -> Array:
    """Return the tables of schedules at all their nodes, transposed, (P K, n + d, n)."""
    return np.concatenate([
        np.swapaxes(schedule.table.reshape(len(schedule.table), schedule.states, -1), 1, 2)
        for schedule in schedules])
