"""Assembly: from the parts of an arm to the arrays that `integrator.py` runs on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from truth.beam_elements import Array
from truth.component_modes import ComponentModes, link_modes
from truth.configuration import Arm, GRAVITY, Joint, Link
from truth.equations import LinkTerms, mass_and_bias

# Terms of a link that add up when bodies are joined.
EXTENSIVE = ('moments', 'a', 'b', 'mass', 'shortening', 'centrifugal', 'stiffness', 'damping',
             'point_mass', 'point_stiffness')


@dataclass(frozen=True)
class System:
    """
    Arrays of an arm with a given payload: N coordinates, the last one the base if it moves.

    `lower_empty` and `payload_unit` combine to the lower link's terms at a mass; `twist` holds
    each joint's (coordinate or -1, stiffness N m/rad, damping N m s/rad, half gap rad).
    """

    upper: LinkTerms
    lower_empty: LinkTerms
    payload_unit: LinkTerms
    constant_mass: Array
    gravity: Array
    twist: Array
    base: Array
    curvature: Array
    drag: Array

    @property
    def size(self) -> int:
        """Number of coordinates N."""
        return self.constant_mass.shape[0]


def twists(joint: Joint) -> bool:
    """Return whether the gear needs a coordinate of its own, by backlash or compliance."""
    return joint.backlash > 0.0 or bool(np.isfinite(joint.gear_stiffness))


def bare_terms(modes: ComponentModes, link: Link, extra: int = 0) -> LinkTerms:
    """Return the link's own terms, padded with `extra` coordinates that do not move it."""
    def vector(x: Array) -> Array:
        return np.pad(x, (0, extra))

    def matrix(x: Array) -> Array:
        return np.pad(x, ((0, extra), (0, extra)))

    def rows(order: int, tip: Array) -> Array:
        return np.pad(np.vstack([modes.point_rows[order], tip]), ((0, 0), (0, extra)))

    return LinkTerms(
        moments=np.array([modes.mass, modes.first_moment, modes.second_moment]),
        a=vector(modes.a), b=vector(modes.b), mass=matrix(modes.mass_matrix),
        shortening=matrix(modes.shortening), centrifugal=matrix(modes.centrifugal),
        stiffness=matrix(modes.stiffness), damping=matrix(modes.damping),
        point_mass=np.append(link.mass_per_length * modes.point_weight, 0.0),
        point_stiffness=np.append(link.bending_stiffness * modes.point_weight, 0.0),
        point_rows=rows(0, modes.tip), point_slope=rows(1, modes.tip_slope),
        point_curvature=rows(2, np.zeros(modes.size)),
        point_shortening=np.array([
            matrix(x) for x in (*modes.point_shortening, modes.tip_shortening)]),
        tip=vector(modes.tip), tip_slope=vector(modes.tip_slope),
        tip_shortening=matrix(modes.tip_shortening), tip_arm=link.hub_radius + link.length)


def tip_body(terms: LinkTerms, mass: float, inertia: float, tip: Array | None = None,
             ) -> LinkTerms:
    """Return the terms of a body at the tip alone; `tip` (n,) if it moves against the link."""
    phi = terms.tip if tip is None else tip
    slope, shortening, arm = terms.tip_slope, terms.tip_shortening, terms.tip_arm
    none = np.zeros_like(shortening)
    return terms._replace(
        moments=np.array([mass, mass * arm, mass * arm**2 + inertia]), a=mass * phi,
        b=mass * arm * phi + inertia * slope,
        mass=mass * np.outer(phi, phi) + inertia * np.outer(slope, slope),
        shortening=mass * shortening, centrifugal=mass * (np.outer(phi, phi) - arm * shortening),
        stiffness=none, damping=none, point_mass=mass * np.eye(terms.point_mass.size)[-1],
        point_stiffness=np.zeros_like(terms.point_stiffness))


def reaching(terms: LinkTerms, beyond: float) -> LinkTerms:
    """Return the terms with a rigid end that reaches `beyond` m past the tip."""
    slope = terms.tip_slope
    return terms._replace(
        tip=terms.tip + beyond * slope, tip_arm=terms.tip_arm + beyond,
        tip_shortening=terms.tip_shortening + beyond * np.outer(slope, slope))


def add_terms(first: LinkTerms, second: LinkTerms, share: float = 1.0) -> LinkTerms:
    """Return `first + share second` for all extensive terms; the geometry is that of `first`."""
    total: dict[str, Any] = {
        name: getattr(first, name) + share * getattr(second, name) for name in EXTENSIVE}
    return first._replace(**total)


def lower_terms(arm: Arm, modes: ComponentModes) -> tuple[LinkTerms, LinkTerms]:
    """Return the lower link without payload, and the payload's terms per kilogram."""
    payload = arm.payload
    loose = payload.loose_frequency > 0.0
    terms = bare_terms(modes, arm.links[1], int(loose))
    slope = terms.tip_slope
    tip = terms.tip + payload.beyond_tip * slope
    terms.point_rows[-1] = tip
    terms.point_shortening[-1] += payload.beyond_tip * np.outer(slope, slope)
    if loose:
        tip[-1] = terms.point_rows[-1, -1] = 1.0
        terms.stiffness[-1, -1] = payload.mass * payload.loose_frequency**2
        terms.damping[-1, -1] = (2.0 * payload.loose_damping_ratio * payload.mass
                                 * payload.loose_frequency)
    gyration = payload.inertia / payload.mass if payload.mass > 0.0 else 0.0
    return terms, tip_body(reaching(terms, payload.beyond_tip), 1.0, gyration, tip)


def gear_table(arm: Arm, coordinates: list[int]) -> Array:
    """Return rows (2, 4): coordinate, stiffness, damping, half gap of each gear."""
    table = np.full((2, 4), -1.0)
    for row, joint, coordinate in zip(table, arm.joints, coordinates):
        if twists(joint):
            stiffness = joint.gear_stiffness
            if not np.isfinite(stiffness):
                stiffness = joint.contact_stiffness * joint.inertia
            damping = 0.2 * np.sqrt(stiffness * joint.output_share * joint.inertia)
            row[:] = coordinate, stiffness, damping, 0.5 * joint.backlash
    return table


def rotor_mass(arm: Arm, size: int, twist: Array) -> Array:
    """Return the constant mass matrix (size, size): rotors, gear outputs, base, kg m^2."""
    mass = np.zeros((size, size))
    for j, joint in enumerate(arm.joints):
        mass[j, j] = joint.inertia
        if twist[j, 0] >= 0:
            k, output = int(twist[j, 0]), joint.output_share * joint.inertia
            mass[j, k] = mass[k, j] = mass[k, k] = output
    if np.isfinite(arm.structure.base_stiffness):
        mass[-1, -1] = arm.structure.base_inertia
    return mass


def assemble(arm: Arm) -> System:
    """Return the arrays of `arm`; the upper basis sees the lower link's weight at its tip."""
    links, structure = arm.links, arm.structure
    beam_2 = links[1].mass_per_length * links[1].length
    modes = [
        link_modes(links[0], arm.shapes[0], structure.elbow_mass + beam_2 + arm.payload.mass,
                   structure.elbow_inertia, twists(arm.joints[0])),
        link_modes(links[1], arm.shapes[1], max(arm.payload.mass, 0.02),
                   arm.payload.mass * arm.payload.beyond_tip**2, twists(arm.joints[1]))]
    upper = bare_terms(modes[0], links[0])
    upper = add_terms(upper, tip_body(upper, structure.elbow_mass, structure.elbow_inertia))
    lower, unit = lower_terms(arm, modes[1])
    n1, n2 = upper.a.size, lower.a.size
    moves = bool(np.isfinite(structure.base_stiffness))
    twist = gear_table(arm, [1 + n1, 1 + n1 + modes[1].size])
    curvature = np.zeros((sum(len(link.gauges) for link in links), 2 + n1 + n2 + moves))
    split = len(links[0].gauges)
    curvature[:split, 2:2 + n1] = modes[0].curvature
    curvature[split:, 2 + n1:2 + n1 + modes[1].size] = modes[1].curvature
    surface = np.repeat([0.5 * link.thickness for link in links],
                        [len(link.gauges) for link in links])
    base = np.array([structure.base_stiffness if moves else 0.0, structure.base_damping])
    return System(
        upper, lower, unit, rotor_mass(arm, 2 + n1 + n2 + moves, twist),
        GRAVITY * np.sin(np.array([structure.tilt_x, structure.tilt_y])),
        twist, base, curvature * surface[:, None], drag_table(arm, modes))


def drag_table(arm: Arm, modes: list[ComponentModes]) -> Array:
    """Return (2, points, 2 + n): weight times coefficient, arm and shape rows of each link."""
    width = 2 + max(m.size for m in modes)
    table = np.zeros((2, modes[0].point_arm.size, width))
    for block, m in zip(table, modes):
        block[:, 0] = arm.structure.air_drag * m.point_weight
        block[:, 1] = m.point_arm
        block[:, 2:2 + m.size] = m.point_rows[0]
    return table


def locked_frequencies(arm: Arm, theta_2: float) -> Array:
    """Return the natural frequencies, rad/s, of the reduced arm with both rotors held."""
    system = assemble(arm)
    lower = add_terms(system.lower_empty, system.payload_unit, arm.payload.mass)
    p = np.zeros(system.size)
    p[1] = theta_2
    mass = mass_and_bias(p, 0.0 * p, np.zeros(2), system.upper, lower, system.constant_mass)[0]
    n1, n = system.upper.a.size, system.size
    stiffness = np.zeros((n, n))
    stiffness[2:2 + n1, 2:2 + n1] = system.upper.stiffness
    stiffness[2 + n1:, 2 + n1:] = lower.stiffness
    squares = np.linalg.eigvals(np.linalg.solve(mass[2:, 2:], stiffness[2:, 2:]))
    return np.sqrt(np.sort(squares.real))
