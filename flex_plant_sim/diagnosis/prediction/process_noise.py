"""Loads of an arm in a record, and process noise as shares of them."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array, link_slice
from flex_plant_sim.diagnosis.record.windows import Windows
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# s: the step in which `BaseModel.noise_shares` hold, the sample time of the reference arm.
REFERENCE_STEP = 0.01


def net_torques(arm: ExtendedArm, windows: Windows) -> Array:
    """
    Return the standard deviation of each drive's net torque in a record, N m, (2,).

    That is what is left of the commanded torque beside the drive's damping: a velocity loop's
    command is mostly a speed.
    """
    command, speed = windows.interval_means
    drives = arm.robot.drives
    return np.std([d.torque_gain * command[:, k] - d.damping * speed[:, k]
                   for k, d in enumerate(drives)], axis=1)


def load_deviations(arm: ExtendedArm, windows: Windows) -> Array:
    """
    Return the standard deviation of the generalised force on each coordinate in a record, (N,).

    A joint's is its drive's net torque. Bending forces follow from the standard deviations of the
    strain, as if the first shape alone made it; they are the same for all shapes, as those of a
    force at the tip are. Coordinates that an effect added have none.
    """
    loads, robot = np.zeros(arm.form.order), arm.robot
    loads[:2] = net_torques(arm, windows)
    strain, row = windows.record.output_deviation[2:], 0
    for j, link in enumerate(robot.links):
        if link.gauge_positions:
            q = link_slice(j, arm.modes)
            first = q.start
            stiffness = arm.form.stiffness[0, first, first]
            loads[q] = strain[row] * stiffness / np.abs(arm.form.strain[row, first])
        row += len(link.gauge_positions)
    return loads


def process_noise_variance(loads: Array, shares: tuple[float, float]) -> Array:
    """
    Return the variance of the generalised force noise on each coordinate, (N,).

    Parameters
    ----------
    loads : Array
        load_deviations, (N,).
    shares : tuple of float
        Standard deviation as a share of the loads: on the joints, on the deflections.

    """
    share = np.full(loads.size, shares[1])
    share[:2] = shares[0]
    return (share * loads)**2
