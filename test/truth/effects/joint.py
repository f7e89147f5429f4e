"""Hidden effects of joints and gears."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truth.configuration import Arm
from truth.effects.hidden_effect import (
    any_joint,
    compliant,
    HiddenEffect,
    Parameters,
    tip_stiffness,
    with_joint,
)


def viscous_scale(arm: Arm, joint: int) -> float:
    """Return the drive's viscous coefficient, N m s/rad."""
    return arm.joints[joint - 1].damping


def with_friction(arm: Arm, joint: float, forward: float, backward: float) -> Arm:
    """Return `arm` with more dry friction, N m, on top of what the joint has."""
    now = arm.joints[int(joint) - 1]
    return with_joint(arm, joint, coulomb_forward=now.coulomb_forward + forward,
                      coulomb_backward=now.coulomb_backward + backward)


def draw_coulomb(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 6-11 % of the drive's viscous torque at 1 rad/s (0.43 N m at joint 2 is 8.7 %)."""
    joint = any_joint(rng)
    return {'joint': joint,
            'torque': severity * viscous_scale(arm, joint) * rng.uniform(0.06, 0.11)}


def apply_coulomb(arm: Arm, size: Parameters) -> Arm:
    """Add dry friction, N m, equal in both directions."""
    return with_friction(arm, size['joint'], size['torque'], size['torque'])


def draw_viscous(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 25-50 % of the drive's own viscous coefficient, N m s/rad."""
    joint = any_joint(rng)
    return {'joint': joint,
            'coefficient': severity * viscous_scale(arm, joint) * rng.uniform(0.25, 0.5)}


def apply_viscous(arm: Arm, size: Parameters) -> Arm:
    """Add viscous friction in the joint."""
    return with_joint(arm, size['joint'], viscous=size['coefficient'])


def draw_asymmetric(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a mean of 5-9 % as for Coulomb friction, one way 50-80 % more, the other less."""
    joint = any_joint(rng)
    mean = severity * viscous_scale(arm, joint) * rng.uniform(0.05, 0.09)
    skew = rng.uniform(0.5, 0.8) * rng.choice([-1.0, 1.0])
    return {'joint': joint, 'forward': mean * (1.0 + skew), 'backward': mean * (1.0 - skew)}


def apply_asymmetric(arm: Arm, size: Parameters) -> Arm:
    """Add dry friction that differs by direction, N m."""
    return with_friction(arm, size['joint'], size['forward'], size['backward'])


def draw_stribeck(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw sliding friction of 3-5 %, at rest 2-3 times more, falling over 0.1-0.25 rad/s."""
    joint = any_joint(rng)
    sliding = severity * viscous_scale(arm, joint) * rng.uniform(0.03, 0.05)
    return {'joint': joint, 'sliding': sliding, 'extra': sliding * rng.uniform(1.5, 2.5),
            'speed': rng.uniform(0.1, 0.25)}


def apply_stribeck(arm: Arm, size: Parameters) -> Arm:
    """Add dry friction, N m, that is larger by `extra` at rest than in sliding."""
    rubbing = with_friction(arm, size['joint'], size['sliding'], size['sliding'])
    return with_joint(rubbing, size['joint'], stribeck=size['extra'],
                      stribeck_speed=size['speed'])


def draw_backlash(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a whole gap of 0.012-0.03 rad (0.7-1.7 degrees)."""
    return {'joint': any_joint(rng), 'gap': severity * rng.uniform(0.012, 0.03)}


def apply_backlash(arm: Arm, size: Parameters) -> Arm:
    """Add a gap, rad, with contact between the rotor and the link; the sensor is link-side."""
    if size['gap'] == 0.0:
        return arm
    # Impacts are short and need a finer step than the smooth arm.
    return with_joint(replace(arm, step=0.5 * arm.step), size['joint'], backlash=size['gap'])


def draw_gear_compliance(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 4-8 times the link's own stiffness 3 EI / L, N m/rad."""
    joint = any_joint(rng)
    stiffness = tip_stiffness(arm, joint) * rng.uniform(4.0, 8.0)
    return {'joint': joint, 'stiffness': compliant(stiffness, severity)}


def apply_gear_compliance(arm: Arm, size: Parameters) -> Arm:
    """Add a torsion spring between rotor and link; the sensor is link-side."""
    return with_joint(arm, size['joint'], gear_stiffness=size['stiffness'])


def draw_torque_ripple(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 7-13 % of the drive's viscous torque at 1 rad/s, 15-40 waves per radian."""
    joint = any_joint(rng)
    return {'joint': joint, 'order': rng.uniform(15.0, 40.0), 'phase': rng.uniform(0.0, 6.28),
            'torque': severity * viscous_scale(arm, joint) * rng.uniform(0.07, 0.13)}


def apply_torque_ripple(arm: Arm, size: Parameters) -> Arm:
    """Add a torque that varies as the sine of the joint's angle."""
    return with_joint(arm, size['joint'], ripple=size['torque'], ripple_order=size['order'],
                      ripple_phase=size['phase'])


def draw_presliding(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw friction as for Coulomb's that builds up over 3-10 mrad."""
    joint = any_joint(rng)
    return {'joint': joint, 'travel': rng.uniform(0.003, 0.01),
            'torque': severity * viscous_scale(arm, joint) * rng.uniform(0.06, 0.11)}


def apply_presliding(arm: Arm, size: Parameters) -> Arm:
    """Add dry friction that gives before it slides."""
    rubbing = with_friction(arm, size['joint'], size['torque'], size['torque'])
    return with_joint(rubbing, size['joint'], presliding=size['travel'])


def draw_spring(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 20-40 % of the drive's viscous torque at 1 rad/s, a radian; loose near straight."""
    joint = any_joint(rng)
    return {'joint': joint, 'rest': rng.uniform(-0.3, 0.3),
            'stiffness': severity * viscous_scale(arm, joint) * rng.uniform(0.2, 0.4)}


def apply_spring(arm: Arm, size: Parameters) -> Arm:
    """Let a cable or a hose pull the joint, N m/rad, to its rest angle, rad."""
    return with_joint(arm, size['joint'], spring=size['stiffness'], spring_rest=size['rest'])


EFFECTS = (
    HiddenEffect('coulomb_friction', draw_coulomb, apply_coulomb),
    HiddenEffect('viscous_friction', draw_viscous, apply_viscous),
    HiddenEffect('asymmetric_friction', draw_asymmetric, apply_asymmetric),
    HiddenEffect('stribeck_friction', draw_stribeck, apply_stribeck),
    HiddenEffect('presliding_friction', draw_presliding, apply_presliding),
    HiddenEffect('backlash', draw_backlash, apply_backlash),
    HiddenEffect('gear_compliance', draw_gear_compliance, apply_gear_compliance),
    HiddenEffect('torque_ripple', draw_torque_ripple, apply_torque_ripple),
    HiddenEffect('joint_spring', draw_spring, apply_spring),
)
