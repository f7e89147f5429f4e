"""The bent arm as the sensors see it: what payload_estimator draws on `arm_markers`."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.arm_shape import ArmShape
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np


@dataclass(frozen=True)
class MeasuredShape:
    """
    Centre lines of the links from joint angles and strain, with one mode per gauge on a link.

    Attributes
    ----------
    shape : ArmShape
        Centre lines from angles and modal coordinates.
    modal : Array
        Modal coordinates q per unit strain, m, (2 n, gauges).

    """

    shape: ArmShape
    modal: Array

    @classmethod
    def of(cls, robot: Robot) -> MeasuredShape:
        """Return the shape of a robot; a link without gauges is drawn straight."""
        modes = max(1, min(len(link.gauge_positions) for link in robot.links))
        arm = ExtendedArm(robot, 'assumed_modes', modes, robot.payload_mass)
        modal = np.linalg.pinv(arm.output_matrix[2:, 2:2 + 2 * modes]).astype(np.float64)
        return cls(ArmShape.of(arm), modal)

    def lines(self, output: Array) -> Array:
        """Return the centre lines, m, (2, P, 2), for (theta_1, theta_2, strain…), (m,)."""
        return self.shape.lines(np.concatenate([output[:2], self.modal @ output[2:]]))
