"""The prior of the parameters: payload, forces of motion, gauges, disturbances and parts."""

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
from flex_plant_sim.effects.sensor.angle_offset import AngleOffset
from flex_plant_sim.effects.structure.coriolis_centripetal import CoriolisCentripetal
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np
from scipy.special import chdtri, log_ndtr

# Share of the forces of motion that an exact model may have: the paper's equations have none, real
# arms all. With free parts the share is a parameter of this mean and standard deviation.
SHARES = (0.0, 1.0)
SHARE, SHARE_STD = 0.5, 0.5
# Smallest standard deviation of a gauge's bias, m/m: a bridge drifts by 20 microstrain while it
# warms up, whatever the robot file says of the day it was balanced.
BIAS_STD = 2e-5
# The same of the zero of joint 2's angle, rad, whatever the robot file says of the day it was set:
# a coupling slips, a reference run finds another edge. The smallest that matters in practice.
ZERO_STD = AngleOffset.parameters[0].smallest
# Added to relative variances, so that matrices stay regular where the arm's scale is taken out.
REGULAR = 1e-6
# Standard deviation of a parameter whose value is known, in its unit; no range of payloads is
# narrower, kg: what is divided by its square would be by nothing.
CERTAIN = 1e-9
PAYLOAD_INERTIA = 'payload_inertia'
# No model is linearised about parts that are off by more than this many standard deviations.
FARTHEST = 5.0
# Share of arms with parts as good as their tolerances that are not called suspect for them.
GOOD_ARMS = 0.99


@dataclass(frozen=True)
class Prior:
    """
    The prior of beta but for the payload; time_update.py has the order of the parameters.

    Attributes
    ----------
    mean, std : Array
        Of each parameter, in its unit, (B,).
    lowest : Array
        Smallest value of each parameter, (B,).
    parts, gains : int
        Number of parts, with the constant disturbances, and of gauge gains, among the parameters.
    scale : Array
        1 for each parameter that grows with the scale of the arm, if all masses, inertias,
        stiffnesses and drives grow by one factor, else 0, (B,). No output shows that factor.

    """

    mean: Array
    std: Array
    lowest: Array
    parts: int
    gains: int
    scale: Array

    @cached_property
    def scale_variance(self) -> float:
        """Return the relative variance of the arm's scale, which no record can make smaller."""
        information = float(((self.scale / self.std)**2).sum())
        return 1.0 / information if information else 0.0

    @property
    def zero(self) -> int:
        """Return the column of the zero of joint 2's angle."""
        return self.mean.size - self.parts - self.gains - 1

    @property
    def tolerated(self) -> slice:
        """Return the columns of the zero, parts and gains; of an exact model, none."""
        return slice(self.zero if self.parts else self.mean.size, None)

    @cached_property
    def weights(self) -> Array:
        """Return 1 / (N std^2) for each of the N parameters with a tolerance, else 0, (B,)."""
        found, tolerated = np.zeros(self.mean.size), self.tolerated
        found[tolerated] = 1.0 / (max(found[tolerated].size, 1) * self.std[tolerated]**2)
        return found

    @cached_property
    def most_off(self) -> float:
        """Return the mean square of deviations over tolerances that GOOD_ARMS stay below."""
        count = max(self.mean[self.tolerated].size, 1)
        return float(chdtri(count, 1.0 - GOOD_ARMS)) / count

    def exact(self) -> Prior:
        """Return the prior of an exact model: zero, parts and gains are the robot file's."""
        kept = self.mean.size - self.parts - self.gains
        std = self.std[:kept].copy()
        std[[CORIOLIS, self.zero]] = CERTAIN
        return Prior(self.mean[:kept], std, self.lowest[:kept], 0, 0, np.zeros(kept))

    def within(self, beta: Array) -> Array:
        """Return the parameters clipped to what a robot can have, (B,)."""
        far = FARTHEST * self.std
        found = np.clip(beta, np.maximum(self.mean - far, self.lowest), self.mean + far)
        found[MASS] = max(beta[MASS], 0.0)
        # At any angle the arm is one that can be.
        found[self.zero] = beta[self.zero]
        return np.asarray(found)

    def covariance(self, mass_std: float) -> Array:
        """
        Return V for a standard deviation of the payload, kg, (B, B).

        It is without the variance of the arm's scale, which `FilterStep.published` adds: a filter
        that is linearised about moving estimates would find a scale that no output shows.
        """
        std = self.std.copy()
        std[MASS] = mass_std
        free = np.diag(std**2 * (1.0 + REGULAR))
        return free - self.scale_variance * np.outer(self.scale, self.scale)

    def log_odds_of_exact(self, beta: Array, beta_cov: Array) -> float:
        """
        Return the log-likelihood ratio of parts as in the robot file over free parts, nats.

        It is the ratio of the parts' posterior to their prior density at the file's values, as the
        exact model is the free one there (Dickey, Annals of Mathematical Statistics 42, 1971).

        Parameters
        ----------
        beta : Array
            Estimates of a filter that began at this prior, (B,).
        beta_cov : Array
            Their V, (B, B).

        """
        parts = self.tolerated
        own = 1.0 / self.std[parts]
        regular = REGULAR * np.eye(own.size)
        prior, now = (own[:, None] * cov[parts, parts] * own + regular
                      for cov in (self.covariance(1.0), beta_cov))
        # Both are deviations: the file's values are at zero, the mean of an inertia is not.
        off, off_before = own * beta[parts], own * self.mean[parts]
        lost = np.linalg.slogdet(prior)[1] - np.linalg.slogdet(now)[1]
        return float(0.5 * (lost - off @ np.linalg.solve(now, off)
                            + off_before @ np.linalg.solve(prior, off_before)))

    def consider_variance(self, beta_cov: Array) -> float:
        """
        Return the consider variance of the payload for the parts p, c' (V_prior - V_pp) c, kg^2.

        A wrong model's estimates of the parts take up what the model lacks, so that V_pp is too
        small. The payload given the parts is still known: its mean moves with them by
        c = V_pp^-1 V_pm, and they are as uncertain as the robot file says (Schmidt's consider
        filter; Bierman, Factorization Methods, 1977, VIII).

        Parameters
        ----------
        beta_cov : Array
            V, (B, B).

        """
        parts = self.tolerated
        own = 1.0 / self.std[parts]
        relative = own[:, None] * beta_cov[parts, parts] * own
        slope = np.linalg.solve(relative + REGULAR * np.eye(own.size),
                                own * beta_cov[parts, MASS])
        return max(0.0, float(slope @ slope - slope @ relative @ slope))


def disturbance_std(robot: Robot, turns: bool) -> Array:
    """
    Return the standard deviation of the constant disturbances, (4,): wind, a tilt, a cable.

    First a force at the tip along the world's axes, N, which bends the lower link's root as much
    as its gauge's bias: a bridge that is balanced with the arm in place reads such a force as
    zero, and shows it when the arm turns. Then each drive's bias, in the command's unit, which has
    the torque of that force about the joint.

    Parameters
    ----------
    robot : Robot
        Its lower link and drives count.
    turns : bool
        Whether the model has forces of motion. The paper's models, which follow from no energy,
        have none, and no force at the tip either.

    """
    upper, lower = robot.links
    force = 2.0 * BIAS_STD * lower.bending_stiffness / (lower.thickness * lower.length)
    reach = np.array([upper.length + lower.length, lower.length])
    gains = np.array([drive.torque_gain for drive in robot.drives])
    return np.concatenate([[force if turns else 0.0] * 2, force * reach / gains])


@compiled
def tolerances_off(beta: Array, beta_cov: Array, mean: Array, weights: Array) -> float:
    """
    Return the posterior mean of the parts' squared deviations over their tolerances squared.

    That is the likeliest factor of the prior's variances by one step of EM (Dempster, Laird,
    Rubin, 1977): a part of which nothing is learnt counts 1. Above 1 something acts on the arm
    that no part has, and the posterior is too narrow by that factor (Birge's ratio squared).

    Parameters
    ----------
    beta, beta_cov : Array
        (B,) and V, (B, B).
    mean, weights : Array
        See Prior, (B,).

    """
    total = 0.0
    for i in range(beta.size):
        off = beta[i] - mean[i]
        total += weights[i] * (off * off + beta_cov[i, i])
    return total


def moving_parts(robot: Robot) -> tuple[Part, ...]:
    """Return the parts that act on the motion; gauge gains stand for those that act on gauges."""
    return tuple(part for part in robot_parts(robot)
                 if not part.name.startswith(('length', 'position')))


def positive(nominal: float, tolerance: float) -> tuple[float, float]:
    """
    Return mean and standard deviation of a normal deviation that leaves its part positive.

    Where the part is zero in the robot file, as the inertia of a payload that is a point, they are
    0.8 and 0.6 tolerances (the truncated normal distribution).
    """
    low = -nominal / tolerance
    mean = math.exp(-0.5 * low**2 - log_ndtr(-low)) / math.sqrt(2.0 * math.pi)
    return tolerance * mean, tolerance * math.sqrt(1.0 + low * mean - mean**2)


def prior_of(robot: Robot, effects: Sequence[Effect], turns: bool) -> Prior:
    """
    Return the prior of a robot's parameters.

    Parameters
    ----------
    robot : Robot
        Its tolerances are the standard deviations.
    effects : sequence of Effect
        Of the robot file. Coriolis forces among them are known.
    turns : bool
        Whether the model has forces of motion.

    """
    parts, gauges = moving_parts(robot), gauge_parts(robot)
    biases = [max(part.tolerance, BIAS_STD) for part in gauges if part.kind == 'bias']
    gains = [part.tolerance for part in gauges if part.kind == 'gain']
    forces = disturbance_std(robot, turns)
    zero = max(robot.tolerances.angle_zero_rad, ZERO_STD)
    std = np.array([0.0, 0.0, *biases, zero, *forces, *(part.tolerance for part in parts),
                    *gains])
    mean, lowest = np.zeros(std.size), np.full(std.size, -np.inf)
    first = FIRST_BIAS + len(biases) + 1 + forces.size
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
              payload_max: float) -> PayloadSchedule:
    """
    Return the sampled arm with its derivatives over the parts; the last few are kept.

    Derivatives are central differences over the tolerances, but one-sided for the payload's
    inertia, which may be zero.
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

    return PayloadSchedule.of(arm, payload_max, [slope(part) for part in moving_parts(robot)])
