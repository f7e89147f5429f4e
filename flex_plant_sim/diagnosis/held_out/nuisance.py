"""Base parameters within their stated tolerances: re-estimated under every hypothesis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.arm.parts import robot_parts
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.effects import catalogue
from flex_plant_sim.effects.base import Effect
import numpy as np


@dataclass(frozen=True)
class Nuisance:
    """
    A base parameter with a Gaussian prior around its nominal value, in the logarithm.

    Attributes
    ----------
    name : str
    tolerance : float
        Standard deviation of the prior, relative.
    change : Callable
        (robot, deviation) -> robot; a positive parameter is multiplied by exp(deviation).
    effect : Callable or None
        deviation -> Effect, where the parameter is not the robot's.
    settles : bool
        Whether the robot is taken to have it, once estimated; a bias of a few noise widths and
        the payload are not the robot's.

    """

    name: str
    tolerance: float
    change: Callable[[Robot, float], Robot]
    effect: Callable[[float], Effect] | None = None
    settles: bool = True


def nuisances(robot: Robot, payload: float) -> tuple[Nuisance, ...]:
    """Return what a healthy robot of this make may differ in."""
    t = robot.tolerances
    found = [Nuisance(part.name, part.tolerance, part.change) for part in robot_parts(robot)]
    found += [_of_effect('strain_gain', gauge, t.strain_gain, 1.0, 1.0)
              for gauge in robot.gauge_names]
    found += [_of_effect('strain_bias', gauge, t.strain_bias, 0.0, 1.0, settles=False)
              for gauge in robot.gauge_names]
    found.append(_of_effect('payload_mass', 'arm', t.payload, 0.0, max(payload, 1e-3),
                            settles=False))
    return tuple(nuisance for nuisance in found if nuisance.tolerance > 0.0)


def settled(robot: Robot, items: Sequence[Nuisance], deviations: Array
            ) -> tuple[Robot, tuple[Effect, ...]]:
    """Return a robot with deviations (p,), and the effects that stand for the others of them."""
    effects = []
    for item, value in zip(items, deviations):
        if value == 0.0:
            continue
        if item.effect is not None:
            effects.append(item.effect(float(value)))
        else:
            robot = item.change(robot, float(value))
    return robot, tuple(effects)


def settled_base(base: Base, payload: float) -> Base:
    """Return the base with its deviations in the robot and the effects."""
    robot, effects = settled(base.robot, nuisances(base.robot, payload),
                             np.array(base.deviations))
    return replace(base, robot=robot, effects=(*base.effects, *effects), deviations=())


def _of_effect(identifier: str, site: str, tolerance: float, null: float, scale: float,
               settles: bool = True) -> Nuisance:
    return Nuisance(f'{identifier}:{site}', tolerance, lambda r, v: r,
                    lambda v: catalogue()[identifier](site, (null + scale * v,)), settles)
