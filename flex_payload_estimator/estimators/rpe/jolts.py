"""A command that was not the one told, or a push: one sample that nothing else explains."""

from __future__ import annotations

import math

from flex_payload_estimator.estimators.rpe.evidence import MEMORY_S
from flex_payload_estimator.estimators.rpe.filter import Filter, FilterStep, GATE, Sample
from flex_payload_estimator.estimators.rpe.modes import GAIN
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_plant_sim.arm.second_order import Array
import numpy as np


class Jolts:
    """
    Tells samples whose command cannot have been the one told.

    A wrong measurement is over with its sample. A wrong command leaves a speed that was never
    predicted, which looks like another payload or another arm for seconds. So where a sample is
    past the gate and the same sample with a command that may have been anything gains GAIN nats,
    it is taken with that (generalised likelihood ratio: Willsky, Automatica 12, 1976). A second
    one within MEMORY_S is none: then the model is wrong.

    Parameters
    ----------
    stepper : FilterStep

    """

    def __init__(self, stepper: FilterStep):
        self._stepper = stepper
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._largest, self._last = np.zeros(2), -math.inf

    def taken(self, before: Filter, after: Filter, sample: Sample, loads: Loads
              ) -> tuple[Filter, Sample]:
        """
        Return filter and sample as they are to be believed.

        Parameters
        ----------
        before, after : Filter
            One that has not predicted the sample yet, and the same after it.
        sample : Sample
            What it learnt from.
        loads : Loads
            Of late.

        """
        self._largest = np.maximum(self._largest, np.abs(sample.command))
        if sample.measured is None or sample.time - self._last < MEMORY_S \
                or after.square * sample.measured.size < GATE:
            return after, sample
        free: Array = self._largest**2
        doubted, other = before.copy(), sample._replace(doubt=free)
        self._stepper.step(doubted, other, loads)
        if not doubted.stated > after.stated + GAIN:
            return after, sample
        self._last = sample.time
        return doubted, other
