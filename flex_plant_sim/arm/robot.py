"""
The robot: links, drives and gauges, and the effects that a diagnosis added.

`robot_file` reads it from YAML; the arm models and everything after them are built from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
import math
from typing import Any

from flex_plant_sim.arm.beam import Beam
from flex_plant_sim.arm.drive import Drive
from msg_config.input_mapping import InputMapping

UNLIMITED = (-math.inf, math.inf)


@dataclass(frozen=True)
class Link:
    """
    A flexible link and its strain gauges.

    Attributes
    ----------
    length, thickness, height : float
        L, b (bending direction) and h, m.
    youngs_modulus, density : float
        E, Pa, and rho, kg/m^3.
    damping_ratio : float
        zeta of the first clamped-free mode; zeta_i = zeta omega_i / omega_1 (Kelvin-Voigt).
    hub_radius : float
        Distance from the joint axis to the clamp, m (0 in the paper).
    gauge_positions : tuple of float
        Distance from the clamp, m.

    """

    length: float
    thickness: float
    height: float
    youngs_modulus: float
    density: float
    damping_ratio: float
    hub_radius: float = 0.0
    gauge_positions: tuple[float, ...] = ()

    @property
    def mass_per_length(self) -> float:
        """Return rho a, kg/m, (36)."""
        return self.density * self.thickness * self.height

    @property
    def mass(self) -> float:
        """Return the link's mass, kg."""
        return self.mass_per_length * self.length

    @property
    def bending_stiffness(self) -> float:
        """Return E I, N m^2, (36)."""
        return self.youngs_modulus * self.thickness**3 * self.height / 12.0

    def beam(self, modes: int) -> Beam:
        """Return the clamped-free beam with its first modes."""
        return Beam.with_modes(self.length, self.mass_per_length, self.bending_stiffness, modes)


@dataclass(frozen=True)
class EffectSpec:
    """
    An effect as the robot file gives it.

    Attributes
    ----------
    name : str
        Identifier in the catalogue.
    site : str
        Where it acts, for example joint_2, link_1, strain_1a or arm.
    values : Mapping
        Parameter name (with its unit) to a number. A table has lists of numbers, and the name of
        its variable.

    """

    name: str
    site: str
    values: Mapping[str, Any]


@dataclass(frozen=True)
class Tolerances:
    """
    Standard deviations of the nominal parameters, relative unless the name has a unit.

    They say how far a healthy arm of this make may differ from its data sheet, and are the prior
    of the payload estimator and of the diagnosis. `strain_bias` is in m/m. The nominal payload
    inertia is what the robot file gives, 0 by default; the nominal bias of a gauge is 0, and so
    is that of joint 2's angle, `angle_zero_rad`. Joint 1's zero changes nothing in the plane.
    """

    stiffness: float = 0.03
    damping: float = 0.3
    link_mass: float = 0.01
    drive_inertia: float = 0.05
    drive_gain: float = 0.01
    drive_damping: float = 0.05
    elbow_mass: float = 0.02
    elbow_inertia: float = 0.05
    strain_gain: float = 0.01
    payload: float = 0.01
    length: float = 0.001
    gauge_position_m: float = 5e-4
    strain_bias: float = 1e-6
    angle_zero_rad: float = 0.005
    payload_inertia_kg_m2: float = 2e-4


@dataclass(frozen=True)
class Robot:
    """
    A two-link flexible robot.

    Attributes
    ----------
    name : str
    source : str
        Its file, which errors name; ignored when robots are compared.
    links : tuple of Link
        Upper, lower.
    drives : tuple of Drive
        Shoulder, elbow.
    elbow_mass, elbow_inertia : float
        m_h, kg, and J_h, kg m^2, of the elbow at the upper link's end.
    payload_mass, payload_inertia, payload_offset : float
        m_p, kg, its moment of inertia about its centre, kg m^2, and how far that is beyond the tip
        along the lower link, m.
    sample_time : float
        T, s.
    gauge_amplifier : float
        V per unit strain.
    angle_noise, strain_noise : float
        Standard deviations, rad and m/m.
    effects : tuple of EffectSpec
        Effects that a diagnosis added.
    tolerances : Tolerances
    angle_limits : tuple of tuple of float
        Least and largest angle of the joints, rad.
    inputs : InputMapping
        Names and units of the measurements as they come in.
    left_out : Mapping
        Defaults of the numbers that the file leaves out, by key; ignored when robots are compared.

    """

    name: str
    source: str = field(compare=False)
    links: tuple[Link, Link]
    drives: tuple[Drive, Drive]
    elbow_mass: float
    elbow_inertia: float
    payload_mass: float
    payload_inertia: float
    payload_offset: float
    sample_time: float
    gauge_amplifier: float
    angle_noise: float
    strain_noise: float
    effects: tuple[EffectSpec, ...] = ()
    tolerances: Tolerances = field(default_factory=Tolerances)
    angle_limits: tuple[tuple[float, float], tuple[float, float]] = (UNLIMITED, UNLIMITED)
    inputs: InputMapping = field(default_factory=InputMapping, hash=False)
    left_out: Mapping[str, float] = field(default_factory=dict, compare=False)

    @cached_property
    def gauge_names(self) -> tuple[str, ...]:
        """Return strain_1a, strain_1b, …; without a letter where a link has one gauge."""
        names = []
        for number, link in enumerate(self.links, start=1):
            count = len(link.gauge_positions)
            letters = [''] if count == 1 else [chr(ord('a') + k) for k in range(count)]
            names += [f'strain_{number}{letter}' for letter in letters]
        return tuple(names)

    @cached_property
    def output_names(self) -> tuple[str, ...]:
        """Return the measured channels: joint_1, joint_2 and the gauges."""
        return ('joint_1', 'joint_2', *self.gauge_names)

    @property
    def output_units(self) -> tuple[str, ...]:
        """Return the SI unit of every measured channel."""
        return ('rad', 'rad', *('m/m' for _ in self.gauge_names))

    @property
    def moved_mass(self) -> float:
        """Return the mass of elbow and links, kg."""
        return self.elbow_mass + sum(link.mass for link in self.links)

    def with_link(self, index: int, **changes: Any) -> Robot:
        """Return the robot with changes to one link (index 0 or 1)."""
        links = list(self.links)
        links[index] = replace(links[index], **changes)
        return replace(self, links=(links[0], links[1]))

    def with_drive(self, index: int, **changes: Any) -> Robot:
        """Return the robot with changes to one drive (index 0 or 1)."""
        drives = list(self.drives)
        drives[index] = replace(drives[index], **changes)
        return replace(self, drives=(drives[0], drives[1]))
