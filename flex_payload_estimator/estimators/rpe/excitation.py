"""Whether the arm moves, and the loads that it carries."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.compiled_step import Moments
from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.filter_step import FilterStep
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_plant_sim.arm.second_order import Array
import numpy as np

# The arm moves while a gauge, or without gauges a joint, varies by this many standard deviations
# of its noise, and for EXCITED_S, s, after: set-points are held that long.
EXCITED_STD, EXCITED_S = 5.0, 2.0


class Excitation:
    """
    The loads, and the time since the arm last moved.

    Attributes
    ----------
    loads : Loads
    excited : bool
        Whether the arm has moved within EXCITED_S.
    has_moved : bool
        Whether it ever has.
    moments : Moments or None
        Payload and variance of the incumbent after the last sample, None where it has changed
        since then.

    """

    def __init__(self, stepper: FilterStep):
        self._stepper = stepper
        self.loads = Loads.none(np.zeros(stepper.told_variance.size), stepper.step_time)
        self.excited, self.has_moved, self._time_still = False, False, EXCITED_S
        self._swings = False
        self.moments: Moments | None = None

    def begin(self, output: Array) -> None:
        """Take the first outputs, (m,)."""
        self.loads = Loads.none(output, self._stepper.step_time)

    def update(self, output: Array | None, incumbent: Filter, sample: Sample) -> None:
        """Take a sample; without outputs, (m,), only time passes."""
        if output is not None:
            self.loads, self._swings, self.moments = self._stepper.update_loads(
                incumbent, sample.command, output, self.loads, EXCITED_STD**2)
        self._time_still = 0.0 if self._swings else self._time_still + self._stepper.step_time
        self.excited = self._time_still < EXCITED_S
        self.has_moved = self.has_moved or self.excited
