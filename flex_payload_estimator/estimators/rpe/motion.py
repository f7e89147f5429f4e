"""Whether the arm moves, and what it carries."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.filter import FilterStep
from flex_payload_estimator.estimators.rpe.hypothesis import Filter, Sample
from flex_payload_estimator.estimators.rpe.onward import Said
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_plant_sim.arm.second_order import Array
import numpy as np

# The payload is told where a gauge swings by so many standard deviations of its noise, and for
# a while after: set-points are held that long.
SWING, EXCITED_S = 5.0, 2.0


class Motion:
    """
    Loads, and the time since the arm last moved.

    Attributes
    ----------
    loads : Loads
    excited : bool
        Whether it has moved within EXCITED_S.
    moved : bool
        Whether it ever has.
    said : Said or None
        What the incumbent said after the last sample, where it has not changed since.

    """

    def __init__(self, stepper: FilterStep):
        self._stepper = stepper
        self.loads = Loads.none(np.zeros(stepper.told_variance.size), stepper.step_time)
        self.excited, self.moved, self._still = False, False, EXCITED_S
        self._swings = False
        self.said: Said | None = None

    def begin(self, output: Array) -> None:
        """Take the first sample."""
        self.loads = Loads.none(output, self._stepper.step_time)

    def follow(self, output: Array | None, incumbent: Filter, sample: Sample) -> None:
        """Take a sample."""
        if output is not None:
            self.loads, self._swings, self.said = self._stepper.followed(
                incumbent, sample.command, output, self.loads, SWING**2)
        self._still = 0.0 if self._swings else self._still + self._stepper.step_time
        self.excited = self._still < EXCITED_S
        self.moved = self.moved or self.excited
