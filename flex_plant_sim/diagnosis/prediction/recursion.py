"""
The state recursion of a scheduled predictor along windows, with dry friction and backlash.

`FilterRun` prepares its inputs. Loops are compiled where Numba is installed; each has a form
without Numba, here or in `filter_run`.
"""

from __future__ import annotations

from typing import NamedTuple

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from flex_plant_sim.diagnosis.prediction.scheduled_matrices import (
    add_product,
    blend_into,
    interpolate_into,
    ScheduledMatrices,
)
from flex_plant_sim.diagnosis.record.windows import Indices
import numpy as np


class JointFriction(NamedTuple):
    """
    Dry friction of both joints along a record.

    Attributes
    ----------
    response : Array
        Change of the state by unit joint torques during a step, (N, n, 2).
    velocity_response : Array
        Change of each joint's own velocity by its unit torque, (N, 2).
    limits : Array
        Largest torques against forward and backward motion, N m, (N, B, 2 ways, 2 joints).
    velocity : int
        Index of the first joint velocity in the state.
    compliance : Array
        Deflection of each joint's bristles by a unit torque before it slides, rad/(N m), (B, 2).
    deflections : Array
        Index of each joint's bristle deflection among the coordinates, -1 without one, (2,), int.
    step : float
        s.

    """

    response: Array
    velocity_response: Array
    limits: Array
    velocity: int
    compliance: Array
    deflections: Indices
    step: float

    @classmethod
    def none(cls, n: int, velocity: int) -> JointFriction:
        """Return joints without dry friction."""
        return cls(np.zeros((0, n, 2)), np.zeros((0, 2)), np.zeros((0, 0, 2, 2)), velocity,
                   np.zeros((0, 2)), np.full(2, -1), 1.0)

    def applied(self, state: Array, after: Array, row: Indices) -> Array:
        """Return the states after a step, (W, B, n), as `ExtendedArm.apply_friction` does."""
        v, limits = self.velocity, self.limits[row]
        deflection = np.where(self.deflections >= 0, state[..., self.deflections], 0.0)
        force = np.clip((deflection + self.step * after[..., v:v + 2])
                        / (self.compliance + self.step * self.velocity_response[row][:, None]),
                        -limits[..., 1, :], limits[..., 0, :])
        after = after - np.matmul(force, np.swapaxes(self.response[row], 1, 2))
        for j, k in enumerate(self.deflections):
            if k >= 0:
                after[..., k], after[..., v + k] = (self.compliance * force)[..., j], 0.0
        return after


class Backlashes(NamedTuple):
    """
    Backlashes along a record, G of them, in steps finer than its samples; see `Backlash`.

    Attributes
    ----------
    weights : Array
        Of each sample over the schedule's nodes, (N, K).
    engaged : Array
        [F, G, E]' of a fine step while the teeth touch, flat, (K, (n + 2 + order) n).
    separation : Array
        Change of [F, G]' while rotor and link are apart, flat, (G, K, (n + 2) n).
    impulse : Array
        Change of the state by a unit impulse on the joint at the start and at the end of a fine
        step, flat, (G, K, 2 n).
    rotor : Array
        Torque of a unit command, inertia, damping, step, mean and final value of a decaying unit
        speed, half the gap, (G, 7); see `Backlash.rotor`.
    indices : Array
        Joint, and index of the link's lead over the rotor among the coordinates, (G, 2), int.
    output : Array
        C', (n, m).
    velocity : int
        Index of the first joint velocity in the state.
    substeps : int
        Fine steps in a sample.

    """

    weights: Array
    engaged: Array
    separation: Array
    impulse: Array
    rotor: Array
    indices: Indices
    output: Array
    velocity: int
    substeps: int

    @classmethod
    def none(cls, output: Array) -> Backlashes:
        """Return those of an arm without any, with C, (m, n)."""
        return cls(np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0, 0)), np.zeros((0, 0, 0)),
                   np.zeros((0, 7)), np.zeros((0, 2), dtype=np.int64),
                   np.ascontiguousarray(output.T), 0, 0)


def propagate(matrices: ScheduledMatrices, drive: Array, start: Array, rows: Indices,
              friction: JointFriction | None, output: Array, corrected: int) -> Array:
    """
    Return the states x(k+1) = F_k x_k + D_k d_k along every window, (S, W, B, n).

    With friction, each joint gets the torque that would stop it within the step, or that its
    bristles have at the end of the step, within its limits. This time-stepping scheme does not
    chatter at any step.

    Parameters
    ----------
    matrices : ScheduledMatrices
        [F, D]' at samples, (N,).
    drive : Array
        d, (N, B, …); the measured outputs are its last columns.
    start : Array
        x_0, (W, n).
    rows : Indices
        Sample of each step, (S, W).
    friction : JointFriction or None
        None where no joint has dry friction.
    output : Array
        C, (m, n).
    corrected : int
        Steps after which what is predicted takes the place of what was measured.

    """
    if COMPILED:
        return propagate_with_gaps(matrices, drive, start, rows, friction,
                                   Backlashes.none(output), corrected)
    states = np.empty((*rows.shape, drive.shape[1], start.shape[1]))
    state = np.repeat(start[:, None], drive.shape[1], axis=1)
    for k, row in enumerate(rows):
        states[k] = state
        inputs = drive[row]
        if k >= corrected:
            inputs = np.concatenate([inputs[..., :-len(output)], state @ output.T], axis=-1)
        after = matrices.at(row).step_states(state, inputs)
        state = after if friction is None else friction.applied(state, after, row)
    return states


def propagate_with_gaps(matrices: ScheduledMatrices, drive: Array, start: Array, rows: Indices,
                        friction: JointFriction | None, gaps: Backlashes,
                        corrected: int | None = None) -> Array:
    """Return the states as `propagate` does, (S, W, B, n), with backlash, in compiled loops."""
    f = friction or JointFriction.none(start.shape[1], gaps.velocity)
    # One memory layout alone: for any other, Numba would compile once more, some seconds each.
    return _propagate_compiled(
        matrices.nodes, matrices.weights, matrices.flat, np.ascontiguousarray(drive), start, rows,
        f._replace(limits=np.ascontiguousarray(f.limits), compliance=f.compliance.copy()), gaps,
        len(rows) if corrected is None else corrected)


@compiled
def _propagate_compiled(nodes: Indices, weights: Array, table: Array, drive: Array, start: Array,
                        rows: Indices, friction: JointFriction, gaps: Backlashes, corrected: int
                        ) -> Array:
    steps, windows = rows.shape
    batch, n, count = drive.shape[1], start.shape[1], len(gaps.indices)
    known, inputs = drive.shape[2] - gaps.output.shape[1], np.empty(drive.shape[2])
    states, flat = np.empty((steps, windows, batch, n)), np.empty(table.shape[1])
    both, touching = flat.reshape(-1, n), np.empty(gaps.engaged.shape[1])
    apart = np.empty((count, gaps.separation.shape[2]))
    impulses = np.empty((count, gaps.impulse.shape[2]))
    for w in range(windows):
        for b in range(batch):
            states[0, w, b] = start[w]
        for k in range(steps - 1):
            row = rows[k, w]
            blend_into(nodes[row], weights[row], table, flat)
            if count:
                interpolate_into(gaps.weights[row], gaps.engaged, touching)
            for g in range(count):
                interpolate_into(gaps.weights[row], gaps.separation[g], apart[g])
                interpolate_into(gaps.weights[row], gaps.impulse[g], impulses[g])
            for b in range(batch):
                state, after = states[k, w, b], states[k + 1, w, b]
                inputs[:] = drive[row, b]
                if k >= corrected:
                    inputs[known:] = 0.0
                    add_product(state, gaps.output, inputs[known:])
                if count:
                    _gap_step(state, after, inputs, both[len(both) - gaps.output.shape[1]:],
                              touching.reshape(-1, n), apart, impulses, gaps.rotor,
                              gaps.indices, gaps.output, gaps.velocity, gaps.substeps)
                else:
                    after[:] = 0.0
                    add_product(state, both[:n], after)
                    add_product(inputs, both[n:], after)
                if len(friction.velocity_response):
                    _apply_friction(state, after, friction, row, b)
    return states


@compiled
def _apply_friction(state: Array, after: Array, friction: JointFriction, row: int, b: int
                    ) -> None:
    """Apply dry friction to the state after a step, in place, as `JointFriction.applied`."""
    force, response, limits = np.zeros(2), friction.response[row], friction.limits[row, b]
    compliance, deflections = friction.compliance[b], friction.deflections
    velocity, step = friction.velocity, friction.step
    for j in range(2):
        deflection = state[deflections[j]] if deflections[j] >= 0 else 0.0
        sticking = ((deflection + step * after[velocity + j])
                    / (compliance[j] + step * friction.velocity_response[row, j]))
        force[j] = max(-limits[1, j], min(sticking, limits[0, j]))
    for i in range(len(after)):
        after[i] -= response[i, 0] * force[0] + response[i, 1] * force[1]
    for j in range(2):
        if deflections[j] >= 0:
            after[deflections[j]] = compliance[j] * force[j]
            after[velocity + deflections[j]] = 0.0


@compiled
def _gap_step(state: Array, after: Array, inputs: Array, gain: Array, engaged: Array,
              apart: Array, impulses: Array, rotor: Array, indices: Indices, output: Array,
              velocity: int, substeps: int) -> None:
    """
    Take the fine steps of a sample, then correct by the output errors at its start.

    `gain` is K' (m, n); `engaged`, `apart` and `impulses` are the tables `engaged`, `separation`
    and `impulse` of the backlashes at the sample.
    """
    n, push, error = len(state), np.zeros(len(state)), np.zeros(output.shape[1])
    before, free = np.empty(n), np.empty(n)
    add_product(state, output, error)
    for i in range(len(error)):
        error[i] = inputs[len(inputs) - len(error) + i] - error[i]
    add_product(inputs[:len(engaged) - n], engaged[n:], push)
    after[:] = state
    for _ in range(substeps):
        before[:], after[:] = after, push
        add_product(before, engaged[:n], after)
        for g in range(len(indices)):
            _open_or_close(before, after, free, inputs, apart[g].reshape(-1, n),
                           impulses[g].reshape(2, n), rotor[g], indices[g, 0], indices[g, 1],
                           velocity)
    _measurement_update(after, error, gain, output, rotor, indices, velocity)


@compiled
def _open_or_close(state: Array, after: Array, free: Array, inputs: Array, separation: Array,
                   impulse: Array, rotor: Array, joint: int, lead: int, velocity: int) -> None:
    """Part rotor and link, or join them, as `Backlash.on_step` does."""
    torque, inertia, damping, step, mean, end, half = rotor
    slip, old = state[velocity + lead], state[lead]
    speed, steady = state[velocity + joint] - slip, torque * inputs[joint] / damping
    rotor_turn = step * (steady + (speed - steady) * mean)
    free[:] = after
    add_product(state, separation[:len(state)], free)
    add_product(inputs[:2], separation[len(state):], free)
    apart = old + free[joint] - state[joint] - rotor_turn
    free_slip = free[velocity + joint] - steady - (speed - steady) * end
    if abs(apart) < half:
        after[:] = free
        after[lead], after[velocity + lead] = apart, free_slip
        return
    # The teeth meet where the parabola room = drift s + bend s^2 says, a share s of the step.
    side, met = 1.0 if apart > 0.0 else -1.0, 0.0
    room, drift = half - side * old, side * step * slip
    bend = side * (apart - old - step * slip)
    if room > 0.0:
        root = drift + np.sqrt(max(drift**2 + 4.0 * bend * room, 0.0))
        met = 2.0 * room / max(root, 2.0 * room)
    momentum = inertia * (slip + met * (free_slip - slip))
    for i in range(len(after)):
        share = met * (2.0 - met) if i < velocity else met
        push = impulse[0, i] + met * (impulse[1, i] - impulse[0, i])
        after[i] += share * (free[i] - after[i]) - push * momentum
    after[lead], after[velocity + lead] = side * half, 0.0


@compiled
def _measurement_update(after: Array, error: Array, gain: Array, output: Array, rotor: Array,
                        indices: Indices, velocity: int) -> None:
    """
    Correct a state by output errors, (m,), with the gain K' (m, n), in place.

    A joint sensor before an open gap corrects the rotor, all others what is behind the gap.
    """
    add_product(error, gain, after)
    for g in range(len(indices)):
        joint, lead, half = indices[g, 0], indices[g, 1], rotor[g, 6]
        if abs(after[lead]) >= half:
            continue
        if output[lead, joint] != 0.0:
            for i in range(2 * velocity):
                after[i] -= gain[joint, i] * error[joint]
        for d in (0, velocity):
            for i in range(len(error)):
                turn = gain[i, joint + d] * error[i]
                after[lead + d] += turn if output[lead, i] == 0.0 else -turn
        after[lead] = max(-half, min(after[lead], half))
