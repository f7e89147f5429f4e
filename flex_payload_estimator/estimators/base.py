"""The interface of every payload estimator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from flex_plant_sim.arm.second_order import Array


class Estimate(NamedTuple):
    """
    What an estimator says after one sample.

    Attributes
    ----------
    time : float
        Of the measurement, s.
    mass, variance : float
        Payload, kg, and the variance of its error, kg^2.
    p : float
        SF1's P (29), which is no variance; where an estimator has none, its own covariance.
    innovation, innovation_std : Array
        y - C x and its standard deviation per channel, rad and strain, (m,).
    status : str
        'ok', 'not_excited', 'model_suspect' or 'input_rejected'.

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
        When it was, and when it was noticed, s.
    before, after : float
        kg.

    """

    time: float
    found: float
    before: float
    after: float


class PayloadEstimator(Protocol):
    """
    Estimates the payload from (y_t, u_{t-1}); state is kept inside, one update a sample.

    All that nodes and tools call is here. Attributes: `rejected`, samples that were none.
    """

    rejected: int

    @property
    def events(self) -> Sequence[Event]:
        """Return the payload changes found so far; none where nobody looks for them."""

    def reset(self) -> None:
        """Forget everything."""

    def prepare(self, command: Array) -> None:
        """
        Predict while no measurement waits: `update` is then quicker, its answer the same.

        Parameters
        ----------
        command : Array
            What will have been applied up to the next sample, (2,).

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
        """Do what the last estimate need not wait for; otherwise the next `update` does."""
