"""Hidden effects of angle sensors and strain gauges; strain sizes suit signals of 1e-4 m/m."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truth.configuration import Arm
from truth.effects.hidden_effect import (
    any_joint,
    either_sign,
    HiddenEffect,
    Parameters,
    with_sensor,
)


def any_gauge(rng: np.random.Generator, arm: Arm) -> int:
    """Return a gauge's number, from 1."""
    return int(rng.integers(1, len(arm.sensors.strain_gain) + 1))


def draw_angle_gain(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a change of 3-7 % either way."""
    return {'joint': any_joint(rng), 'factor': 1.0 + severity * either_sign(rng, 0.03, 0.07)}


def apply_angle_gain(arm: Arm, size: Parameters) -> Arm:
    """Multiply the reading of an angle sensor."""
    return with_sensor(arm, size['joint'], 'angle_gain', lambda x: x * size['factor'])


def draw_angle_offset(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 0.1-0.2 rad at joint 2; in the horizontal plane joint 1's zero means nothing."""
    return {'joint': 2, 'offset': severity * either_sign(rng, 0.1, 0.2)}


def apply_angle_offset(arm: Arm, size: Parameters) -> Arm:
    """Add a constant, rad, to the reading of an angle sensor."""
    return with_sensor(arm, size['joint'], 'angle_offset', lambda x: x + size['offset'])


def draw_angle_delay(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 0.012-0.03 s for one angle in the log; the controller reads it at once."""
    return {'joint': any_joint(rng), 'delay': severity * rng.uniform(0.012, 0.03)}


def apply_angle_delay(arm: Arm, size: Parameters) -> Arm:
    """Log the reading of an angle sensor late."""
    return with_sensor(arm, size['joint'], 'angle_delay', lambda x: x + size['delay'])


def draw_strain_bias(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 1e-5 to 3e-5 m/m either way."""
    return {'gauge': any_gauge(rng, arm), 'bias': severity * either_sign(rng, 1e-5, 3e-5)}


def apply_strain_bias(arm: Arm, size: Parameters) -> Arm:
    """Add a constant to a gauge."""
    return with_sensor(arm, size['gauge'], 'strain_bias', lambda x: x + size['bias'])


def draw_strain_drift(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 5e-7 to 1.5e-6 m/m per second either way (20e-6 to 60e-6 over 40 s)."""
    return {'gauge': any_gauge(rng, arm), 'rate': severity * either_sign(rng, 5e-7, 1.5e-6)}


def apply_strain_drift(arm: Arm, size: Parameters) -> Arm:
    """Let a gauge drift steadily."""
    return with_sensor(arm, size['gauge'], 'strain_drift', lambda x: x + size['rate'])


def draw_strain_gain(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a change of 6-12 % either way, of one gauge."""
    return {'gauge': any_gauge(rng, arm),
            'factor': 1.0 + severity * either_sign(rng, 0.06, 0.12)}


def apply_strain_gain(arm: Arm, size: Parameters) -> Arm:
    """Multiply the reading of a gauge."""
    return with_sensor(arm, size['gauge'], 'strain_gain', lambda x: x * size['factor'])


def draw_crosstalk(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a share of 8-18 % of a gauge of the other link (one of its own is a gain)."""
    upper = len(arm.links[0].gauges)
    to_gauge = any_gauge(rng, arm)
    other = (range(upper + 1, len(arm.sensors.strain_gain) + 1) if to_gauge <= upper
             else range(1, upper + 1))
    return {'from_gauge': int(rng.choice(list(other))), 'to_gauge': to_gauge,
            'share': severity * either_sign(rng, 0.08, 0.18)}


def apply_crosstalk(arm: Arm, size: Parameters) -> Arm:
    """Let one gauge's amplifier pick up another's signal."""
    return replace(arm, sensors=replace(
        arm.sensors, crosstalk=size['share'], crosstalk_from=int(size['from_gauge']) - 1,
        crosstalk_to=int(size['to_gauge']) - 1))


def draw_strain_filter(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a cut-off of 20-40 rad/s (divided by the severity), damping ratio 0.7-0.9."""
    cutoff = rng.uniform(20.0, 40.0)
    return {'cutoff': cutoff / severity if severity > 0.0 else 0.0,
            'damping': rng.uniform(0.7, 0.9)}


def apply_strain_filter(arm: Arm, size: Parameters) -> Arm:
    """Put a second-order low pass into all strain amplifiers (cut-off 0: none)."""
    return replace(arm, sensors=replace(arm.sensors, filter_cutoff=size['cutoff'],
                                        filter_damping=size['damping']))


def draw_strain_delay(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw 0.012-0.03 s for all gauges."""
    return {'delay': severity * rng.uniform(0.012, 0.03)}


def apply_strain_delay(arm: Arm, size: Parameters) -> Arm:
    """Delay all strain readings."""
    return replace(arm, sensors=replace(arm.sensors, strain_delay=size['delay']))


EFFECTS = (
    HiddenEffect('angle_gain', draw_angle_gain, apply_angle_gain),
    HiddenEffect('angle_offset', draw_angle_offset, apply_angle_offset),
    HiddenEffect('strain_bias', draw_strain_bias, apply_strain_bias),
    HiddenEffect('strain_drift', draw_strain_drift, apply_strain_drift),
    HiddenEffect('strain_gain', draw_strain_gain, apply_strain_gain),
    HiddenEffect('strain_crosstalk', draw_crosstalk, apply_crosstalk),
    HiddenEffect('strain_filter', draw_strain_filter, apply_strain_filter),
    HiddenEffect('strain_delay', draw_strain_delay, apply_strain_delay),
    HiddenEffect('angle_delay', draw_angle_delay, apply_angle_delay),
)
