"""The interface of every payload estimator: outputs and commands in, Estimate out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple, Protocol

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array

# A gap longer than this, s, loses the state. Chosen: a moment is predicted across by the last
# command, but within a second an arm may be stopped, moved or held.
LONGEST_GAP_S = 1.0


class Estimate(NamedTuple):
    """
    An estimator's answer after one sample.

    Attributes
    ----------
    time : float
        Time of the measurement, s.
    mass, variance : float
        Payload, kg, and the variance of its error, kg^2.
    p : float
        SF1's P (29), which is no variance; an estimator without P gives its own covariance.
    innovation, innovation_std : Array
        y - C x and its standard deviation per channel, rad and m/m, (m,).
    status : str
        'ok', 'not_excited', 'model_suspect' or 'input_rejected'; the node adds 'restarted'.

    """

    time: float
    mass: float
    variance: float
    p: float
    innovation: Array
    innovation_std: Array
    status: str = 'ok'


@dataclass(frozen=True)
class Event:
    """
    A change of the payload.

    Attributes
    ----------
    time, found : float
        When it happened, and when it was detected, s.
    before, after : float
        Payload, kg.

    """

    time: float
    found: float
    before: float
    after: float


class PayloadEstimator(Protocol):
    """
    Estimates the payload from (y_t, u_{t-1}); it keeps its state and is updated once a sample.

    Nodes and tools call nothing else.
    """

    @property
    def events(self) -> Sequence[Event]:
        """Return the payload changes found so far; none from an estimator that seeks none."""

    @property
    def takes_parts_as_told(self) -> bool:
        """Return whether the estimate and its variance hold only if all parts are as told."""

    @property
    def payload_max(self) -> float:
        """Return the largest payload that is looked for, kg."""

    def reset(self) -> None:
        """Go back to the start: forget state and payload."""

    def prepare(self, command: Array) -> None:
        """
        Predict while no measurement waits: `update` is then faster, with the same answer.

        Parameters
        ----------
        command : Array
            Command that will be applied up to the next sample, (2,).

        """

    def update(self, time: float, output: Array, command: Array) -> Estimate:
        """
        Return the estimate after the sample of a time.

        Parameters
        ----------
        time : float
            s.
        output : Array
            (theta_1, theta_2, strain…), rad and m/m, (m,).
        command : Array
            Applied up to this sample, (2,).

        """

    def conclude(self) -> None:
        """Do what the last estimate did not wait for; otherwise the next `update` does it."""


def is_finite(values: Array) -> bool:
    """Return whether all values are finite; for a few values a list is faster than NumPy."""
    return all(map(math.isfinite, values.tolist()))


def within_range(mass: float, variance: float, payload_max: float) -> tuple[float, float]:
    """
    Return a payload, kg, and its variance, kg^2, of which it is known to be in a range.

    A mean over models may be outside the range, and the bound is nearer. No variance is larger
    than that about the estimate of a payload that may be anywhere on the range.
    """
    mass, middle = min(max(mass, 0.0), payload_max), 0.5 * payload_max
    return mass, min(variance, (mass - middle)**2 + middle**2 / 3.0)


def largest_payload(robot: Robot, told: float | None) -> float:
    """
    Return the largest payload, kg: as told, or four lower links and twice the file's.

    The file says what the arm is to carry; a wider range makes the start longer, and what walks
    or jumps less certain.
    """
    return float(told or 4.0 * robot.links[1].mass + 2.0 * robot.payload_mass)
