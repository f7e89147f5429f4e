"""The slowest natural frequency of an arm, by which its records are measured."""

from __future__ import annotations

from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np


def frequency_of(arm: ExtendedArm) -> float:
    """Return the lowest natural frequency of the stretched arm with locked joints, rad/s."""
    flexible = slice(2, 2 + 2 * arm.modes)
    ratio = np.linalg.solve(arm.form.mass_at(1.0, arm.payload)[flexible, flexible],
                            arm.form.stiffness_at(1.0)[flexible, flexible])
    return float(np.sqrt(np.min(np.linalg.eigvals(ratio).real)))


def period_samples(slowest: float, sample_time: float) -> int:
    """Return the samples of a period, s, of the slowest natural frequency, rad/s."""
    return int(np.ceil(2.0 * np.pi / slowest / sample_time))
