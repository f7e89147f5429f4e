"""
What a MuJoCo record can hide: drive, sensor and mechanical deviations, one function an effect.

An effect takes a seeded generator and a clean `Scenario` and returns the changed one, with the
numbers of the change in `truth` (SI, rad) and where it acts in `site`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
from mujoco_chain import Hook
from mujoco_scenario import Drive, Event, Scenario
import numpy as np

GAUGES = ('strain_1a', 'strain_1b', 'strain_2a', 'strain_2b')


def _pair(j: int, value: Any, other: Any = 0.0) -> tuple[Any, Any]:
    """Return a pair with `value` at joint `j`."""
    return (value, other) if j == 0 else (other, value)


def _either(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a factor 1 ± uniform(low, high)."""
    return 1 + rng.choice([-1, 1]) * rng.uniform(low, high)


def _of_joint(name: str, ranges: tuple, other: Any = 0.0) -> Callable:
    """Return an effect that sets the arm's pair `name` at one joint, uniform in its range."""
    def effect(rng: np.random.Generator, base: Scenario) -> Scenario:
        j = int(rng.integers(2))
        value = rng.uniform(*ranges[j])
        change: dict[str, Any] = {name: _pair(j, value, other)}
        return replace(base, arm=replace(base.arm, **change),
                       truth={name: value}, site=f'joint_{j + 1}')
    return effect


def _of_drive(name: str, draw: Callable[[np.random.Generator], float], other: float) -> Callable:
    """Return an effect that sets the drive's pair `name` at one joint."""
    def effect(rng: np.random.Generator, base: Scenario) -> Scenario:
        j = int(rng.integers(2))
        value = draw(rng)
        change: dict[str, Any] = {name: _pair(j, value, other)}
        return replace(base, drive=replace(base.drive, **change),
                       truth={name: value}, site=f'joint_{j + 1}')
    return effect


def _of_gauge(name: str, draw: Callable[[np.random.Generator], float]) -> Callable:
    """Return an effect that sets one gauge's entry of the vector `name`."""
    def effect(rng: np.random.Generator, base: Scenario) -> Scenario:
        i = int(rng.integers(4))
        vector = np.zeros(4)
        vector[i] = draw(rng)
        change: dict[str, Any] = {name: vector}
        return replace(base, sensors=replace(base.sensors, **change),
                       truth={name: float(vector[i])}, site=GAUGES[i])
    return effect


def _signed(low: float, high: float) -> Callable[[np.random.Generator], float]:
    return lambda rng: float(rng.choice([-1, 1]) * rng.uniform(low, high))


def input_delay(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Delay both commands by the same time."""
    delay = rng.uniform(0.015, 0.035)
    return replace(base, drive=Drive(delay=delay), truth={'delay_s': delay}, site='both')


def gear_compliance(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Put a damped spring between the measured motor shaft and the link."""
    j = int(rng.integers(2))
    stiffness = rng.uniform(*((60, 150), (12, 35))[j])
    arm = replace(base.arm, gear_stiffness=_pair(j, stiffness, None),
                  gear_damping=_pair(j, 1e-3 * stiffness))
    return replace(base, arm=arm, site=f'joint_{j + 1}',
                   truth={'stiffness_n_m_per_rad': stiffness})


def backlash(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Let the link move freely by a gap against the measured motor shaft."""
    j = int(rng.integers(2))
    gap = rng.uniform(0.008, 0.025)
    arm = replace(base.arm, backlash=_pair(j, gap), gear_damping=_pair(j, 2e-3))
    return replace(base, arm=arm, truth={'gap_rad': gap}, site=f'joint_{j + 1}')


def angle_gain(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Scale one joint's angle reading."""
    j, factor = int(rng.integers(2)), _either(rng, 0.05, 0.12)
    sensors = replace(base.sensors, angle_gain=_pair(j, factor, 1.0))
    return replace(base, sensors=sensors, truth={'factor': factor}, site=f'joint_{j + 1}')


def angle_offset(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Shift the elbow's angle reading; the arm itself starts straight."""
    offset = _signed(0.1, 0.3)(rng)
    return replace(base, sensors=replace(base.sensors, angle_offset=(0.0, offset)),
                   truth={'offset_rad': offset}, site='joint_2')


def strain_gain(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Scale one gauge."""
    i, factor = int(rng.integers(4)), _either(rng, 0.1, 0.25)
    mix = np.eye(4)
    mix[i, i] = factor
    return replace(base, sensors=replace(base.sensors, strain_mix=mix),
                   truth={'factor': factor}, site=GAUGES[i])


def strain_crosstalk(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Let one gauge pick up a share of another."""
    i, source = rng.choice(4, 2, replace=False)
    mix = np.eye(4)
    mix[i, source] = share = _signed(0.1, 0.25)(rng)
    return replace(base, sensors=replace(base.sensors, strain_mix=mix),
                   truth={'share': share, 'from': GAUGES[source]}, site=GAUGES[i])


def strain_filter(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Pass all strains through a second-order low-pass."""
    frequency = rng.uniform(18, 45)
    return replace(base, sensors=replace(base.sensors, filter_frequency=frequency),
                   truth={'frequency_rad_per_s': frequency, 'damping': 0.8}, site='all gauges')


def strain_delay(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Delay all strains against the angles."""
    delay = rng.uniform(0.012, 0.035)
    return replace(base, sensors=replace(base.sensors, strain_delay=delay),
                   truth={'delay_s': delay}, site='all gauges')


def _of_link(name: str, draw: Callable[[np.random.Generator], float]) -> Callable:
    """Return an effect that scales one property of one link."""
    def effect(rng: np.random.Generator, base: Scenario) -> Scenario:
        j, factor = int(rng.integers(2)), draw(rng)
        change: dict[str, Any] = {name: getattr(base.arm.links[j], name) * factor}
        upper, lower = base.arm.links
        links = (replace(upper, **change), lower) if j == 0 else (upper, replace(lower, **change))
        return replace(base, arm=replace(base.arm, links=links),
                       truth={'factor': factor}, site=f'link_{j + 1}')
    return effect


def air_drag(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Brake every segment by ½ rho v² on its side; rho stands for density times drag factor."""
    density = rng.uniform(8, 25)
    return replace(base, arm=replace(base.arm, air_density=density),
                   truth={'density_times_drag_kg_per_m3': density}, site='links')


def base_tilt(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Tilt the base so that a part of gravity acts along x or y."""
    axis, angle = int(rng.integers(2)), _signed(0.02, 0.05)(rng)
    return replace(base, arm=replace(base.arm, tilt=_pair(axis, angle)),
                   truth={'tilt_rad': angle}, site='xy'[axis])


def base_compliance(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Let the base turn on a spring; joint 1 is measured against the base."""
    stiffness = rng.uniform(150, 450)
    return replace(base, arm=replace(base.arm, base_stiffness=stiffness),
                   site='base', truth={'stiffness_n_m_per_rad': stiffness,
                                       'inertia_kg_m2': base.arm.base_inertia})


def payload_mass(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Tell the operator a wrong payload."""
    return replace(base, told=base.told * _either(rng, 0.2, 0.4), site='payload')


def payload_inertia(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Spread the payload: inertia about its centre at the tip."""
    inertia = rng.uniform(1e-3, 3e-3)
    return replace(base, arm=replace(base.arm, payload_inertia=inertia),
                   truth={'inertia_kg_m2': inertia}, site='payload')


def payload_change(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Change the carried mass at once in mid-motion."""
    at, mass = rng.uniform(8, 28), rng.choice([0.02, base.told * 0.4, base.told * 1.8])

    def event(model: mujoco.MjModel) -> Hook:
        body = model.body('payload').id

        def hook(changed: mujoco.MjModel, data: mujoco.MjData) -> None:
            if data.time >= at:
                changed.body_mass[body] = mass
        return hook
    return replace(base, event=event, truth={'time_s': at, 'mass_kg': float(mass)}, site='payload')


def loose_payload(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Hold the payload by a soft, lightly damped spring across the tip."""
    frequency, damping = rng.uniform(12, 25), rng.uniform(0.03, 0.08)
    arm = replace(base.arm, loose_stiffness=base.told * frequency**2,
                  loose_damping=2 * damping * base.told * frequency)
    return replace(base, arm=arm, site='payload',
                   truth={'frequency_rad_per_s': frequency, 'damping': damping})


def torque_ripple(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Add a torque that repeats with the joint angle."""
    j = int(rng.integers(2))
    amplitude, teeth = rng.uniform(*((1.0, 2.5), (0.25, 0.6))[j]), int(rng.integers(8, 25))
    phase = rng.uniform(0, 2 * np.pi)

    def event(model: mujoco.MjModel) -> Hook:
        joint = model.joint(f'joint_{j + 1}')
        angle, dof = int(joint.qposadr[0]), int(joint.dofadr[0])

        def hook(_: mujoco.MjModel, data: mujoco.MjData) -> None:
            data.qfrc_applied[dof] = amplitude * np.sin(teeth * data.qpos[angle] + phase)
        return hook
    return replace(base, event=event, site=f'joint_{j + 1}',
                   truth={'amplitude_n_m': amplitude, 'per_turn': teeth, 'phase_rad': phase})


def _friction(j: int, level: Callable[[float], float]) -> Event:
    """Return an event that sets the dry friction of joint `j` from its speed at every step."""
    def event(model: mujoco.MjModel) -> Hook:
        dof = int(model.joint(f'joint_{j + 1}').dofadr[0])

        def hook(changed: mujoco.MjModel, data: mujoco.MjData) -> None:
            changed.dof_frictionloss[dof] = level(data.qvel[dof])
        return hook
    return event


def asymmetric_friction(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Give a joint more dry friction one way than the other."""
    j = int(rng.integers(2))
    low, high = np.array(((0.3, 1.8), (0.08, 0.5))[j]) * rng.uniform(0.8, 1.2, 2)
    ahead, back = (low, high) if rng.random() < 0.5 else (high, low)
    return replace(base, event=_friction(j, lambda speed: ahead if speed > 0 else back),
                   truth={'forward_n_m': ahead, 'backward_n_m': back}, site=f'joint_{j + 1}')


def stribeck_friction(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Give a joint dry friction that falls with speed."""
    j = int(rng.integers(2))
    slide = rng.uniform(*((0.5, 1.0), (0.12, 0.25))[j])
    stick, speed_scale = slide * rng.uniform(2.0, 3.0), rng.uniform(0.05, 0.12)
    event = _friction(j, lambda v: slide + (stick - slide) * np.exp(-(v / speed_scale)**2))
    truth = {'coulomb_n_m': slide, 'static_n_m': stick, 'stribeck_rad_per_s': speed_scale}
    return replace(base, event=event, truth=truth, site=f'joint_{j + 1}')


def nothing(rng: np.random.Generator, base: Scenario) -> Scenario:
    """Hide nothing."""
    return base


EFFECTS: dict[str, Callable[[np.random.Generator, Scenario], Scenario]] = {
    'nothing': nothing,
    'coulomb_friction': _of_joint('coulomb_friction', ((0.8, 2.0), (0.2, 0.55))),
    'viscous_friction': _of_joint('viscous_friction', ((1.5, 4.0), (0.4, 1.0))),
    'asymmetric_friction': asymmetric_friction,
    'stribeck_friction': stribeck_friction,
    'backlash': backlash,
    'gear_compliance': gear_compliance,
    'torque_ripple': torque_ripple,
    'actuator_gain': _of_drive('gain', lambda rng: _either(rng, 0.06, 0.15), 1.0),
    'actuator_bias': _of_drive('bias', _signed(0.02, 0.06), 0.0),
    'actuator_dead_zone': _of_drive('dead_zone', lambda rng: rng.uniform(0.03, 0.08), 0.0),
    'actuator_saturation': _of_drive('saturation', lambda rng: rng.uniform(0.25, 0.45), np.inf),
    'motor_lag': _of_drive('lag', lambda rng: rng.uniform(0.02, 0.05), 0.0),
    'input_delay': input_delay,
    'angle_gain': angle_gain,
    'angle_offset': angle_offset,
    'strain_bias': _of_gauge('strain_bias', _signed(1e-5, 4e-5)),
    'strain_drift': _of_gauge('strain_drift', _signed(6e-7, 2e-6)),
    'strain_gain': strain_gain,
    'strain_crosstalk': strain_crosstalk,
    'strain_filter': strain_filter,
    'strain_delay': strain_delay,
    'link_stiffness': _of_link('youngs_modulus', lambda rng: _either(rng, 0.12, 0.28)),
    'modal_damping': _of_link('damping_ratio', lambda rng: rng.uniform(3.0, 8.0)),
    'air_drag': air_drag,
    'clamp_compliance': _of_joint('clamp_stiffness', ((60, 150), (15, 40)), None),
    'base_tilt': base_tilt,
    'base_compliance': base_compliance,
    'hub_inertia': _of_joint('hub_inertia', ((0.04, 0.1), (0.01, 0.03))),
    'payload_mass': payload_mass,
    'payload_inertia': payload_inertia,
    'payload_change': payload_change,
    'loose_payload': loose_payload,
}
