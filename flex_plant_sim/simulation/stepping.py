"""Many steps of a scheduled arm in one loop, compiled where Numba is installed."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.structure.coriolis_centripetal import CoriolisCentripetal
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np


@dataclass(frozen=True)
class Stepper:
    """
    [F G E](angle) = sum_k series[k] cos(k angle), and the Coriolis forces where an arm has them.

    The interpolant is that of `Schedule`, written as a cosine series: one product a step, and
    no node at which a weight divides by zero.

    Attributes
    ----------
    series : Array
        (K, n (n + 2 + N)).
    angle : Array
        The angle over the state, (n,).
    turning : Array
        The four rows of CoriolisCentripetal.rows over p' and the angle between the links over
        p, (5, N), or (0, N) without.

    """

    series: Array
    angle: Array
    turning: Array

    @classmethod
    def of(cls, arm: ExtendedArm) -> Stepper | None:
        """Return the stepper of an arm, None where something must be asked at every step."""
        turning = _turning(arm)
        if turning is None or arm.has_contact:
            return None
        count = arm.nodes.size
        turns = np.arccos(arm.nodes)[:, None] * np.arange(count)
        series: Array = np.linalg.inv(np.cos(turns)) @ arm.schedule.table
        stepper = cls(series, schedule_row(arm), turning)
        if COMPILED:
            # No steps, but they are compiled for.
            stepper.run(np.zeros(arm.states), np.zeros((0, 2)), np.zeros((0, arm.form.order)))
        return stepper

    def run(self, start: Array, commands: Array, forces: Array) -> Array:
        """
        Return the states before each step and after the last, (S + 1, n).

        Parameters
        ----------
        start : Array
            (n,).
        commands, forces : Array
            Held over each step, (S, 2) and (S, N).

        """
        inputs = np.concatenate([commands, forces], axis=1)
        states = np.empty((len(inputs) + 1, start.size))
        states[0] = start
        _run(self.series, self.angle, self.turning, inputs, states)
        return states


def schedule_row(arm: ExtendedArm) -> Array:
    """
    Return the angle whose cosine the plant is scheduled on, over the state, (n,).

    theta_2, as (1)-(7) have it. With Coriolis forces it is the angle between the links, upper
    tip slope included: they do the work of that angle's inertia, so that energy needs it.
    """
    row = np.zeros(arm.states)
    if any(isinstance(effect, CoriolisCentripetal) and effect['share'] != 0.0
           for effect in arm.effects):
        row[:arm.form.order] = arm.form.elbow_angle
    else:
        row[1] = 1.0
    return row


def _turning(arm: ExtendedArm) -> Array | None:
    forces = [e for e in arm.effects if type(e).force is not Effect.force]
    if not forces:
        return np.zeros((0, arm.form.order))
    rows = [effect.rows(arm.form, arm.payload) for effect in forces
            if isinstance(effect, CoriolisCentripetal)]
    if len(forces) > 1 or not rows or rows[0] is None:
        return None
    return np.vstack([rows[0], arm.form.elbow_angle])


@compiled
def _run(series: Array, angle: Array, turning: Array, inputs: Array, states: Array) -> None:
    n = states.shape[1]
    order, force = turning.shape[1], n + 2
    harmonics = np.arange(len(series)) * 1.0
    drive = np.zeros(n + inputs.shape[1])
    push = np.zeros_like(drive)
    for k in range(len(inputs)):
        state = states[k]
        drive[:n], drive[n:force] = state, inputs[k, :2]
        push[force:] = inputs[k, 2:]
        wave = np.cos(harmonics * np.dot(angle, state))
        matrices = np.dot(wave, series).reshape(n, drive.size)
        after = np.dot(matrices, drive)
        if len(turning) > 0:
            # From the middle of the step, so that the scheme is of second order.
            middle = 0.5 * (state + after)
            rate = middle[order:2 * order]
            elbow, across, root_1, root_2 = np.dot(turning[:4], rate)
            push[force:] += np.sin(np.dot(turning[4], middle[:order])) * (
                across * root_2 * turning[0] - elbow * root_1 * turning[1])
        states[k + 1] = after + np.dot(matrices, push)
