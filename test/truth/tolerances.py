"""Part tolerances: every real arm differs a little from its data sheet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truth.configuration import Arm, Joint, Link

# Relative standard deviations; the drive's gain is that of command to steady speed.
STIFFNESS = 0.01
LINK_MASS = 0.01
DAMPING = 0.10
ELBOW_MASS = 0.01
ELBOW_INERTIA = 0.05
DRIVE_INERTIA = 0.02
DRIVE_TORQUE = 0.01
DRIVE_DAMPING = 0.01
GAUGE_GAIN = 0.005
ANGLE_GAIN = 0.0005
# Gauge positions, m.
GAUGE_POSITION = 2e-4


def with_tolerances(arm: Arm, rng: np.random.Generator) -> Arm:
    """Return `arm` with all parts drawn from their Gaussian tolerances (cut at three sigma)."""
    def factor(deviation: float) -> float:
        return 1.0 + deviation * float(np.clip(rng.standard_normal(), -3.0, 3.0))

    def link(part: Link) -> Link:
        return replace(
            part, youngs_modulus=part.youngs_modulus * factor(STIFFNESS),
            density=part.density * factor(LINK_MASS),
            damping_ratio=part.damping_ratio * factor(DAMPING),
            gauges=tuple(max(0.0, x + factor(GAUGE_POSITION) - 1.0) for x in part.gauges))

    def joint(part: Joint) -> Joint:
        return replace(
            part, inertia=part.inertia * factor(DRIVE_INERTIA),
            torque_gain=part.torque_gain * factor(DRIVE_TORQUE),
            damping=part.damping * factor(DRIVE_DAMPING))

    sensors = replace(
        arm.sensors, strain_gain=tuple(factor(GAUGE_GAIN) for _ in arm.sensors.strain_gain),
        angle_gain=(factor(ANGLE_GAIN), factor(ANGLE_GAIN)))
    structure = replace(
        arm.structure, elbow_mass=arm.structure.elbow_mass * factor(ELBOW_MASS),
        elbow_inertia=arm.structure.elbow_inertia * factor(ELBOW_INERTIA))
    return replace(
        arm, links=(link(arm.links[0]), link(arm.links[1])),
        joints=(joint(arm.joints[0]), joint(arm.joints[1])), sensors=sensors,
        structure=structure)
