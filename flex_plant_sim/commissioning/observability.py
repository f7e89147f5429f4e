"""How well a log of the standard move can determine the payload: the Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
import math

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.commissioning.standard_move import (
    check_moved,
    Move,
    standard_move,
    STROKE,
    STROKES,
)
from flex_plant_sim.diagnosis.likelihood.prior import part_priors, PartPrior, with_deviations
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import nominal_effects
from flex_plant_sim.simulation.simulator import simulate, Simulator
from flex_plant_sim.tiny import TINY
import numpy as np

# Step of the finite differences, in tolerances or as a share of the payload: far above rounding,
# and far below the size at which the sensitivity changes.
STEP = 1e-2
# Largest number of samples of a move. Beyond it, k samples are averaged into one, whose white
# noise is smaller by the root of k. On the reference arm 10 000 and 50 000 agree to 1e-4.
MAX_SAMPLES = 10_000

# A robot that deviates, and the effects that its sensors then have.
Changed = tuple[Robot, tuple[Effect, ...]]
Change = Callable[[float], Changed]


@dataclass(frozen=True)
class Observability:
    """
    The least possible standard deviation of the payload, kg, after the standard move.

    Attributes
    ----------
    move : Move
    exact : float
        Bound if every part is exactly as in the robot file.
    within_tolerances : float
        Bound if all parts are unknown within their tolerances.

    """

    move: Move
    exact: float
    within_tolerances: float


def observability(robot: Robot, modes: int) -> Observability:
    """Return the bound for the robot's own payload (1 g if it has none)."""
    # Away from zero, so that central differences are possible.
    robot = replace(robot, payload_mass=max(robot.payload_mass, 1e-3), payload_inertia=max(
        robot.payload_inertia, STEP * robot.tolerances.payload_inertia_kg_m2))
    quick = standard_move(_averaged(robot, STROKES * STROKE))
    robot = _averaged(robot, quick.strokes * quick.stroke)
    move, known = standard_move(robot), replace(robot.tolerances, payload=0.0)
    parts = part_priors(replace(robot, tolerances=known), robot.payload_mass)
    noise = np.array([robot.angle_noise] * 2 + [robot.strain_noise] * len(robot.gauge_names))

    def slope(change: Change, step: float) -> Array:
        outputs = [_output(*change(way * step), modes, move) for way in (1.0, -1.0)]
        for output in outputs:
            # Of the payload that was told, not of the one a step beside it.
            check_moved(output, robot, modes)
        return ((outputs[0] - outputs[1]) / (2.0 * step) / noise).ravel()

    payload = slope(partial(_with_payload, robot), STEP * robot.payload_mass)
    # The information is well scaled in units of the tolerances.
    others = np.empty((payload.size, len(parts)))
    for k, part in enumerate(parts):
        others[:, k] = part.tolerance * slope(partial(_with_part, robot, part),
                                              STEP * part.tolerance)
    return Observability(move, float(1.0 / np.linalg.norm(payload)), _bound(payload, others))


def _averaged(robot: Robot, duration: float) -> Robot:
    """Return the robot with samples averaged to at most MAX_SAMPLES over a duration, s."""
    count = max(1, math.ceil(duration / robot.sample_time / MAX_SAMPLES))
    return replace(robot, sample_time=count * robot.sample_time,
                   angle_noise=robot.angle_noise / math.sqrt(count),
                   strain_noise=robot.strain_noise / math.sqrt(count))


def _with_payload(robot: Robot, step: float) -> Changed:
    return replace(robot, payload_mass=robot.payload_mass + step), ()


def _with_part(robot: Robot, part: PartPrior, step: float) -> Changed:
    return with_deviations(robot, [part], np.array([step]))


def _output(robot: Robot, sensors: tuple[Effect, ...], modes: int, move: Move) -> Array:
    arm = ExtendedArm(robot, 'assumed_modes', modes, robot.payload_mass,
                      (*nominal_effects(robot), *sensors))
    with np.errstate(all='ignore'):
        simulator = Simulator(arm)
        simulator.begin_at(move.centre)
        output = simulate(simulator, move.commands)[0]
    return output


def _bound(payload: Array, others: Array) -> float:
    """Return the payload's bound if the other quantities have Gaussian priors of size one."""
    basis, sizes, _ = np.linalg.svd(others, full_matrices=False)
    along = basis.T @ payload
    left = payload @ payload - np.sum(along**2 * sizes**2 / (1.0 + sizes**2))
    return float(1.0 / np.sqrt(max(left, TINY)))
