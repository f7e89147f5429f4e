"""Run the true arm: open loop from commands, or in closed loop from set-points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from truth.assembly import add_terms, assemble, System
from truth.beam_elements import Array
from truth.configuration import Arm
from truth.equations import LinkTerms, mass_and_bias
from truth.integrator import Loop, Plant, run

# Largest real decay per step; the classical Runge-Kutta method is stable up to 2.78.
STABLE_DECAY = 2.4


@dataclass(frozen=True)
class Motion:
    """
    Motion of the arm: joint (N, 2) rad as read, command (N, 2), fine strain (N S, G) m/m.

    `state` (N, 2, coordinates) holds coordinates and rates at the samples.
    """

    command: Array
    joint: Array
    fine_strain: Array
    state: Array
    steps_per_sample: int


def copy_terms(terms: LinkTerms) -> LinkTerms:
    """Return a copy whose arrays may be written."""
    arrays: dict[str, Any] = {name: value.copy() for name, value in terms._asdict().items()
                              if isinstance(value, np.ndarray)}
    return terms._replace(**arrays)


def plant_of(arm: Arm, system: System) -> Plant:
    """Return the right-hand side's arrays."""
    drive = np.array([[
        j.torque_gain, j.damping + j.viscous, j.coulomb_forward, j.coulomb_backward, j.stribeck,
        j.stribeck_speed, j.ripple, j.ripple_order, j.ripple_phase, j.bias, j.dead_zone,
        j.saturation, j.lag, j.presliding, j.spring, j.spring_rest,
        j.integral_rate, j.damping] for j in arm.joints])
    lower = add_terms(system.lower_empty, system.payload_unit, arm.payload.mass)
    return Plant(system.upper, copy_terms(lower), system.constant_mass, system.gravity,
                 system.twist, system.base, system.drag, drive)


def stable_step(arm: Arm, system: System) -> float:
    """Return the arm's step, halved until the fastest damped mode decays stably, s."""
    lower = add_terms(system.lower_empty, system.payload_unit, arm.payload.mass)
    rest = np.zeros(system.size)
    mass = mass_and_bias(rest, rest, np.zeros(2), system.upper, lower, system.constant_mass)[0]
    n = 2 + system.upper.a.size + lower.a.size
    damping = block_diag(np.zeros((2, 2)), system.upper.damping, lower.damping)
    fastest = np.abs(np.linalg.eigvals(np.linalg.solve(mass[:n, :n], damping))).max()
    step = arm.step
    while step * fastest > STABLE_DECAY:
        step *= 0.5
    return step


def refuse_forms(arm: Arm) -> None:
    """
    Raise ValueError where an arm has a form that these equations leave out.

    A base that slides, a hose, bristles, a lag inside the loop, one late drive, a payload that is
    loose in part or beside the axis.
    """
    if (np.isfinite(arm.structure.slide_stiffness) or arm.structure.hose_stiffness > 0.0
            or arm.payload.loose_share != 1.0 or arm.payload.beside_tip != 0.0
            or arm.late_drives != (0, 1)
            or any(joint.bristle or joint.lag_inside for joint in arm.joints)):
        raise ValueError('simulate: the finite-element truth does not have this form')


def simulate(arm: Arm, reference: Array | None = None, command: Array | None = None,
             noise: Array | None = None, state: Array | None = None) -> Motion:
    """
    Simulate `arm` for N samples, from `reference` (N, 2) rad or from `command` (N, 2).

    `noise` (N, 2) rad is added to the joint readings, `state` (2, coordinates) is the start.
    """
    given = reference if command is None else command
    if given is None:
        raise ValueError('simulate: expected a reference or a command')
    refuse_forms(arm)
    samples = given.shape[0]
    system = assemble(arm)
    step = stable_step(arm, system)
    steps = round(arm.sample_time / step)
    sensors = arm.sensors
    loop = Loop(
        command is None, np.array(given), np.array(given),
        np.array([arm.position_gain, arm.command_limit]).T.copy(),
        np.zeros((samples, 2)) if noise is None else noise,
        np.array([sensors.angle_gain, sensors.angle_offset, sensors.angle_step,
                  [j.sensor_on_motor for j in arm.joints]], dtype=float).T.copy(),
        np.array([arm.payload.mass_at(k * step) for k in range(samples * steps)]),
        copy_terms(system.lower_empty), copy_terms(system.payload_unit), system.curvature,
        step, steps, arm.input_delay / step)
    joint = np.zeros((samples, 2))
    strain = np.zeros((samples * steps, system.curvature.shape[0]))
    states = np.zeros((samples, 2, system.size))
    start = np.zeros((2, system.size)) if state is None else np.array(state)
    run(plant_of(arm, system), loop, start[0], start[1], joint, strain, states)
    return Motion(loop.command, joint, strain, states, steps)


def energy(arm: Arm, state: Array) -> float:
    """Return the kinetic and elastic energy, J, at `state` (2, coordinates)."""
    system = assemble(arm)
    p, v = state
    lower = add_terms(system.lower_empty, system.payload_unit, arm.payload.mass)
    mass = mass_and_bias(p, v, np.zeros(2), system.upper, lower, system.constant_mass)[0]
    q = p[2:2 + system.upper.a.size + lower.a.size]
    stiffness = block_diag(system.upper.stiffness, lower.stiffness)
    total = 0.5 * v @ mass @ v + 0.5 * q @ stiffness @ q
    n1 = system.upper.a.size
    for link, shapes in ((system.upper, q[:n1]), (lower, q[n1:])):
        bend, slope = link.point_curvature @ shapes, link.point_slope @ shapes
        total += 0.5 * link.point_stiffness @ (bend * slope)**2
    return float(total)
