"""
Reference arm as a chain of rigid segments in MuJoCo: an independent truth, a speed baseline.

Each link is cut into `n` cells of length `h = L/n`. The bending compliance `h/EI` of a cell sits
in one hinge at its centre, so the rigid bodies are `h/2, h, …, h, h/2` long and the clamp needs
no half-stiff spring. This midpoint rule converges with `h²`. `flex_plant_sim` is not used.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
import xml.etree.ElementTree as ET

import mujoco
import numpy as np

CLAMPED_FREE_ROOT = 1.8751040687119611
MASSLESS_KG = 1e-7
BROKEN_STRAIN = 0.02


@dataclass(frozen=True)
class Link:
    """A uniform link: SI units; `gauges` are distances from the root in m."""

    length: float
    thickness: float
    height: float
    gauges: tuple[float, ...]
    youngs_modulus: float = 70e9
    density: float = 2700.0
    damping_ratio: float = 0.01

    @property
    def mass_per_length(self) -> float:
        """Return rho A in kg/m."""
        return self.density * self.thickness * self.height

    @property
    def bending_stiffness(self) -> float:
        """Return EI in N m²."""
        return self.youngs_modulus * self.height * self.thickness**3 / 12

    @property
    def retardation_time(self) -> float:
        """Return the Kelvin–Voigt time 2 zeta_1/omega_1 in s, omega_1 clamped–free."""
        wave_speed = np.sqrt(self.bending_stiffness / self.mass_per_length)
        omega_1 = (CLAMPED_FREE_ROOT / self.length) ** 2 * wave_speed
        return 2 * self.damping_ratio / omega_1


@dataclass(frozen=True)
class Arm:
    """
    The two-link arm and the mechanical extras that a hidden effect may switch on.

    Pairs are (joint 1, joint 2). A stiffness of None means rigid. Units: SI, rad.
    """

    links: tuple[Link, Link] = (
        Link(0.6, 0.003, 0.05, (0.03, 0.30)),
        Link(0.5, 0.0018, 0.05473, (0.025, 0.25)),
    )
    rotor_inertia: tuple[float, float] = (0.2, 0.05)
    time_constant: tuple[float, float] = (0.01, 0.01)
    gain: tuple[float, float] = (1.0, 1.0)
    elbow_mass: float = 0.6
    elbow_inertia: float = 6e-4
    payload_mass: float = 0.1
    payload_inertia: float = 0.0
    viscous_friction: tuple[float, float] = (0.0, 0.0)
    coulomb_friction: tuple[float, float] = (0.0, 0.0)
    gear_stiffness: tuple[float | None, float | None] = (None, None)
    gear_damping: tuple[float, float] = (0.0, 0.0)
    backlash: tuple[float, float] = (0.0, 0.0)
    clamp_stiffness: tuple[float | None, float | None] = (None, None)
    base_stiffness: float | None = None
    base_inertia: float = 0.5
    loose_stiffness: float | None = None
    loose_damping: float = 0.0
    hub_inertia: tuple[float, float] = (0.0, 0.0)
    air_density: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)

    @property
    def gravity(self) -> tuple[float, float, float]:
        """Return gravity in m/s², its in-plane part 9.81 sin(tilt) along x and along y."""
        along_x, along_y = 9.81 * np.sin(self.tilt)
        return along_x, along_y, 0.0


@dataclass(frozen=True)
class Chain:
    """A compiled MuJoCo model with the joint addresses and the strain map of its gauges."""

    model: mujoco.MjModel
    arm: Arm
    joint: np.ndarray
    hinges: np.ndarray
    strain_map: np.ndarray = field(repr=False)

    def strain(self, qpos: np.ndarray) -> np.ndarray:
        """Return surface strains (4,) in m/m for the positions `qpos`."""
        return self.strain_map @ qpos[self.hinges]


def _hinge(body: ET.Element, name: str, **attributes: object) -> None:
    """Add a hinge about z at the body's origin."""
    values = {
        key: (value if isinstance(value, str) else f'{value:.12g}')
        for key, value in attributes.items() if value is not None}
    ET.SubElement(body, 'joint', {'name': name, 'type': 'hinge', 'axis': '0 0 1', **values})


def _point(body: ET.Element, name: str, position: float, mass: float,
           inertia: float) -> ET.Element:
    """Add a rigidly held body with its centre `position` m along the parent."""
    child = ET.SubElement(body, 'body', name=name, pos=f'{position:.12g} 0 0')
    _inertial(child, max(mass, MASSLESS_KG), max(inertia, mass * 1e-9, 1e-12))
    return child


def _inertial(body: ET.Element, mass: float, inertia: float) -> None:
    """Give the body a mass at its origin."""
    ET.SubElement(body, 'inertial', pos='0 0 0', mass=f'{mass:.12g}',
                  diaginertia=' '.join([f'{inertia:.12g}'] * 3))


def _insert(body: ET.Element, name: str, **attributes: object) -> ET.Element:
    """Add a body that turns against `body` about the same axis; `body` gets a gram to move."""
    _inertial(body, 1e-3, 1e-6)
    child = ET.SubElement(body, 'body', name=name)
    _hinge(child, name, **attributes)
    return child


def _joint(body: ET.Element, arm: Arm, j: int, timestep: float) -> ET.Element:
    """
    Add the driven joint, then the gear and the clamp where they are not rigid.

    The integrator's implicit damping d acts like an inertia of d·timestep/2, which is taken off.
    """
    damping = arm.rotor_inertia[j] / arm.time_constant[j] + arm.viscous_friction[j]
    _hinge(body, f'joint_{j + 1}', damping=damping,
           armature=arm.rotor_inertia[j] - damping * timestep / 2,
           frictionloss=arm.coulomb_friction[j],
           solreffriction='0.002 1', solimpfriction='0.99 0.99 0.001')
    half, stiffness = arm.backlash[j] / 2, arm.clamp_stiffness[j]
    limits = {'range': f'{-half:.12g} {half:.12g}', 'limited': 'true', 'solreflimit': '0.001 1'}
    if arm.gear_stiffness[j] is not None or half > 0:
        body = _insert(body, f'gear_{j + 1}', stiffness=arm.gear_stiffness[j],
                       damping=arm.gear_damping[j], **(limits if half > 0 else {}))
    if stiffness is not None:
        body = _insert(body, f'clamp_{j + 1}', stiffness=stiffness,
                       damping=stiffness * arm.links[j].retardation_time)
    # A stop's stiffness grows with the inertia that hits it: a bare segment's stop would be soft.
    hub = max(arm.hub_inertia[j], 0.01 * arm.rotor_inertia[j] if half > 0 else 0.0)
    if hub > 0:
        _point(body, f'hub_{j + 1}', 0.0, MASSLESS_KG, hub)
    return body


def _link(root: ET.Element, link: Link, j: int, n: int) -> ET.Element:
    """Add the rigid pieces and hinges of link `j`; return its last piece (half a cell long)."""
    cell = link.length / n
    stiffness = link.bending_stiffness / cell
    body = root
    for i in range(n + 1):
        piece = cell / 2 if i in (0, n) else cell
        if i > 0:
            offset = cell / 2 if i == 1 else cell
            body = ET.SubElement(body, 'body', name=f'link_{j + 1}_{i}', pos=f'{offset:.12g} 0 0')
            _hinge(body, f'bend_{j + 1}_{i}', stiffness=stiffness,
                   damping=stiffness * link.retardation_time)
        ET.SubElement(body, 'geom', type='box', mass=f'{link.mass_per_length * piece:.12g}',
                      pos=f'{piece / 2:.12g} 0 0', contype='0', conaffinity='0',
                      size=f'{piece / 2:.12g} {link.thickness / 2:.12g} {link.height / 2:.12g}')
    return body


def _payload(tip: ET.Element, arm: Arm, position: float) -> None:
    """Add the payload at the tip, on a spring-held slide where it is loose."""
    if arm.loose_stiffness is not None:
        carrier = _point(tip, 'payload', position, arm.payload_mass, arm.payload_inertia)
        ET.SubElement(carrier, 'joint', name='loose', type='slide', axis='0 1 0',
                      stiffness=f'{arm.loose_stiffness:.12g}', damping=f'{arm.loose_damping:.12g}')
        return
    _point(tip, 'payload', position, arm.payload_mass, arm.payload_inertia)


def mjcf(arm: Arm, n: int, timestep: float) -> str:
    """Return the MJCF text of the arm with `n` cells a link and a step of `timestep` s."""
    root = ET.Element('mujoco', model='two_link_flexible_arm')
    ET.SubElement(root, 'compiler', angle='radian')
    gravity = ' '.join(f'{g:.12g}' for g in arm.gravity)
    option = ET.SubElement(root, 'option', timestep=f'{timestep:.12g}', gravity=gravity,
                           integrator='implicitfast', density=f'{arm.air_density:.12g}')
    ET.SubElement(option, 'flag', autoreset='disable')
    body = ET.SubElement(ET.SubElement(root, 'worldbody'), 'body', name='base')
    if arm.base_stiffness is not None:
        _hinge(body, 'base', stiffness=arm.base_stiffness, armature=arm.base_inertia,
               damping=0.02 * np.sqrt(arm.base_stiffness * arm.base_inertia))
        _inertial(body, 1e-3, 1e-6)
        body = ET.SubElement(body, 'body', name='upper_arm')
    tip = _link(_joint(body, arm, 0, timestep), arm.links[0], 0, n)
    cell = arm.links[0].length / n
    _point(tip, 'elbow', cell / 2, arm.elbow_mass, arm.elbow_inertia)
    fore = ET.SubElement(tip, 'body', name='forearm', pos=f'{cell / 2:.12g} 0 0')
    tip = _link(_joint(fore, arm, 1, timestep), arm.links[1], 1, n)
    _payload(tip, arm, arm.links[1].length / n / 2)
    actuator = ET.SubElement(root, 'actuator')
    for j in (0, 1):
        gear = arm.rotor_inertia[j] * arm.gain[j] / arm.time_constant[j]
        ET.SubElement(actuator, 'motor', joint=f'joint_{j + 1}', gear=f'{gear:.12g}')
    return ET.tostring(root, encoding='unicode')


def _strain_map(arm: Arm, n: int) -> np.ndarray:
    """Return (4, 2n): hinge angles to strain, curvature interpolated linearly between hinges."""
    rows = np.zeros((sum(len(link.gauges) for link in arm.links), 2 * n))
    row = 0
    for j, link in enumerate(arm.links):
        cell = link.length / n
        for gauge in link.gauges:
            i = int(np.clip(np.floor(gauge / cell - 0.5), 0, n - 2))
            share = gauge / cell - 0.5 - i
            scale = link.thickness / 2 / cell
            rows[row, j * n + i: j * n + i + 2] = scale * (1 - share), scale * share
            row += 1
    return rows


def build(arm: Arm, n_segments: int = 20, timestep: float = 5e-4) -> Chain:
    """Compile the chain with `n_segments` bending hinges a link."""
    model = mujoco.MjModel.from_xml_string(mjcf(arm, n_segments, timestep))
    bends = [f'bend_{j}_{i}' for j in (1, 2) for i in range(1, n_segments + 1)]
    return Chain(model, arm, np.array([model.joint(f'joint_{j}').qposadr[0] for j in (1, 2)]),
                 np.array([model.joint(name).qposadr[0] for name in bends]),
                 _strain_map(arm, n_segments))


Hook = Callable[[mujoco.MjModel, mujoco.MjData], None]


def run(chain: Chain, command: Callable[[int, np.ndarray, np.ndarray], np.ndarray], count: int,
        period: float, hook: Hook | None = None) -> tuple[np.ndarray, np.ndarray]:
    """
    Step the chain over `count` samples of `period` s.

    `command(k, joint, strain)` gets the true outputs sampled at `k·period` and returns what the
    drives get from then on, (2,). `hook(model, data)` runs before every sub-step.
    Returns joint angles (count, 2) in rad and strains (count, 4) in m/m.
    Raises FloatingPointError where the step is too long.
    """
    model, data = chain.model, mujoco.MjData(chain.model)
    substeps = round(period / model.opt.timestep)
    joint, strain = np.empty((count, 2)), np.empty((count, len(chain.strain_map)))
    for k in range(count):
        joint[k], strain[k] = data.qpos[chain.joint], chain.strain(data.qpos)
        if not np.abs(strain[k]).max() < BROKEN_STRAIN:
            raise FloatingPointError(f'unstable at {k * period:.2f} s: take more sub-steps')
        data.ctrl[:] = command(k, joint[k], strain[k])
        if hook is None:
            mujoco.mj_step(model, data, substeps)
            continue
        for _ in range(substeps):
            hook(model, data)
            mujoco.mj_step(model, data)
    return joint, strain


def simulate(arm: Arm, commands: np.ndarray, period: float, payload: float | None = None,
             n_segments: int = 20, substeps: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """
    Simulate from rest under `commands` (N, 2), each held for `period` s.

    Returns what is sampled before each row's command acts: joint angles (N, 2) rad, strain (N, 4).
    """
    carried = arm if payload is None else replace(arm, payload_mass=payload)
    chain = build(carried, n_segments, period / substeps)
    return run(chain, lambda k, *_: commands[k], len(commands), period)


def fit_percent(measured: np.ndarray, simulated: np.ndarray) -> np.ndarray:
    """Return 100 (1 - |e| / |y - mean y|) per column."""
    error = np.linalg.norm(measured - simulated, axis=0)
    return 100 * (1 - error / np.linalg.norm(measured - measured.mean(axis=0), axis=0))
