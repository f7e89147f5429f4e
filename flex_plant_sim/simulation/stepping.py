"""Many steps of a scheduled arm in one loop, compiled where Numba is installed."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED, compiled
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.bending import bending_terms, BendingTerms
from flex_plant_sim.effects.mechanics.bending_step import momentum, slopes
from flex_plant_sim.effects.structure.coriolis_centripetal import CoriolisCentripetal
from flex_plant_sim.effects.structure.foreshortening import Foreshortening
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np


@dataclass(frozen=True)
class Stepper:
    """
    [F G E](angle) = sum_k series[k] cos(k angle), and the velocity's forces where an arm has them.

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
    bending : BendingTerms
        Of Foreshortening.
    share : float
        What share of it acts; 0 where the arm has none.
    step : float
        s.

    """

    series: Array
    angle: Array
    turning: Array
    bending: BendingTerms
    share: float
    step: float

    @classmethod
    def of(cls, arm: ExtendedArm) -> Stepper | None:
        """Return the stepper of an arm, None where something must be asked at every step."""
        forces = _forces(arm)
        if forces is None or arm.has_contact:
            return None
        count = arm.nodes.size
        turns = np.arccos(arm.nodes)[:, None] * np.arange(count)
        series: Array = np.linalg.inv(np.cos(turns)) @ arm.schedule.table
        stepper = cls(series, schedule_row(arm), *forces, arm.step_time)
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
        _run(self.series, self.angle, self.turning, self.bending, self.share, self.step, inputs,
             states)
        return states


def schedule_row(arm: ExtendedArm) -> Array:
    """
    Return the angle whose cosine the plant is scheduled on, over the state, (n,).

    theta_2, as (1)-(7) have it. With Coriolis forces it is the angle between the links, upper
    tip slope included: they do the work of that angle's inertia, so that energy needs it. With
    foreshortening it is that at the step's middle, so that the scheme is of second order.
    """
    row, n = np.zeros(arm.states), arm.form.order
    if not any(isinstance(effect, CoriolisCentripetal) and effect['share'] != 0.0
               for effect in arm.effects):
        row[1] = 1.0
        return row
    row[:n] = arm.form.elbow_angle
    if any(isinstance(effect, Foreshortening) for effect in arm.effects):
        row[n:2 * n] = 0.5 * arm.step_time * arm.form.elbow_angle
    return row


def _forces(arm: ExtendedArm) -> tuple[Array, BendingTerms, float] | None:
    """Return turning, bending and share of a Stepper; None for an arm with other forces."""
    forces = [e for e in arm.effects if type(e).force is not Effect.force]
    turning = [e for e in forces if isinstance(e, CoriolisCentripetal)]
    bending = [e for e in forces if isinstance(e, Foreshortening)]
    if not forces:
        return np.zeros((0, arm.form.order)), BendingTerms.none(arm.form), 0.0
    rows = turning[0].rows(arm.form, arm.payload) if len(turning) == 1 else None
    if rows is None or len(bending) > 1 or len(forces) > len(turning) + len(bending):
        return None
    return (np.vstack([rows, arm.form.elbow_angle]),
            bending_terms(arm.form, arm.robot, arm.payload),
            float(bending[0]['share']) if bending else 0.0)


@compiled
def _run(series: Array, angle: Array, turning: Array, bending: BendingTerms, share: float,
         step: float, inputs: Array, states: Array) -> None:
    n = states.shape[1]
    force = n + 2
    harmonics = np.arange(len(series)) * 1.0
    drive = np.zeros(n + inputs.shape[1])
    push = np.zeros_like(drive)
    for k in range(len(inputs)):
        state = states[k]
        drive[:n], drive[n:force] = state, inputs[k, :2]
        wave = np.cos(harmonics * np.dot(angle, state))
        matrices = np.dot(wave, series).reshape(n, drive.size)
        after = np.dot(matrices, drive)
        states[k + 1] = after
        before = momentum(bending, state) if share != 0.0 else state
        # From the middle of the step; once more where forces go with what they bring about.
        for _ in range(2 if share != 0.0 else 1):
            push[force:] = inputs[k, 2:]
            middle = 0.5 * (state + states[k + 1])
            if len(turning) > 0:
                push[force:] += _turning_force(turning, middle)
            if share != 0.0:
                gained = momentum(bending, states[k + 1]) - before
                push[force:] += share * (slopes(bending, middle) - gained / step)
            found = after + np.dot(matrices, push)
            if share != 0.0 and np.isfinite(found).all():
                found -= _held_back(bending, share / step, matrices[:, force:].copy(),
                                    states[k + 1], found)
            states[k + 1] = found


@compiled
def _held_back(bending: BendingTerms, share: float, push: Array, guess: Array, found: Array
               ) -> Array:
    """Return what ExtendedArm._implicit takes from `found`, (n,); share over the step, 1/s."""
    order = push.shape[1]
    mass, moving = np.zeros((order, order)), guess.copy()
    for i in range(order):
        moving[order:2 * order] = 0.0
        moving[order + i] = share
        mass[i] = momentum(bending, moving)
    through = np.dot(push[order:2 * order], mass)
    for i in range(order):
        through[i, i] += 1.0
    gained = np.linalg.solve(through, found[order:2 * order] - guess[order:2 * order])
    return np.dot(push, np.dot(mass, gained))


@compiled
def _turning_force(turning: Array, middle: Array) -> Array:
    order = turning.shape[1]
    elbow, across, root_1, root_2 = np.dot(turning[:4], middle[order:2 * order])
    return np.sin(np.dot(turning[4], middle[:order])) * (
        across * root_2 * turning[0] - elbow * root_1 * turning[1])
