"""
The parts of a robot and how far each may deviate from the robot file.

The payload estimator and the diagnosis take their prior of the arm from here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import exp

from flex_plant_sim.arm.file_section import PLAUSIBLE
from flex_plant_sim.arm.robot import Robot
from numpy.random import Generator

# Largest damping ratio of a link that a robot file may say.
MOST_DAMPING = PLAUSIBLE['damping_ratio'][1]
# Factor on the tolerance of a part that is not as its file says; twice that costs 0.7 nats.
FAR_PART_FACTOR = 10.0

Change = Callable[[Robot, float], Robot]


@dataclass(frozen=True)
class Part:
    """
    A parameter of the robot whose deviation from the file has a Gaussian prior around zero.

    Attributes
    ----------
    name : str
        For example stiffness_1.
    tolerance : float
        Standard deviation of the deviation.
    change : Callable
        (robot, deviation) -> robot with that deviation.
    unit : str
        Unit of the deviation; empty where it is the logarithm of true over nominal value.

    """

    name: str
    tolerance: float
    change: Change
    unit: str = ''


def within_file_limits(robot: Robot) -> Robot:
    """
    Return a robot whose links damp no more than a robot file may say.

    As a part's deviation is that of a logarithm, several tolerances may lead beyond.
    """
    upper, lower = (replace(link, damping_ratio=min(link.damping_ratio, MOST_DAMPING))
                    for link in robot.links)
    return replace(robot, links=(upper, lower))


def robot_parts(robot: Robot) -> tuple[Part, ...]:
    """
    Return the parts of the arm itself: links, gauge positions, drives, elbow and payload inertia.

    Parts without a tolerance are left out. For gains and biases of gauges see gauge_parts.
    """
    t = robot.tolerances
    found: list[Part] = []
    for j in (0, 1):
        found += [
            Part(f'stiffness_{j + 1}', t.stiffness, partial(_scale_link, j, 'youngs_modulus')),
            Part(f'damping_{j + 1}', t.damping, partial(_scale_link, j, 'damping_ratio')),
            Part(f'link_mass_{j + 1}', t.link_mass, partial(_scale_link, j, 'density')),
            Part(f'length_{j + 1}', t.length, partial(_scale_link, j, 'length')),
            *_gauge_position_parts(robot, j),
            Part(f'drive_inertia_{j + 1}', t.drive_inertia, partial(_scale_drive, j, 'inertia')),
            Part(f'drive_gain_{j + 1}', t.drive_gain, partial(_scale_drive, j, 'torque_gain')),
            Part(f'drive_damping_{j + 1}', t.drive_damping, partial(_scale_drive_damping, j))]
    found += [Part('elbow_mass', t.elbow_mass, partial(_scale_elbow, 'elbow_mass')),
              Part('elbow_inertia', t.elbow_inertia, partial(_scale_elbow, 'elbow_inertia')),
              Part('payload_inertia', t.payload_inertia_kg_m2, _shift_payload_inertia, 'kg m^2')]
    return tuple(part for part in found if part.tolerance > 0.0)


def drawn(robot: Robot, random: Generator) -> Robot:
    """Return an arm whose parts deviate at random by their tolerances."""
    for part in robot_parts(robot):
        robot = part.change(robot, part.tolerance * float(random.standard_normal()))
    # The payload is nominally a point, so its inertia has an absolute tolerance and the drawn
    # value may be negative, which no inertia is.
    return replace(robot, payload_inertia=abs(robot.payload_inertia))


def _shift_payload_inertia(r: Robot, v: float) -> Robot:
    # A negative inertia makes the mass matrix of a light link indefinite; the arm then diverges.
    return replace(r, payload_inertia=max(r.payload_inertia + v, 0.0))


def _scale_elbow(name: str, r: Robot, v: float) -> Robot:
    return replace(r, **{name: getattr(r, name) * exp(v)})


def _scale_link(j: int, name: str, r: Robot, v: float) -> Robot:
    return r.with_link(j, **{name: getattr(r.links[j], name) * exp(v)})


def _gauge_position_parts(robot: Robot, j: int) -> list[Part]:
    first = 0 if j == 0 else len(robot.links[0].gauge_positions)
    return [Part(f'position_{name}', robot.tolerances.gauge_position_m,
                 partial(_shift_gauge, j, k), 'm')
            for k, name in enumerate(robot.gauge_names[first:][:len(
                robot.links[j].gauge_positions)])]


def _shift_gauge(j: int, k: int, r: Robot, v: float) -> Robot:
    positions = list(r.links[j].gauge_positions)
    positions[k] = min(max(positions[k] + v, 0.0), r.links[j].length)
    return r.with_link(j, gauge_positions=tuple(positions))


def _scale_drive(j: int, name: str, r: Robot, v: float) -> Robot:
    return r.with_drive(j, **{name: getattr(r.drives[j], name) * exp(v)})


def _scale_drive_damping(j: int, r: Robot, v: float) -> Robot:
    drive = r.drives[j]
    # In a closed velocity loop the torque gain changes with the damping: the steady gain stays.
    gain = drive.torque_gain * (exp(v) if drive.closed_loop else 1.0)
    return r.with_drive(j, damping=drive.damping * exp(v), torque_gain=gain)


def in_velocity_loop(robot: Robot, name: str, deviation: float) -> str:
    """
    Return what a robot file changes for a part of a drive, where no key of it has the name.

    A velocity loop is told by inertia, time constant and gain; the damping is the first over the
    second.
    """
    what, _, number = name.rpartition('_')
    if what not in ('drive_damping', 'drive_inertia') \
            or not robot.drives[int(number) - 1].closed_loop:
        return ''
    if what == 'drive_damping':
        return f'time_constant_s times {exp(-deviation):.3g}'
    return f'inertia_kg_m2 and time_constant_s times {exp(deviation):.3g}'


@dataclass(frozen=True)
class GaugePart:
    """
    A gauge's gain or bias, Gaussian around zero: at strain e it reads (1 + gain) e + bias.

    Attributes
    ----------
    kind : str
        'gain' or 'bias'.
    gauge : str
        For example strain_1a.
    tolerance : float
        Standard deviation; relative for a gain, in m/m for a bias.

    """

    kind: str
    gauge: str
    tolerance: float


def gauge_parts(robot: Robot) -> tuple[GaugePart, ...]:
    """Return the gains, then the biases, of all gauges."""
    t = robot.tolerances
    return tuple(GaugePart(kind, gauge, tolerance)
                 for kind, tolerance in (('gain', t.strain_gain), ('bias', t.strain_bias))
                 for gauge in robot.gauge_names)
