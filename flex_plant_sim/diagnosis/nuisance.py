"""Base parameters within their stated tolerances: re-estimated under every hypothesis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import exp

from flex_plant_sim.arm_model import Array
from flex_plant_sim.effects import catalogue
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.robot import Robot


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
    found: list[Nuisance] = []
    for j in (0, 1):
        found += _of_link(robot, j) + _of_drive(robot, j)
    t = robot.tolerances
    found += [
        Nuisance('elbow_mass', t.elbow_mass,
                 lambda r, v: replace(r, elbow_mass=r.elbow_mass * exp(v))),
        Nuisance('elbow_inertia', t.elbow_inertia,
                 lambda r, v: replace(r, elbow_inertia=r.elbow_inertia * exp(v)))]
    found += [_of_effect('strain_gain', gauge, t.strain_gain, 1.0, 1.0)
              for gauge in robot.gauge_names]
    found += [_of_effect('strain_bias', gauge, 1.0, 0.0, robot.strain_noise, settles=False)
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


def _of_link(robot: Robot, j: int) -> list[Nuisance]:
    t, number = robot.tolerances, j + 1
    return [
        Nuisance(f'stiffness_{number}', t.stiffness, lambda r, v: r.with_link(
            j, youngs_modulus=r.links[j].youngs_modulus * exp(v))),
        Nuisance(f'damping_{number}', t.damping, lambda r, v: r.with_link(
            j, damping_ratio=r.links[j].damping_ratio * exp(v))),
        Nuisance(f'link_mass_{number}', t.link_mass, lambda r, v: r.with_link(
            j, density=r.links[j].density * exp(v)))]


def _of_drive(robot: Robot, j: int) -> list[Nuisance]:
    t, number = robot.tolerances, j + 1

    def damping(r: Robot, v: float) -> Robot:
        drive = r.drives[j]
        gain = drive.torque_gain * (exp(v) if drive.closed_loop else 1.0)
        return r.with_drive(j, damping=drive.damping * exp(v), torque_gain=gain)

    return [
        Nuisance(f'drive_inertia_{number}', t.drive_inertia, lambda r, v: r.with_drive(
            j, inertia=r.drives[j].inertia * exp(v))),
        Nuisance(f'drive_gain_{number}', t.drive_gain, lambda r, v: r.with_drive(
            j, torque_gain=r.drives[j].torque_gain * exp(v))),
        Nuisance(f'drive_damping_{number}', t.drive_damping, damping)]


def _of_effect(identifier: str, site: str, tolerance: float, null: float, scale: float,
               settles: bool = True) -> Nuisance:
    return Nuisance(f'{identifier}:{site}', tolerance, lambda r, v: r,
                    lambda v: catalogue()[identifier](site, (null + scale * v,)), settles)
