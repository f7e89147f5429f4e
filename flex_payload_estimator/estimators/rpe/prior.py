"""What is believed of payload, Coriolis forces, gauges and parts before any sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
import math

from flex_payload_estimator.estimators.rpe.schedule import Mixture, PayloadSchedule
from flex_payload_estimator.estimators.rpe.time_update import CORIOLIS, FIRST_BIAS, MASS
from flex_plant_sim.arm.parts import gauge_parts, Part, robot_parts
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.structure.coriolis_centripetal import CoriolisCentripetal
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np
from scipy.special import log_ndtr

# The share of the Coriolis forces: the paper's equations have none, nature has all.
# An exact model has one of the two; with parts it may be between.
SHARES = (0.0, 1.0)
# Halfway, and as far as to either.
SHARE, SHARE_STD = 0.5, 0.5
# A gauge's bias, m/m, at least: a bridge drifts by 20 microstrain while it warms up, whatever the
# file says of the day it was balanced.
BIAS_STD = 2e-5
# Keeps V regular where the scale is taken out of it.
REGULAR = 1e-6
# A column whose value is certain.
CERTAIN = 1e-9
PAYLOAD_INERTIA = 'payload_inertia'
# A model is nowhere linearised about parts further off than this many standard deviations.
FARTHEST = 5.0


@dataclass(frozen=True)
class Prior:
    """
    Mean and standard deviation of beta's columns but the payload's, as time_update.py has them.

    Attributes
    ----------
    mean, std : Array
        (B,).
    lowest : Array
        What no column can be less than, (B,).
    parts, gains : int
        How many of the columns are parts, with the forces that last, and gauges' gains.
    scale : Array
        The columns that grow together where the whole arm is heavier, stiffer and stronger, with
        the payload's logarithm, (B,). No output shows it.

    """

    mean: Array
    std: Array
    lowest: Array
    parts: int
    gains: int
    scale: Array

    @cached_property
    def scale_variance(self) -> float:
        """Return the variance of the arm's scale, relative: what no record can make smaller."""
        information = float(((self.scale / self.std)**2).sum())
        return 1.0 / information if information else 0.0

    @cached_property
    def weights(self) -> Array:
        """Return the inverse variance of each part and gain over their number, else 0, (B,)."""
        count, found = self.parts + self.gains, np.zeros(self.mean.size)
        found[found.size - count:] = 1.0 / (max(count, 1) * self.std[found.size - count:]**2)
        return found

    def exact(self) -> Prior:
        """Return the prior where all parts and gains are the robot file's."""
        kept = self.mean.size - self.parts - self.gains
        std = self.std[:kept].copy()
        std[CORIOLIS] = CERTAIN
        return Prior(self.mean[:kept], std, self.lowest[:kept], 0, 0, np.zeros(kept))

    def within(self, beta: Array) -> Array:
        """Return parameters that a robot can have, (B,)."""
        far = FARTHEST * self.std
        found = np.clip(beta, np.maximum(self.mean - far, self.lowest), self.mean + far)
        found[MASS] = max(beta[MASS], 0.0)
        return np.asarray(found)

    def covariance(self, mass_std: float) -> Array:
        """
        Return V of an arm whose payload is known to a standard deviation, kg, (B, B).

        Without the scale of the whole arm, which `FilterStep.published` adds: linearised about
        estimates that move, a filter would find in the record what is not there.
        """
        std = self.std.copy()
        std[MASS] = mass_std
        free = np.diag(std**2 * (1.0 + REGULAR))
        return free - self.scale_variance * np.outer(self.scale, self.scale)

    def consider_variance(self, beta_cov: Array) -> float:
        """
        Return by how much the payload's variance grows where parts are considered, kg^2.

        A wrong model's estimates of the parts soak up what the model lacks, so that their own
        spread says too little. Given them the record still tells the payload: its mean moves with
        them by c = V_pp^-1 V_pm, and they are as uncertain as the robot file says (Schmidt's
        consider filter; Bierman, Factorization Methods, 1977, VIII).

        Parameters
        ----------
        beta_cov : Array
            V, (B, B).

        """
        parts = slice(self.mean.size - self.parts - self.gains, None)
        own = 1.0 / self.std[parts]
        believed = own[:, None] * beta_cov[parts, parts] * own
        slope = np.linalg.solve(believed + REGULAR * np.eye(own.size),
                                own * beta_cov[parts, MASS])
        return max(0.0, float(slope @ slope - slope @ believed @ slope))


def disturbance_std(robot: Robot, turns: bool) -> Array:
    """
    Return the standard deviation of what forces last, (4,): wind, a tilt, a cable, a drive.

    A force at the tip that bends the lower link's root as much as its gauge's bias: a bridge that
    is balanced with the arm in place reads such a force as zero, and it turns up when the arm
    turns.
    A drive's bias is the torque that this force has about its joint. The paper's models come of
    no energy: no force at the tip is derived for them.
    """
    upper, lower = robot.links
    force = 2.0 * BIAS_STD * lower.bending_stiffness / (lower.thickness * lower.length)
    reach = np.array([upper.length + lower.length, lower.length])
    gains = np.array([drive.torque_gain for drive in robot.drives])
    return np.concatenate([[force if turns else 0.0] * 2, force * reach / gains])


@compiled
def tolerances_off(beta: Array, beta_cov: Array, mean: Array, weights: Array) -> float:
    """
    Return the mean square of the parts' deviations over their tolerances, as the posterior has it.

    The likeliest scale of a prior's variances (Dempster, Laird, Rubin, 1977: EM): a part that
    nothing tells counts as told. Beyond 1 something acts on the arm that no part has, and the
    posterior, which the tolerances set, is as much wider (Birge's ratio).
    """
    total = 0.0
    for i in range(beta.size):
        off = beta[i] - mean[i]
        total += weights[i] * (off * off + beta_cov[i, i])
    return total


def moving_parts(robot: Robot) -> tuple[Part, ...]:
    """Return the parts that act on the motion; what acts on gauges, their gains stand for."""
    return tuple(part for part in robot_parts(robot)
                 if not part.name.startswith(('length', 'position')))


def positive(nominal: float, tolerance: float) -> tuple[float, float]:
    """
    Return mean and standard deviation of a normal deviation that leaves its part positive.

    For what is as good as zero in the robot file, as the inertia of a payload that should be a
    point, they are 0.8 and 0.6 tolerances.
    """
    low = -nominal / tolerance
    mean = math.exp(-0.5 * low**2 - log_ndtr(-low)) / math.sqrt(2.0 * math.pi)
    return tolerance * mean, tolerance * math.sqrt(1.0 + low * mean - mean**2)


def prior_of(robot: Robot, effects: Sequence[Effect], turns: bool) -> Prior:
    """
    Return the prior of a robot's columns.

    Parameters
    ----------
    robot : Robot
        Its tolerances count.
    effects : sequence of Effect
        Of the robot file: Coriolis forces among them are known.
    turns : bool
        Whether the model has Coriolis forces.

    """
    parts, gauges = moving_parts(robot), gauge_parts(robot)
    biases = [max(part.tolerance, BIAS_STD) for part in gauges if part.kind == 'bias']
    gains = [part.tolerance for part in gauges if part.kind == 'gain']
    forces = disturbance_std(robot, turns)
    std = np.array([0.0, 0.0, *biases, *forces, *(part.tolerance for part in parts), *gains])
    mean, lowest = np.zeros(std.size), np.full(std.size, -np.inf)
    first = FIRST_BIAS + len(biases) + forces.size
    for k, part in enumerate(parts, start=first):
        if part.name == PAYLOAD_INERTIA:
            mean[k], std[k] = positive(robot.payload_inertia, part.tolerance)
            lowest[k] = -robot.payload_inertia
    told = [effect['share'] for effect in effects if isinstance(effect, CoriolisCentripetal)]
    if turns:
        mean[CORIOLIS] = sum(told) if told else SHARE
        std[CORIOLIS] = 0.0 if told else SHARE_STD
    scale = np.zeros(std.size)
    for k, part in enumerate(parts, start=first):
        scale[k] = 0.0 if part.unit or part.name.startswith(('damping', 'drive_gain')) else 1.0
        if part.name.startswith('drive_gain') and not robot.drives[int(part.name[-1]) - 1] \
                .closed_loop:
            scale[k] = 1.0
    return Prior(mean, np.maximum(std, CERTAIN), lowest, len(parts) + forces.size, len(gains),
                 scale)


@lru_cache(maxsize=4)
def tabulated(robot: Robot, model: str, modes: int, effects: tuple[Effect, ...],
              heaviest: float) -> PayloadSchedule:
    """
    Return the schedule over the parts; some are kept.

    Derivatives are central differences over the tolerances; an inertia that is zero only grows.
    """
    arm = ExtendedArm(robot, model, modes, effects=effects)

    def changed(part: Part, deviation: float) -> tuple[ExtendedArm, float]:
        return (ExtendedArm(part.change(robot, deviation), model, modes, effects=effects,
                            step=arm.step_time), 1.0 / deviation)

    def slope(part: Part) -> Mixture:
        if part.name == PAYLOAD_INERTIA:
            return [changed(part, part.tolerance)]
        return [(other, 0.5 * share) for other, share in (
            changed(part, sign * part.tolerance) for sign in (1.0, -1.0))]

    return PayloadSchedule.of(arm, heaviest, [slope(part) for part in moving_parts(robot)])
