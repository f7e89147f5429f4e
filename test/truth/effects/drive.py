"""Hidden effects of drives and timing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truth.configuration import Arm
from truth.effects.hidden_effect import (
    any_joint,
    either_sign,
    HiddenEffect,
    Parameters,
    with_joint,
)


def draw_gain(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a change of 6-12 % either way."""
    return {'joint': any_joint(rng), 'factor': 1.0 + severity * either_sign(rng, 0.06, 0.12)}


def apply_gain(arm: Arm, size: Parameters) -> Arm:
    """Multiply the torque per command unit."""
    gain = arm.joints[int(size['joint']) - 1].torque_gain
    return with_joint(arm, size['joint'], torque_gain=gain * size['factor'])


def draw_bias(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 0.02-0.05 command units either way."""
    return {'joint': any_joint(rng), 'bias': severity * either_sign(rng, 0.02, 0.05)}


def apply_bias(arm: Arm, size: Parameters) -> Arm:
    """Add a constant to the command inside the drive."""
    return with_joint(arm, size['joint'], bias=size['bias'])


def draw_dead_zone(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a half width of 0.03-0.07 command units."""
    return {'joint': any_joint(rng), 'half_width': severity * rng.uniform(0.03, 0.07)}


def apply_dead_zone(arm: Arm, size: Parameters) -> Arm:
    """Let the drive ignore small commands; larger ones lose the half width."""
    return with_joint(arm, size['joint'], dead_zone=size['half_width'])


def draw_saturation(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 0.3-0.45 command units: commands reach 0.8 (divided by the severity)."""
    limit = rng.uniform(0.3, 0.45)
    return {'joint': any_joint(rng),
            'limit': limit / severity if severity > 0.0 else float('inf')}


def apply_saturation(arm: Arm, size: Parameters) -> Arm:
    """Limit the command inside the drive; the log holds the command as sent."""
    return with_joint(arm, size['joint'], saturation=size['limit'])


def draw_motor_lag(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a time constant of 0.025-0.05 s."""
    return {'joint': any_joint(rng), 'time_constant': severity * rng.uniform(0.025, 0.05)}


def apply_motor_lag(arm: Arm, size: Parameters) -> Arm:
    """Put a first-order lag between command and torque."""
    return with_joint(arm, size['joint'], lag=size['time_constant'])


def draw_input_delay(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 0.015-0.035 s for both joints, no multiple of the sample time."""
    return {'delay': severity * rng.uniform(0.015, 0.035)}


def apply_input_delay(arm: Arm, size: Parameters) -> Arm:
    """Delay all commands."""
    return replace(arm, input_delay=size['delay'])


def draw_bandwidth(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a velocity loop 1.5-2.5 times as slow or as fast."""
    factor = rng.uniform(1.5, 2.5) ** rng.choice([-1.0, 1.0])
    return {'joint': any_joint(rng), 'factor': float(factor**severity)}


def apply_bandwidth(arm: Arm, size: Parameters) -> Arm:
    """Multiply the loop's time constant; its steady gain stays."""
    joint = arm.joints[int(size['joint']) - 1]
    return with_joint(arm, size['joint'], torque_gain=joint.torque_gain / size['factor'],
                      damping=joint.damping / size['factor'])


def draw_integral(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw an integral time of 0.1-0.3 s (divided by the severity)."""
    return {'joint': any_joint(rng), 'rate': severity / rng.uniform(0.1, 0.3)}


def apply_integral(arm: Arm, size: Parameters) -> Arm:
    """Give the velocity loop an integrator."""
    return with_joint(arm, size['joint'], integral_rate=size['rate'])


EFFECTS = (
    HiddenEffect('actuator_gain', draw_gain, apply_gain),
    HiddenEffect('actuator_bias', draw_bias, apply_bias),
    HiddenEffect('actuator_dead_zone', draw_dead_zone, apply_dead_zone),
    HiddenEffect('actuator_saturation', draw_saturation, apply_saturation),
    HiddenEffect('motor_lag', draw_motor_lag, apply_motor_lag),
    HiddenEffect('input_delay', draw_input_delay, apply_input_delay),
    HiddenEffect('drive_bandwidth', draw_bandwidth, apply_bandwidth),
    HiddenEffect('drive_integral', draw_integral, apply_integral),
)
