"""
Many steps of a scheduled arm in one loop, compiled if Numba is installed.

The simulator uses it if the arm has no effect that must be evaluated in Python at every step.
"""

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
    [F G E](angle) = sum_k series[k] cos(k angle), and the velocity-dependent forces if any.

    The interpolant is that of `Schedule`, written as a cosine series: it takes one product per
    step, and there are no nodes at which a weight would divide by zero.

    Attributes
    ----------
    series : Array
        (K, n (n + 2 + N)).
    angle : Array
        The row that gives the angle from the state, (n,).
    turning : Array
        The four rows of CoriolisCentripetal.rows over p', then the row of the angle between the
        links over p, (5, N); (0, N) if the arm has no Coriolis forces.
    bending : BendingTerms
        Terms of Foreshortening.
    share : float
        Share of foreshortening that acts; 0 if the arm has none.
    step : float
        Length of a step, s.

    """

    series: Array
    angle: Array
    turning: Array
    bending: BendingTerms
    share: float
    step: float

    @classmethod
    def of(cls, arm: ExtendedArm) -> Stepper | None:
        """Return the stepper of an arm; None if an effect must be evaluated at every step."""
        forces = _forces(arm)
        if forces is None or arm.has_contact:
            return None
        count = arm.nodes.size
        turns = np.arccos(arm.nodes)[:, None] * np.arange(count)
        series: Array = np.linalg.inv(np.cos(turns)) @ arm.schedule.table
        stepper = cls(series, schedule_row(arm), *forces, arm.step_time)
        if COMPILED:
            # A run of no steps compiles the loop.
            stepper.run(np.zeros(arm.states), np.zeros((0, 2)), np.zeros((0, arm.form.order)))
        return stepper

    def run(self, start: Array, commands: Array, forces: Array) -> Array:
        """
        Return the states before each step and after the last, (S + 1, n).

        Parameters
        ----------
        start : Array
            State, (n,).
        commands, forces : Array
            Commands and generalised forces, constant over each step, (S, 2) and (S, N).

        """
        inputs = np.concatenate([commands, forces], axis=1)
        states = np.empty((len(inputs) + 1, start.size))
        states[0] = start
        _run_steps(self.series, self.angle, self.turning, self.bending, self.share, self.step,
                   inputs, states)
        return states


def schedule_row(arm: ExtendedArm) -> Array:
    """
    Return the row over the state, (n,), of the angle whose cosine schedules the plant.

    The angle is theta_2, as in (1)-(7). With Coriolis forces it is the angle between the links,
    which includes the upper link's tip slope: these forces do the work due to the inertia that
    depends on this angle, so energy is conserved only with it. With foreshortening in addition it
    is the angle at the middle of the step, so that the scheme is of second order.
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
    """Return `turning`, `bending` and `share` of a Stepper; None if the arm has other forces."""
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
def _run_steps(series: Array, angle: Array, turning: Array, bending: BendingTerms, share: float,
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
        # Forces at the middle of the step; evaluated twice if they depend on acceleration.
        for _ in range(2 if share != 0.0 else 1):
            push[force:] = inputs[k, 2:]
            middle = 0.5 * (state + states[k + 1])
            if len(turning) > 0:
                push[force:] += _coriolis_force(turning, middle)
            if share != 0.0:
                gained = momentum(bending, states[k + 1]) - before
                push[force:] += share * (slopes(bending, middle) - gained / step)
            found = after + np.dot(matrices, push)
            if share != 0.0 and np.isfinite(found).all():
                found -= _newton_correction(bending, share / step, matrices[:, force:].copy(),
                                            states[k + 1], found)
            states[k + 1] = found


@compiled
def _newton_correction(bending: BendingTerms, share: float, push: Array, guess: Array,
                       found: Array) -> Array:
    """
    Return what ExtendedArm._newton_step subtracts from `found`, (n,).

    Here `share` is the share of foreshortening divided by the step, 1/s.
    """
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
def _coriolis_force(turning: Array, middle: Array) -> Array:
    order = turning.shape[1]
    elbow, across, root_1, root_2 = np.dot(turning[:4], middle[order:2 * order])
    return np.sin(np.dot(turning[4], middle[:order])) * (
        across * root_2 * turning[0] - elbow * root_1 * turning[1])
