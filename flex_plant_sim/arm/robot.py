"""A robot: what its YAML file says, validated, with units in the key names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
import math
from pathlib import Path
from typing import Any

from flex_plant_sim.arm.beam import Beam
from flex_plant_sim.arm.drive import Drive
from msg_config.errors import InputError
import yaml

LINKS = ('upper', 'lower')
JOINTS = ('shoulder', 'elbow')


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
        Joint axis to clamp, m (0 in the paper).
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
    An effect as the robot file names it.

    Attributes
    ----------
    name : str
        Identifier in the catalogue.
    site : str
        Where it acts, for example joint_2, link_1, strain_1a or arm.
    values : Mapping
        Parameter name (with its unit) to value.

    """

    name: str
    site: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class Tolerances:
    """
    Standard deviations of the nominal parameters, relative unless a unit is named.

    What a healthy arm of this make may differ from its data sheet: the prior of the payload
    estimator and of the diagnosis. Of a payload's inertia and a gauge's bias (strain, m/m) the
    file says what is known; they are zero there otherwise.
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
    payload_inertia_kg_m2: float = 5e-5


@dataclass(frozen=True)
class Robot:
    """
    A two-link flexible robot.

    Attributes
    ----------
    name : str
    links : tuple of Link
        Upper, lower.
    drives : tuple of Drive
        Shoulder, elbow.
    elbow_mass, elbow_inertia : float
        m_h, kg, and J_h, kg m^2, at the upper link's end.
    payload_mass, payload_inertia : float
        m_p, kg, and its moment of inertia about the tip, kg m^2.
    sample_time : float
        T, s.
    gauge_amplifier : float
        V per unit strain.
    angle_noise, strain_noise : float
        Standard deviations, rad and m/m.
    effects : tuple of EffectSpec
        What a diagnosis added.
    tolerances : Tolerances

    """

    name: str
    links: tuple[Link, Link]
    drives: tuple[Drive, Drive]
    elbow_mass: float
    elbow_inertia: float
    payload_mass: float
    payload_inertia: float
    sample_time: float
    gauge_amplifier: float
    angle_noise: float
    strain_noise: float
    effects: tuple[EffectSpec, ...] = ()
    tolerances: Tolerances = field(default_factory=Tolerances)

    @property
    def gauge_names(self) -> tuple[str, ...]:
        """Return strain_1a, strain_1b, …; without a letter where a link has one gauge."""
        names = []
        for number, link in enumerate(self.links, start=1):
            count = len(link.gauge_positions)
            letters = [''] if count == 1 else [chr(ord('a') + k) for k in range(count)]
            names += [f'strain_{number}{letter}' for letter in letters]
        return tuple(names)

    @property
    def output_names(self) -> tuple[str, ...]:
        """Return the measured channels: joint_1, joint_2 and the gauges."""
        return ('joint_1', 'joint_2', *self.gauge_names)

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


class _Section:
    """One mapping of the file; takes keys out and complains by their full name."""

    def __init__(self, source: str, path: str, data: Any):
        if not isinstance(data, dict):
            raise InputError(f'{source}: {path or "file"}: expected a mapping, got {data!r}')
        self.source, self.path, self.data = source, path, dict(data)

    def name(self, key: str) -> str:
        return f'{self.source}: {self.path}.{key}' if self.path else f'{self.source}: {key}'

    def take(self, key: str, default: Any = None) -> Any:
        if key not in self.data and default is None:
            raise InputError(f'{self.name(key)}: expected a value, the key is missing')
        return self.data.pop(key, default)

    def section(self, key: str, default: Any = None) -> _Section:
        path = f'{self.path}.{key}' if self.path else key
        return _Section(self.source, path, self.take(key, default))

    def number(self, key: str, low: float = 0.0, default: float | None = None,
               strict: bool = True) -> float:
        return self._checked(key, self.take(key, default), low, strict)

    def numbers(self, key: str, low: float, high: float) -> tuple[float, ...]:
        values = self.take(key)
        if not isinstance(values, list):
            raise InputError(f'{self.name(key)}: expected a list of numbers, got {values!r}')
        checked = tuple(self._checked(key, value, low, False) for value in values)
        if any(value > high for value in checked):
            raise InputError(f'{self.name(key)}: expected at most {high:g}, got {max(checked):g}')
        return checked

    def _checked(self, key: str, value: Any, low: float, strict: bool) -> float:
        bad = isinstance(value, bool) or not isinstance(value, (int, float))
        if bad or not math.isfinite(value) or value < low or (strict and value == low):
            sign = '>' if strict else '>='
            raise InputError(f'{self.name(key)}: expected a number {sign} {low:g}, got {value!r}')
        return float(value)

    def close(self) -> None:
        if self.data:
            raise InputError(f'{self.name(sorted(map(str, self.data))[0])}: unknown key')


def _link(section: _Section) -> Link:
    length = section.number('length_m')
    link = Link(length, section.number('thickness_m'), section.number('height_m'),
                section.number('youngs_modulus_pa'), section.number('density_kg_per_m3'),
                section.number('damping_ratio', strict=False),
                section.number('hub_radius_m', default=0.0, strict=False),
                section.numbers('gauge_positions_m', 0.0, length))
    section.close()
    return link


def _drive(section: _Section) -> Drive:
    kind = section.take('kind')
    inertia = section.number('inertia_kg_m2')
    limit = section.number('command_limit', default=math.inf) \
        if 'command_limit' in section.data else math.inf
    if kind == 'velocity_loop':
        drive = Drive.velocity_loop(inertia, section.number('time_constant_s'),
                                    section.number('gain_rad_per_s'), limit)
    elif kind == 'current':
        drive = Drive(inertia, section.number('torque_constant_n_m_per_a'),
                      section.number('damping_n_m_s', strict=False), limit)
    else:
        raise InputError(f'{section.name("kind")}: expected velocity_loop or current, '
                         f'got {kind!r}')
    section.close()
    return drive


def _effects(source: str, items: Any) -> tuple[EffectSpec, ...]:
    if not isinstance(items, list):
        raise InputError(f'{source}: effects: expected a list, got {items!r}')
    specs = []
    for index, item in enumerate(items):
        section = _Section(source, f'effects[{index}]', item)
        name, site = str(section.take('name')), str(section.take('site', 'arm'))
        values = {str(key): section.number(key, -math.inf) for key in list(section.data)}
        specs.append(EffectSpec(name, site, values))
    return tuple(specs)


def _tolerances(section: _Section) -> Tolerances:
    values = {key: section.number(key, strict=False) for key in list(section.data)
              if key in Tolerances.__dataclass_fields__}
    section.close()
    return Tolerances(**values)


def parse_robot(text: str, source: str) -> Robot:
    """
    Return the robot that a YAML text describes.

    Raises
    ------
    InputError
        Naming source and key, what was expected and what came.

    """
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        line = ' '.join(str(error).split())
        raise InputError(f'{source}: expected YAML, got: {line}') from None
    top = _Section(source, '', data)
    links, drives = top.section('links'), top.section('drives')
    elbow, payload = top.section('elbow'), top.section('payload')
    measurement = top.section('measurement')
    robot = Robot(
        name=str(top.take('name')),
        links=(_link(links.section('upper')), _link(links.section('lower'))),
        drives=(_drive(drives.section('shoulder')), _drive(drives.section('elbow'))),
        elbow_mass=elbow.number('mass_kg', strict=False),
        elbow_inertia=elbow.number('inertia_kg_m2', strict=False),
        payload_mass=payload.number('mass_kg', strict=False),
        payload_inertia=payload.number('inertia_kg_m2', default=0.0, strict=False),
        sample_time=measurement.number('sample_time_s'),
        gauge_amplifier=measurement.number('gauge_amplifier_v_per_strain', default=1.0),
        angle_noise=measurement.number('angle_noise_rad'),
        strain_noise=measurement.number('strain_noise'),
        effects=_effects(source, top.take('effects', [])),
        tolerances=_tolerances(top.section('tolerances', {})))
    for section in (links, drives, elbow, payload, measurement, top):
        section.close()
    return robot


def built_in_robots() -> tuple[str, ...]:
    """Return the names of the robots that ship with the package."""
    folder = resources.files('flex_plant_sim') / 'robots'
    return tuple(sorted(item.name[:-5] for item in folder.iterdir()
                        if item.name.endswith('.yaml')))


def load_robot(name_or_file: str | Path) -> Robot:
    """
    Return a built-in robot by name, or the robot of a YAML file.

    Raises
    ------
    InputError
        Where neither exists, or the file is not a valid robot.

    """
    name = str(name_or_file)
    if name in built_in_robots():
        text = (resources.files('flex_plant_sim') / 'robots' / f'{name}.yaml').read_text()
        return parse_robot(text, f'{name}.yaml')
    path = Path(name)
    if not path.is_file():
        raise InputError(f'robot: expected one of {", ".join(built_in_robots())} or a YAML '
                         f'file, got {name!r}')
    try:
        return parse_robot(path.read_text(encoding='utf-8'), name)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'{name}: expected a readable text file, got: {error}') from None
