"""
The base model: the arm that hypotheses are added to.

Every prediction of the diagnosis starts here; `Predictor` runs a record through such an arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flex_plant_sim.arm.models import DEFAULT_MODEL, DEFAULT_MODES
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm

# Interpolation nodes over cos(theta_2). With 7 the matrices are right to 1e-4 of their size; with
# 5 an estimated size moved by a tenth of its interval.
SCHEDULE_NODES = 7


@dataclass(frozen=True)
class BaseModel:
    """
    The model that hypotheses are added to.

    Attributes
    ----------
    robot : Robot
    model : str
        Name of the arm model, see ExtendedArm.
    modes : int
        Bending shapes of each link.
    effects : tuple of Effect
        Effects that every hypothesis has.
    noise_shares : tuple of float
        Standard deviation of the process noise on the joints and on the deflections, as shares of
        the rms loads, in a step of REFERENCE_STEP; see `process_noise_variance`.
    discrepancy : DiscrepancyModel
        What every model is allowed to miss where hypotheses are compared.

    """

    robot: Robot
    model: str = DEFAULT_MODEL
    modes: int = DEFAULT_MODES
    effects: tuple[Effect, ...] = ()
    # With 1 % on the joints true parts are as likely (benchmarks/temper.py), but fits have more
    # side valleys; see docs/evidence.md.
    noise_shares: tuple[float, float] = (0.05, 0.02)
    discrepancy: DiscrepancyModel = DiscrepancyModel()

    def arm(self, payload: float, effects: Sequence[Effect] = (),
            robot: Robot | None = None, in_step: bool = False) -> ExtendedArm:
        """Return the arm with a payload, kg, and further effects; see ExtendedArm."""
        return ExtendedArm(robot or self.robot, self.model, self.modes, payload,
                           (*self.effects, *effects), nodes=SCHEDULE_NODES, in_step=in_step)
