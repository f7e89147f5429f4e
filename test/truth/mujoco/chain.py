"""
The arm as a chain of rigid segments: its MJCF text, and addresses in the compiled model.

Each link is cut into `n` cells of length `h = L/n`. The bending compliance `h/EI` of a cell sits
in one hinge at its centre, so the rigid bodies are `h/2, h, …, h, h/2` long and the clamp needs
no half-stiff spring. This midpoint rule converges with `h²`.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
import xml.etree.ElementTree as ET

import mujoco
import numpy as np

from truth.beam_elements import Array
from truth.configuration import Arm, GRAVITY, Link

# Mass and inertia that stand for none, because MuJoCo needs some.
MASSLESS_KG, MASSLESS_KG_M2 = 1e-3, 1e-6
# Cells per link.
CELLS = 20
# Hard ends of a gap are the constraint solver's: its shortest time constant is two steps.
HARD_END = '0.001 1'
# Contacts per inertia, 1/s^2, below which the ends are soft: `drives.soft_end` has their law.
SOFT_CONTACT = 3e4


@dataclass(frozen=True)
class Chain:
    """A compiled chain: addresses of joints, gears and hinges, and strain over the hinges."""

    model: mujoco.MjModel
    joint: tuple[int, int]
    gear: tuple[int, int]
    hinges: Array
    strain_map: Array


def build(arm: Arm, timestep: float, cells: int = CELLS) -> Chain:
    """Compile the chain with `cells` bending hinges a link and steps of `timestep` s."""
    model = mujoco.MjModel.from_xml_string(mjcf(arm, timestep, cells))
    bends = [f'bend_{j}_{i}' for j in (1, 2) for i in range(1, cells + 1)]
    return Chain(model, (_address(model, 'joint_1'), _address(model, 'joint_2')),
                 (_address(model, 'gear_1'), _address(model, 'gear_2')),
                 np.array([_address(model, name) for name in bends]), strain_map(arm, cells))


def _address(model: mujoco.MjModel, name: str) -> int:
    """Return where a joint's angle stands in qpos and its rate in qvel; -1 without it."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    return int(model.jnt_qposadr[number]) if number >= 0 else -1


def twists(arm: Arm, j: int) -> bool:
    """Return whether the gear gives way between a rotor and its link."""
    return arm.joints[j].backlash > 0.0 or math.isfinite(arm.joints[j].gear_stiffness)


def mjcf(arm: Arm, timestep: float, cells: int) -> str:
    """Return the MJCF text of the arm."""
    root = ET.Element('mujoco', model='two_link_flexible_arm')
    ET.SubElement(root, 'compiler', angle='radian')
    tilt = GRAVITY * np.sin([arm.structure.tilt_x, arm.structure.tilt_y])
    # The air's force on a side is density area v^2 / 2: twice the truth's coefficient a height.
    density = 2.0 * arm.structure.air_drag / arm.links[0].height
    option = ET.SubElement(root, 'option', timestep=_text(timestep), integrator='implicitfast',
                           gravity=_text(*tilt, 0.0), density=_text(density))
    ET.SubElement(option, 'flag', autoreset='disable')
    body = _base(ET.SubElement(ET.SubElement(root, 'worldbody'), 'body', name='base'), arm)
    tip = _link(body, arm, 0, timestep, cells)
    end = 0.5 * arm.links[0].length / cells
    _point(tip, 'elbow', end, arm.structure.elbow_mass, arm.structure.elbow_inertia)
    fore = ET.SubElement(tip, 'body', name='forearm', pos=_text(end, 0, 0))
    if arm.structure.hose_stiffness > 0.0:
        _hose(root, arm, tip, fore, end)
    tip = _link(fore, arm, 1, timestep, cells)
    _payload(tip, arm, 0.5 * arm.links[1].length / cells + arm.payload.beyond_tip)
    for j in (0, 1):
        if twists(arm, j):
            _gear_output(root, arm, j)
    return ET.tostring(root, encoding='unicode')


def _text(*numbers: float) -> str:
    return ' '.join(f'{number:.12g}' for number in numbers)


def _joint(body: ET.Element, name: str, **attributes: float | str) -> None:
    """Add a hinge about z at the body's origin; a `type` and an `axis` make it a slide."""
    values = {'type': 'hinge', 'axis': '0 0 1', **{
        key: value if isinstance(value, str) else _text(value)
        for key, value in attributes.items()}}
    ET.SubElement(body, 'joint', {'name': name, **values})


def _inertial(body: ET.Element, mass: float, inertia: float) -> None:
    ET.SubElement(body, 'inertial', pos='0 0 0', mass=_text(mass),
                  diaginertia=_text(inertia, inertia, inertia))


def _point(body: ET.Element, name: str, position: float, mass: float, inertia: float,
           beside: float = 0.0) -> ET.Element:
    """Add a rigidly held body, centred `position` m along the parent and `beside` m beside it."""
    child = ET.SubElement(body, 'body', name=name, pos=_text(position, beside, 0))
    _inertial(child, max(mass, 1e-7), max(inertia, mass * 1e-9, 1e-12))
    # The air sees this speck. Without it, it sees a box with the body's inertia, and one that has
    # hardly a mass, as where all of the payload is loose, is a sail of 77 m.
    ET.SubElement(child, 'geom', type='sphere', size='1e-6', fluidshape='ellipsoid', mass='0',
                  contype='0', conaffinity='0')
    return child


def _base(body: ET.Element, arm: Arm) -> ET.Element:
    """Let the base turn or slide where its mounting gives way; return what carries the arm."""
    structure = arm.structure
    slides = math.isfinite(structure.slide_stiffness)
    if not slides and not math.isfinite(structure.base_stiffness):
        return body
    for name, axis in (('slide_x', '1 0 0'), ('slide_y', '0 1 0')) if slides else ():
        _joint(body, name, type='slide', axis=axis, stiffness=structure.slide_stiffness,
               damping=structure.slide_damping, armature=structure.base_mass)
    if math.isfinite(structure.base_stiffness):
        _joint(body, 'base', stiffness=structure.base_stiffness,
               armature=structure.base_inertia, damping=structure.base_damping)
    _inertial(body, MASSLESS_KG, MASSLESS_KG_M2)
    return ET.SubElement(body, 'body', name='upper_arm')


def _driven(body: ET.Element, arm: Arm, j: int, timestep: float) -> ET.Element:
    """
    Add the rotor and, where something gives way, the gear; return what carries the clamp.

    The integrator's implicit damping d acts like an inertia of d·timestep/2, which is taken off.
    """
    joint, number = arm.joints[j], j + 1
    damping = joint.viscous + (0.0 if joint.lag_inside else joint.damping)
    rotor = joint.inertia * (1.0 - joint.output_share * twists(arm, j))
    _joint(body, f'joint_{number}', damping=damping, armature=rotor - 0.5 * damping * timestep,
           frictionloss=0.0, solreffriction='0.002 1', solimpfriction='0.99 0.99 0.001')
    if not twists(arm, j):
        return body
    _inertial(body, MASSLESS_KG, MASSLESS_KG_M2)
    body, half = ET.SubElement(body, 'body', name=f'gear_{number}'), 0.5 * joint.backlash
    if half == 0.0:
        damping = 0.2 * math.sqrt(joint.gear_stiffness * joint.output_share * joint.inertia)
        _joint(body, f'gear_{number}', stiffness=joint.gear_stiffness, damping=damping)
    elif joint.contact_stiffness < SOFT_CONTACT:
        _joint(body, f'gear_{number}')
    else:
        _joint(body, f'gear_{number}', range=_text(-half, half), limited='true',
               solreflimit=HARD_END, solimplimit='0.95 0.99 0.0005')
    return body


def _tendons(root: ET.Element) -> ET.Element:
    found = root.find('tendon')
    return ET.SubElement(root, 'tendon') if found is None else found


def _hose(root: ET.Element, arm: Arm, tip: ET.Element, forearm: ET.Element, end: float) -> None:
    """Span the elbow with a spring between two points, one on each link."""
    structure, reach = arm.structure, arm.structure.hose_reach
    ET.SubElement(tip, 'site', name='hose_1', pos=_text(end, reach, 0))
    ET.SubElement(forearm, 'site', name='hose_2', pos=_text(reach, 0, 0))
    spring = ET.SubElement(
        _tendons(root), 'spatial', name='hose', stiffness=_text(structure.hose_stiffness),
        springlength=_text(2.0 * reach * math.sin(math.pi / 4.0 - 0.5 * structure.hose_rest)))
    for site in ('hose_1', 'hose_2'):
        ET.SubElement(spring, 'site', site=site)


def _gear_output(root: ET.Element, arm: Arm, j: int) -> None:
    """Add the inertia behind a gear: it turns with rotor and twist, against the stator."""
    fixed = ET.SubElement(_tendons(root), 'fixed', name=f'output_{j + 1}', armature=_text(
        arm.joints[j].output_share * arm.joints[j].inertia))
    for name in (f'joint_{j + 1}', f'gear_{j + 1}'):
        ET.SubElement(fixed, 'joint', joint=name, coef='1')


def _link(body: ET.Element, arm: Arm, j: int, timestep: float, cells: int) -> ET.Element:
    """Add the drive, the clamp and the link's rigid pieces; return the last, half a cell long."""
    link, start = arm.links[j], arm.links[j].hub_radius
    retardation = 2.0 * link.damping_ratio / link.first_frequency
    body = _driven(body, arm, j, timestep)
    if math.isfinite(link.clamp_stiffness):
        _inertial(body, MASSLESS_KG, MASSLESS_KG_M2)
        body = ET.SubElement(body, 'body', name=f'clamp_{j + 1}', pos=_text(start, 0, 0))
        _joint(body, f'clamp_{j + 1}', stiffness=link.clamp_stiffness,
               damping=link.clamp_stiffness * retardation)
        start = 0.0
    return _pieces(body, link, j, cells, start)


def _pieces(body: ET.Element, link: Link, j: int, cells: int, start: float) -> ET.Element:
    cell = link.length / cells
    stiffness = link.bending_stiffness / cell
    damping = stiffness * 2.0 * link.damping_ratio / link.first_frequency
    for i in range(cells + 1):
        length = 0.5 * cell if i in (0, cells) else cell
        if i > 0:
            offset = start + 0.5 * cell if i == 1 else cell
            body = ET.SubElement(body, 'body', name=f'link_{j + 1}_{i}', pos=_text(offset, 0, 0))
            _joint(body, f'bend_{j + 1}_{i}', stiffness=stiffness, damping=damping)
        centre = 0.5 * length + (start if i == 0 else 0.0)
        ET.SubElement(body, 'geom', type='box', mass=_text(link.mass_per_length * length),
                      pos=_text(centre, 0, 0), contype='0', conaffinity='0',
                      size=_text(0.5 * length, 0.5 * link.thickness, 0.5 * link.height))
    return body


def _payload(tip: ET.Element, arm: Arm, position: float) -> None:
    """Add the payload at the tip, a share of it on a spring-held slide where it is loose."""
    payload = arm.payload
    held = payload.mass * (1.0 - payload.loose_share * (payload.loose_frequency > 0.0))
    _point(tip, 'payload', position, held, payload.inertia, payload.beside_tip)
    if payload.loose_frequency == 0.0:
        return
    mass = payload.mass - held
    loose = _point(tip, 'loose', position, mass, 0.0, payload.beside_tip)
    _joint(loose, 'loose', type='slide', axis='0 1 0', stiffness=mass * payload.loose_frequency**2,
           damping=2.0 * payload.loose_damping_ratio * mass * payload.loose_frequency)


def strain_map(arm: Arm, cells: int) -> Array:
    """Return (gauges, 2 cells): hinge angles to strain, curvature linear between hinges."""
    rows = []
    for j, link in enumerate(arm.links):
        cell = link.length / cells
        for gauge in link.gauges:
            i = int(np.clip(np.floor(gauge / cell - 0.5), 0, cells - 2))
            share = gauge / cell - 0.5 - i
            row = np.zeros(2 * cells)
            row[j * cells + i:j * cells + i + 2] = 1.0 - share, share
            rows.append(0.5 * link.thickness / cell * row)
    return np.array(rows)
