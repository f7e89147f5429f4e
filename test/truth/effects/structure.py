"""Hidden effects of links, elbow, base and surroundings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truth.configuration import Arm
from truth.effects.hidden_effect import (
    any_joint,
    compliant,
    either_sign,
    HiddenEffect,
    Parameters,
    tip_stiffness,
    with_link,
)

# Smallest share of a link's stiffness that is left by a change.
LEAST_LEFT = 0.2


def draw_link_stiffness(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a change of 12-25 % either way, of one link's EI; some is always left."""
    link, change = any_joint(rng), severity * either_sign(rng, 0.12, 0.25)
    return {'link': link, 'factor': max(1.0 + change, LEAST_LEFT)}


def apply_link_stiffness(arm: Arm, size: Parameters) -> Arm:
    """Multiply Young's modulus; the dashpots E eta of the material stay."""
    link = arm.links[int(size['link']) - 1]
    # zeta = eta omega_1 / 2 with eta E kept: zeta falls as the square root of E rises.
    return with_link(arm, size['link'], youngs_modulus=link.youngs_modulus * size['factor'],
                     damping_ratio=link.damping_ratio / size['factor'] ** 0.5)


def draw_modal_damping(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 2.5 to 4 times the damping, of one link."""
    return {'link': any_joint(rng), 'factor': 1.0 + severity * rng.uniform(1.5, 3.0)}


def apply_modal_damping(arm: Arm, size: Parameters) -> Arm:
    """Multiply the material's damping."""
    link = arm.links[int(size['link']) - 1]
    return with_link(arm, size['link'], damping_ratio=link.damping_ratio * size['factor'])


def draw_air_drag(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 0.3-0.6 N s^2/m^3 per length of link (a plate of 0.2-0.5 m across the motion)."""
    return {'coefficient': severity * rng.uniform(0.3, 0.6)}


def apply_air_drag(arm: Arm, size: Parameters) -> Arm:
    """Add drag that grows with the square of the local speed, along both links."""
    return replace(arm, structure=replace(arm.structure, air_drag=size['coefficient']))


def draw_clamp(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 4-8 times the link's own stiffness 3 EI / L, N m/rad."""
    link = any_joint(rng)
    stiffness = tip_stiffness(arm, link) * rng.uniform(4.0, 8.0)
    return {'link': link, 'stiffness': compliant(stiffness, severity)}


def apply_clamp(arm: Arm, size: Parameters) -> Arm:
    """Let the beam's root turn against the hub; the joint sensor sits on the hub."""
    return with_link(arm, size['link'], clamp_stiffness=size['stiffness'])


def draw_tilt(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a tilt of 0.02-0.05 rad about any horizontal axis."""
    tilt, heading = severity * rng.uniform(0.02, 0.05), rng.uniform(0.0, 6.28)
    return {'tilt_x': tilt * np.cos(heading), 'tilt_y': tilt * np.sin(heading)}


def apply_tilt(arm: Arm, size: Parameters) -> Arm:
    """Let gravity act in the plane of motion with g sin(tilt)."""
    return replace(arm, structure=replace(arm.structure, tilt_x=size['tilt_x'],
                                          tilt_y=size['tilt_y']))


def draw_base(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a mounting of 8-20 times the upper link's 3 EI / L, swinging at 40-80 rad/s."""
    stiffness = compliant(tip_stiffness(arm, 1) * rng.uniform(8.0, 20.0), severity)
    frequency = rng.uniform(40.0, 80.0)
    return {'stiffness': stiffness, 'frequency': frequency, 'damping_ratio': 0.05}


def apply_base(arm: Arm, size: Parameters) -> Arm:
    """Let the base turn on a spring; `frequency` rad/s is that of the bare base."""
    stiffness, frequency = size['stiffness'], size['frequency']
    if not np.isfinite(stiffness):
        return arm
    return replace(arm, structure=replace(
        arm.structure, base_stiffness=stiffness, base_inertia=stiffness / frequency**2,
        base_damping=2.0 * size['damping_ratio'] * stiffness / frequency))


def draw_slide(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a mounting of 8-20 times the upper link's 3 EI / L^3, shifting at 15-30 rad/s."""
    link = arm.links[0]
    stiffness = (tip_stiffness(arm, 1) / (link.length + link.hub_radius)**2
                 * rng.uniform(8.0, 20.0))
    return {'stiffness': compliant(stiffness, severity), 'damping_ratio': 0.05,
            'mass': stiffness / rng.uniform(15.0, 30.0)**2}


def apply_slide(arm: Arm, size: Parameters) -> Arm:
    """Let the base shift both ways on springs; it has `mass` kg."""
    if not np.isfinite(size['stiffness']):
        return arm
    return replace(arm, structure=replace(
        arm.structure, slide_stiffness=size['stiffness'], base_mass=size['mass'],
        slide_damping=2.0 * size['damping_ratio'] * np.sqrt(size['stiffness'] * size['mass'])))


def draw_fast_motion(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw moves 1.7 to 2.2 times as far, in the same time."""
    return {'factor': 1.0 + severity * rng.uniform(0.7, 1.2)}


def apply_fast_motion(arm: Arm, size: Parameters) -> Arm:
    """Move far and fast, so that the velocity terms (always in the truth) matter."""
    plan, factor = arm.excitation, size['factor']
    return replace(
        arm, command_limit=(arm.command_limit[0] * factor, arm.command_limit[1] * factor),
        excitation=replace(plan, stride=(plan.stride[0] * factor, plan.stride[1] * factor),
                           reach=(plan.reach[0] * factor, plan.reach[1] * factor)))


def draw_sharp_motion(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw set-points that rise in 1/10 to 1/30 of the usual time."""
    return {'factor': 1.0 / (1.0 + severity * rng.uniform(9.0, 29.0))}


def apply_sharp_motion(arm: Arm, size: Parameters) -> Arm:
    """Move in jerks, so that high modes (always in the truth) matter."""
    plan, factor = arm.excitation, size['factor']
    return replace(arm, excitation=replace(
        plan, rise=(plan.rise[0] * factor, plan.rise[1] * factor)))


def draw_hub_inertia(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 10-25 % of the lower link's and payload's inertia about the elbow, kg m^2."""
    link = arm.links[1]
    reach = link.hub_radius + link.length
    scale = (link.mass_per_length * link.length / 3.0 + arm.payload.mass) * reach**2
    return {'inertia': severity * scale * rng.uniform(0.1, 0.25)}


def apply_hub_inertia(arm: Arm, size: Parameters) -> Arm:
    """Add rotary inertia at the elbow."""
    return replace(arm, structure=replace(
        arm.structure, elbow_inertia=arm.structure.elbow_inertia + size['inertia']))


EFFECTS = (
    HiddenEffect('link_stiffness', draw_link_stiffness, apply_link_stiffness),
    HiddenEffect('modal_damping', draw_modal_damping, apply_modal_damping),
    HiddenEffect('air_drag', draw_air_drag, apply_air_drag),
    HiddenEffect('clamp_compliance', draw_clamp, apply_clamp),
    HiddenEffect('base_tilt', draw_tilt, apply_tilt),
    HiddenEffect('base_compliance', draw_base, apply_base),
    HiddenEffect('base_sliding', draw_slide, apply_slide),
    HiddenEffect('coriolis_centripetal', draw_fast_motion, apply_fast_motion),
    HiddenEffect('modal_truncation', draw_sharp_motion, apply_sharp_motion),
    HiddenEffect('hub_inertia', draw_hub_inertia, apply_hub_inertia),
)
