"""A sample as the nodes take it, and the command that acted since the one before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from msg_config.messages import seconds
import numpy as np


@dataclass(frozen=True)
class StampedSample:
    """
    The measurements of one stamp.

    Attributes
    ----------
    stamp : int
        ns.
    output : Array
        (theta_1, theta_2, strain…), rad and m/m, (m,); NaN where the sample was refused.
    command : Array
        Command applied up to this stamp, (2,): the mean since the sample before.
    velocity : Array
        Of the joints, rad/s, (2,); NaN where joint_states has none.
    commands : int
        How many sampling intervals the mean of `command` is of.

    """

    stamp: int
    output: Array
    command: Array
    velocity: Array
    commands: int = 1

    @property
    def time(self) -> float:
        """Return the stamp in s."""
        return seconds(self.stamp)


def same_output(one: Array, other: Array) -> bool:
    """Return whether two outputs are the same, with NaN in the same places."""
    return np.array_equal(one, other, equal_nan=True)


def mean_command(passed: Sequence[Array], last: Array) -> Array:
    """
    Return the mean of the commands since the sample before, (2,).

    Parameters
    ----------
    passed : sequence of Array
        Those of the joint states that make no sample, because the other topic is slower, (2,).
    last : Array
        That of the sample itself, (2,).

    """
    return np.mean([*passed, last], axis=0) if passed else last
