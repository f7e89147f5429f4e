"""How wrong the model may be: exactly as told, or wrong in proportion to the motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import zero_order_hold
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Unmodelled accelerations, held for HOLD_S: joints, rad/s^2, and links, m/s^2; unmodelled
# static bending at the tip, in lengths; all at activity 1; and the share of the drive's net
# torque that the model has no account of (friction when a joint sticks).
ROBUST_LEVELS = ((1.0, 1.0, 2e-4, 0.1), (3.0, 10.0, 2e-4, 0.5), (3.0, 10.0, 4e-3, 0.5))
HOLD_S = 0.01
# Activity 1: the gauges' root mean square is that of a static tip deflection of this, lengths.
LIVELY = 0.02
ACTIVITY_MEMORY_S = 0.2
ACTIVITY_LIMIT = 5.0


@dataclass(frozen=True)
class Level:
    """
    Noise of one hypothesis about the model; beyond the told noise it grows with activity.

    Attributes
    ----------
    exact : bool
        The model and the noise are as told; otherwise tolerances and colour count as well.
    told_torque, extra_torque : Array
        Standard deviations of the command's disturbance, in its unit, (2,).
    floor : Array
        Covariance added to the state every sample, (n, n), or (0, 0) for none.
    extra_noise : Array
        Variance of each channel beyond the told one, over it, (m,).
    net_share : float
        Disturbance as a share of the drive's net torque.
    drift : float
        Random walk of the payload, kg per square root of a second.

    """

    exact: bool
    told_torque: Array
    extra_torque: Array
    floor: Array
    extra_noise: Array
    net_share: float = 0.0
    drift: float = 0.0

    def torque(self, activity: float, net: Array) -> Array:
        """
        Return the standard deviation of the command's disturbance, (2,).

        Parameters
        ----------
        activity : float
            See Activity.
        net : Array
            The drive's net torque in the command's unit, (2,).

        """
        return np.sqrt(self.told_torque**2 + (activity * self.extra_torque)**2
                       + (self.net_share * net)**2)

    def noise(self, activity: float) -> Array:
        """Return the variance of each channel over the told one, (m,)."""
        return 1.0 + activity**2 * self.extra_noise


class Activity:
    """How much the links bend now, and did over the last ACTIVITY_MEMORY_S."""

    def __init__(self, arm: ExtendedArm):
        scale = static_strain(arm, LIVELY)
        # The mean square of the gauges, over that of a static deflection.
        self._weights = np.zeros(scale.size)
        self._weights[2:] = 1.0 / (scale[2:]**2 * max(scale.size - 2, 1))
        self._share = min(1.0, arm.step_time / ACTIVITY_MEMORY_S)
        self._square = 0.0

    def follow(self, output: Array) -> float:
        """Return the activity, dimensionless, after a sample, rad and m/m, (m,)."""
        now = float(self._weights.dot(output * output))
        self._square += self._share * (now - self._square)
        return min(ACTIVITY_LIMIT, math.sqrt(max(now, self._square)))


def told_noise(arm: ExtendedArm) -> Array:
    """Return the robot file's standard deviation of each channel, rad and m/m, (m,)."""
    gauges = len(arm.robot.gauge_names)
    return np.array([arm.robot.angle_noise] * 2 + [arm.robot.strain_noise] * gauges)


def levels(arm: ExtendedArm, torque_noise: Array, drift: float) -> tuple[Level, ...]:
    """
    Return the exact level, the exact one with a drifting payload, and the robust ones.

    Parameters
    ----------
    arm : ExtendedArm
        The model.
    torque_noise : Array
        Told process noise: torque on each joint held over a sample, N m, (2,).
    drift : float
        Of the second level, kg per square root of a second.

    """
    gains = np.array([drive.torque_gain for drive in arm.robot.drives])
    told, noise = torque_noise / gains, told_noise(arm)
    exact = Level(True, told, np.zeros(2), np.zeros((0, 0)), np.zeros(noise.size))
    found = [exact, replace(exact, drift=drift)]
    inertia = np.diag(arm.form.mass_at(1.0, arm.robot.payload_mass))[:2]
    hold, push = np.sqrt(HOLD_S / arm.step_time), _held_force(arm)
    for joint, link, bend, share in ROBUST_LEVELS:
        found.append(Level(False, told, hold * joint * inertia / gains,
                           (hold * link)**2 * push @ push.T,
                           (static_strain(arm, bend) / noise)**2, share))
    return tuple(found)


def speed_feedback(arm: ExtendedArm) -> Array:
    """Return the command that holds a joint velocity of 1 rad/s, over the states, (2, n)."""
    rows = np.zeros((2, arm.states))
    if arm.compact is None:
        for j, drive in enumerate(arm.robot.drives):
            rows[j, arm.form.order + j] = drive.damping / drive.torque_gain
    return rows


def _held_force(arm: ExtendedArm) -> Array:
    """Return what a force of mu times 1 m/s^2 on each q does in a sample, (n, 2 modes)."""
    middle, flexible = 3 * arm.nodes.size // 4, 2 * arm.modes
    if arm.compact:
        push = np.zeros((arm.states, flexible))
        push[2 + flexible:2 + 2 * flexible] = \
            arm.compact.at_cosine(arm.nodes[middle]).lam(arm.robot.payload_mass)
    else:
        modal_mass = np.repeat([link.mass / 4.0 for link in arm.robot.links], arm.modes)
        push = arm.plant.e[middle][:, 2:2 + flexible] * modal_mass
    return zero_order_hold(arm.plant.a[middle], push, arm.step_time)[1]


def static_strain(arm: ExtendedArm, share: float) -> Array:
    """Return the root strain of a static tip deflection, share of the length, (m,)."""
    strain = [0.0, 0.0]
    for link in arm.robot.links:
        strain += [1.5 * link.thickness / link.length * share] * len(link.gauge_positions)
    return np.array(strain)


def start_spread(arm: ExtendedArm) -> Array:
    """Return the standard deviation of the state at the start: anywhere, moving, bent, (n,)."""
    bend: list[float] = []
    swing: list[float] = []
    for link in arm.robot.links:
        size = 0.04 * link.length / np.arange(1, arm.modes + 1)**2
        bend += list(size)
        swing += list(size * link.beam(arm.modes).frequencies)
    extra = [1.0] * (0 if arm.compact else arm.form.order - 2 - 2 * arm.modes)
    turning = [] if arm.compact else [1.0, 1.0]
    spread = [1.0, 1.0, *bend, *extra, *turning, *swing, *extra]
    return np.array(spread + [1.0] * (arm.states - len(spread)))
