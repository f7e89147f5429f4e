"""One hypothesis of the bank, and what it learns from: samples, weighed or not."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from flex_payload_estimator.estimators.rpe.kernel import MASS_COLUMNS
from flex_payload_estimator.estimators.rpe.windows import Windows
from flex_plant_sim.arm.second_order import Array
import numpy as np


class Sample(NamedTuple):
    """
    What a step uses.

    Attributes
    ----------
    time : float
        Of the measurement, s.
    measured : Array or None
        Channels in units of the told noise, (m,); None where there is none.
    command : Array
        At the drives up to the measurement, (2,).
    before, activity : float
        Activity at the sample before and at this one.
    scatter : Array or None
        Standard deviation of what `command` is the mean of, (2,).

    """

    time: float
    measured: Array | None
    command: Array
    before: float
    activity: float
    scatter: Array | None = None

    def with_reading(self, measured: Array, activity: float) -> Sample:
        """Return the sample with its measurement and the activity that it shows."""
        return Sample(self.time, measured, self.command, self.before, activity, self.scatter)


class Weighed(NamedTuple):
    """What a measurement to come will be worth, see rpe_kernel.weigh."""

    expected: Array
    cov: Array
    sens: Array
    lean: Array
    gain: Array
    inverse: Array
    weighted: Array
    known: Array
    deviation: Array
    variance: float
    log_det: float


@dataclass
class Hypothesis:
    """
    State of one filter; its arrays are replaced at every step, never changed.

    Attributes
    ----------
    level : int
        Index of its Level.
    x, cov, sens, mass, variance, lean
        See rpe_kernel.
    log_likelihood, recent : float
        Sum over all samples, and with a memory of MISFIT_MEMORY_S, see rpe_stepper.
    misfit : float
        Mean of e'S^-1 e per channel with that memory; 1 where the model is right.
    windows : Windows
    sums : Array
        Score and information of the block and the two windows that go on, (2, 3).
    reading : Array
        Innovation and its standard deviation, rad and m/m, (2, m).

    """

    level: int
    x: Array
    cov: Array
    sens: Array
    mass: float
    variance: float
    lean: Array
    log_likelihood: float = 0.0
    recent: float = 0.0
    misfit: float = 1.0
    windows: Windows = field(default_factory=Windows)
    sums: Array = field(default_factory=lambda: np.zeros((2, MASS_COLUMNS)))
    reading: Array = field(default_factory=lambda: np.zeros((2, 0)))

    def copy(self) -> Hypothesis:
        """Return an independent copy: ten times quicker than dataclasses.replace."""
        other = object.__new__(Hypothesis)
        other.__dict__.update(self.__dict__)
        return other

    def watch(self, windows: Windows) -> None:
        """Begin all windows again, after those past."""
        self.windows, self.sums = windows, np.zeros((2, MASS_COLUMNS))
