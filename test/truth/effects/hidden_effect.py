"""
A hidden effect: a physical change of the true arm, of a size that is drawn from a seed.

`severity` 1 draws a size that an engineer would call clear, 0.2 a distractor below any sensible
threshold, 0 the null. Each `draw` states its sizes; friction is given relative to the drive's own
viscous torque at 1 rad/s (20 and 5 N m on the reference robot).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from truth.configuration import Arm

Parameters = dict[str, float]
Draw = Callable[[np.random.Generator, Arm, float], Parameters]
Apply = Callable[[Arm, Parameters], Arm]


@dataclass(frozen=True)
class HiddenEffect:
    """An effect of the catalogue: how to draw its size and site, and how to build it in."""

    identifier: str
    draw: Draw
    apply: Apply


def either_sign(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a size between `low` and `high` with a random sign."""
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def any_joint(rng: np.random.Generator) -> int:
    """Return joint 1 or 2."""
    return int(rng.integers(1, 3))


def with_joint(arm: Arm, number: float, **changes: Any) -> Arm:
    """Return `arm` with joint `number` (1 or 2) changed."""
    joints = list(arm.joints)
    joints[int(number) - 1] = replace(joints[int(number) - 1], **changes)
    return replace(arm, joints=(joints[0], joints[1]))


def with_link(arm: Arm, number: float, **changes: Any) -> Arm:
    """Return `arm` with link `number` (1 or 2) changed."""
    links = list(arm.links)
    links[int(number) - 1] = replace(links[int(number) - 1], **changes)
    return replace(arm, links=(links[0], links[1]))


def with_sensor(arm: Arm, number: float, name: str, change: Callable[[float], float]) -> Arm:
    """Return `arm` with entry `number` (from 1) of the sensors' table `name` changed."""
    values = list(getattr(arm.sensors, name))
    values[int(number) - 1] = change(values[int(number) - 1])
    changes: dict[str, Any] = {name: tuple(values)}
    return replace(arm, sensors=replace(arm.sensors, **changes))


def tip_stiffness(arm: Arm, number: int) -> float:
    """Return 3 EI / L of link `number`, N m/rad: the scale for a compliance at its root."""
    link = arm.links[number - 1]
    return 3.0 * link.bending_stiffness / link.length


def compliant(stiffness: float, severity: float) -> float:
    """Return `stiffness / severity`: no compliance at severity 0."""
    return stiffness / severity if severity > 0.0 else float('inf')
