"""Hidden effects of the payload."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truth.configuration import Arm, Payload
from truth.effects.hidden_effect import HiddenEffect, Parameters

# How a payload changes, by number.
DROP, PICK, RAMP = range(3)
# Smallest share of a payload that is left by a change.
LEAST_LEFT = 0.1


def draw_mass(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a true payload 25-45 % away from what the operator believes; some is always left."""
    deviation = severity * rng.uniform(0.25, 0.45) * rng.choice([-1.0, 1.0])
    return {'factor': max(1.0 + deviation, LEAST_LEFT)}


def apply_mass(arm: Arm, size: Parameters) -> Arm:
    """Change nothing: the case already carries the true mass beside the told one."""
    return arm


def draw_inertia(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a radius of gyration of 0.35-0.5 of the lower link's reach; inertia in kg m^2."""
    link = arm.links[1]
    gyration = rng.uniform(0.35, 0.5) * (link.length + link.hub_radius)
    return {'inertia': severity * arm.payload.mass * gyration**2}


def apply_inertia(arm: Arm, size: Parameters) -> Arm:
    """Carry a bulky payload."""
    return replace(arm, payload=replace(arm.payload,
                                        inertia=arm.payload.inertia + size['inertia']))


def draw_change(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a drop of 50-85 %, a pick of as much, or a ramp over 2-5 s; at 4-36 s."""
    kind = int(rng.integers(3))
    share = rng.uniform(0.5, 0.85) * (-1.0 if kind == DROP else 1.0)
    return {'time': rng.uniform(4.0, 36.0),
            'mass': arm.payload.mass * max(1.0 + severity * share, LEAST_LEFT),
            'duration': rng.uniform(2.0, 5.0) if kind == RAMP else 0.0}


def apply_change(arm: Arm, size: Parameters) -> Arm:
    """Change the mass at `time` s to `mass` kg, at the tip's own speed, over `duration` s."""
    return replace(arm, payload=replace(
        arm.payload, event_time=size['time'], event_mass=size['mass'],
        event_duration=size['duration']))


def with_change_as_told(payload: Payload, told: float) -> Payload:
    """Return a payload that changes by as much as one of the told mass, kg, is to."""
    left = payload.event_mass + payload.mass - told
    return replace(payload, event_mass=max(left, LEAST_LEFT * payload.mass))


def draw_loose(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a grip that lets the payload swing at 15-30 rad/s (divided by the severity)."""
    frequency = rng.uniform(15.0, 30.0)
    return {'frequency': frequency / severity if severity > 0.0 else 0.0,
            'damping_ratio': rng.uniform(0.03, 0.1)}


def apply_loose(arm: Arm, size: Parameters) -> Arm:
    """Hold the payload by a spring and damper across the tip (frequency 0: rigid)."""
    return replace(arm, payload=replace(arm.payload, loose_frequency=size['frequency'],
                                        loose_damping_ratio=size['damping_ratio']))


def draw_offset(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a centre 3-10 cm beyond the tip, or as far inboard."""
    return {'beyond': severity * rng.uniform(0.03, 0.1) * rng.choice([-1.0, 1.0])}


def apply_offset(arm: Arm, size: Parameters) -> Arm:
    """Hold the payload away from the tip."""
    return replace(arm, payload=replace(
        arm.payload, beyond_tip=arm.payload.beyond_tip + size['beyond']))


def draw_beside(rng: np.random.Generator, arm: Arm, severity: float) -> Parameters:
    """Draw a centre 3-10 cm beside the lower link's axis, on either side."""
    return {'beside': severity * rng.uniform(0.03, 0.1) * rng.choice([-1.0, 1.0])}


def apply_beside(arm: Arm, size: Parameters) -> Arm:
    """Hold the payload beside the axis."""
    return replace(arm, payload=replace(
        arm.payload, beside_tip=arm.payload.beside_tip + size['beside']))


EFFECTS = (
    HiddenEffect('payload_mass', draw_mass, apply_mass),
    HiddenEffect('payload_inertia', draw_inertia, apply_inertia),
    HiddenEffect('payload_change', draw_change, apply_change),
    HiddenEffect('loose_payload', draw_loose, apply_loose),
    HiddenEffect('payload_offset', draw_offset, apply_offset),
    HiddenEffect('payload_beside', draw_beside, apply_beside),
)
