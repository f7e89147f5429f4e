"""
Part tolerances: every real arm differs a little from its data sheet.

An arm is well made, or its parts are as far off as its robot file says that they may be; those
numbers repeat the robot files' and their documented defaults.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truth.configuration import Arm, Joint, Link


@dataclass(frozen=True)
class Spread:
    """
    Standard deviations of the parts, relative but for lengths in m, angles, strains and inertia.

    `drive_gain` is that of command to torque. With `closed_loop` it goes with the damping, so that
    `drive_damping` leaves the steady speed as it is.
    """

    stiffness: float = 0.01
    link_mass: float = 0.01
    damping: float = 0.10
    elbow_mass: float = 0.01
    elbow_inertia: float = 0.05
    drive_inertia: float = 0.02
    drive_gain: float = 0.01
    drive_damping: float = 0.01
    gauge_gain: float = 0.005
    angle_gain: float = 0.0005
    gauge_position: float = 2e-4
    payload: float = 0.0
    length: float = 0.0
    gauge_bias: float = 0.0
    angle_zero: float = 0.0
    payload_inertia: float = 0.0
    closed_loop: bool = False


# Kinds of arms: well made, or as told by the file, which is the robot's own.
GOOD, TOLD = 'good', 'told'
AS_TOLD = {
    'reference': Spread(
        0.03, 0.01, 0.3, 0.02, 0.05, 0.05, 0.01, 0.05, 0.01, 0.0, 5e-4, 0.01, 0.001, 1e-6, 0.005,
        2e-4, closed_loop=True),
    'quanser_2dsfl': Spread(
        0.1, 0.01, 1.0, 0.1, 0.5, 0.2, 0.1, 0.3, 0.1, 0.0, 5e-4, 0.1, 0.001, 1e-6, 0.005, 2e-4)}


def with_tolerances(arm: Arm, rng: np.random.Generator, spread: Spread) -> Arm:
    """Return `arm` with all parts drawn from their Gaussian tolerances (cut at three sigma)."""
    def draw(deviation: float) -> float:
        return deviation * float(np.clip(rng.standard_normal(), -3.0, 3.0))

    def factor(deviation: float) -> float:
        # A large one may halve a part or double it, but not change its sign.
        drawn = draw(deviation)
        return float(np.exp(drawn)) if deviation > 0.1 else 1.0 + drawn

    def link(part: Link) -> Link:
        return replace(
            part, youngs_modulus=part.youngs_modulus * factor(spread.stiffness),
            density=part.density * factor(spread.link_mass),
            damping_ratio=part.damping_ratio * factor(spread.damping),
            gauges=tuple(max(0.0, x + draw(spread.gauge_position)) for x in part.gauges))

    def joint(part: Joint) -> Joint:
        inertia, gain, damping = (factor(spread.drive_inertia), factor(spread.drive_gain),
                                  factor(spread.drive_damping))
        return replace(part, inertia=part.inertia * inertia, damping=part.damping * damping,
                       torque_gain=part.torque_gain * gain
                       * (damping if spread.closed_loop else 1.0))

    sensors = replace(
        arm.sensors, strain_gain=tuple(factor(spread.gauge_gain) for _ in arm.sensors.strain_gain),
        angle_gain=(factor(spread.angle_gain), factor(spread.angle_gain)))
    structure = replace(
        arm.structure, elbow_mass=arm.structure.elbow_mass * factor(spread.elbow_mass),
        elbow_inertia=arm.structure.elbow_inertia * factor(spread.elbow_inertia))
    arm = replace(
        arm, links=(link(arm.links[0]), link(arm.links[1])),
        joints=(joint(arm.joints[0]), joint(arm.joints[1])), sensors=sensors,
        structure=structure)
    # Drawn last, so that well made arms keep what they drew before these were.
    payload = replace(arm.payload, mass=arm.payload.mass * factor(spread.payload),
                      inertia=arm.payload.inertia + abs(draw(spread.payload_inertia)))
    first, second = (replace(part, length=part.length * factor(spread.length))
                     for part in arm.links)
    biases = tuple(bias + draw(spread.gauge_bias) for bias in arm.sensors.strain_bias)
    zero = arm.sensors.angle_offset[1] + draw(spread.angle_zero)
    return replace(arm, links=(first, second), payload=payload, sensors=replace(
        arm.sensors, strain_bias=biases, angle_offset=(arm.sensors.angle_offset[0], zero)))
