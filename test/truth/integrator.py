"""Fixed-step Runge-Kutta integration of the arm with its sampled position controller."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from truth.beam_elements import Array
from truth.compiled import acceleration, compiled
from truth.equations import LinkTerms

# Columns of the drive table (2, 18).
GAIN, DAMPING, FORWARD, BACKWARD, STRIBECK, STRIBECK_SPEED = range(6)
RIPPLE, RIPPLE_ORDER, RIPPLE_PHASE, BIAS, DEAD_ZONE, SATURATION, LAG, TRAVEL = range(6, 14)
SPRING, SPRING_REST, INTEGRAL_RATE, LOOP_DAMPING = range(14, 18)


class Plant(NamedTuple):
    """Arrays of the right-hand side; see `assembly.System` and the column names above."""

    upper: LinkTerms
    lower: LinkTerms
    constant_mass: Array
    gravity: Array
    twist: Array
    base: Array
    drag: Array
    drive: Array


class Loop(NamedTuple):
    """
    The experiment: samples N, steps per sample S, joints 2, gauges G.

    `reference` (N, 2) rad and `feedback` (2, 2) = (gain, limit) per joint if `closed`, else
    `command` (N, 2) is applied; `noise` (N, 2) rad; `angle` (2, 4) = (gain, offset rad, step rad,
    1 where it sits on the motor) per joint; `mass` (N S,) the payload at every step, kg; `delay`
    of the command in steps.
    """

    closed: bool
    reference: Array
    command: Array
    feedback: Array
    noise: Array
    angle: Array
    mass: Array
    lower_empty: LinkTerms
    payload_unit: LinkTerms
    curvature: Array
    step: float
    steps_per_sample: int
    delay: float


@compiled
def dry_friction(row: Array, travel: float, speed: float) -> float:
    """
    Return the friction torque, N m: a spring that slips at the sliding friction.

    Sliding friction has a Stribeck rise at low speed and may differ by direction.
    """
    share = min(max(travel / row[TRAVEL], -1.0), 1.0)
    level = row[FORWARD] if share > 0.0 else row[BACKWARD]
    return share * (level + row[STRIBECK] * np.exp(-(speed / row[STRIBECK_SPEED])**2))


@compiled
def heeded(row: Array, command: float) -> float:
    """Return what the drive makes of a command."""
    u = command + row[BIAS]
    if row[DEAD_ZONE] > 0.0:
        u = np.sign(u) * max(abs(u) - row[DEAD_ZONE], 0.0)
    return min(max(u, -row[SATURATION]), row[SATURATION])


@compiled
def drive_torque(row: Array, command: float, theta: float, speed: float,
                 travel: float) -> float:
    """Return the torque on a rotor without that of the loop's integrator, N m."""
    torque = row[GAIN] * heeded(row, command) - row[DAMPING] * speed
    torque -= dry_friction(row, travel, speed)
    torque -= row[SPRING] * (theta - row[SPRING_REST])
    return torque + row[RIPPLE] * np.sin(row[RIPPLE_ORDER] * theta + row[RIPPLE_PHASE])


@compiled
def gear_torque(row: Array, twist: float, speed: float) -> float:
    """Return the torque of a gear, N m: a gap, then a spring and damper that only push."""
    overlap = abs(twist) - row[3]
    if overlap <= 0.0:
        return 0.0
    side = 1.0 if twist > 0.0 else -1.0
    push = row[1] * overlap + row[2] * speed * side
    if row[3] > 0.0:
        push = max(push, 0.0)
    return -side * push


@compiled
def add_air_drag(plant: Plant, p: Array, v: Array, forces: Array) -> None:
    """Add the quadratic drag of both links' transverse motion to `forces`."""
    upper, drag = plant.upper, plant.drag
    n1, n2 = upper.a.size, plant.lower.a.size
    rate, slope, tip_speed, slope_speed = v[0], 0.0, 0.0, 0.0
    for i in range(n1):
        slope += upper.tip_slope[i] * p[2 + i]
        slope_speed += upper.tip_slope[i] * v[2 + i]
        tip_speed += upper.tip[i] * v[2 + i]
    cosine = np.cos(p[1] + slope)
    elbow_speed = cosine * (rate * upper.tip_arm + tip_speed)
    rate_2 = rate + v[1] + slope_speed
    width = min(n2, drag.shape[2] - 2)
    for k in range(drag.shape[1]):
        normal = rate * drag[0, k, 1]
        for i in range(n1):
            normal += drag[0, k, 2 + i] * v[2 + i]
        force = -drag[0, k, 0] * abs(normal) * normal
        forces[0] += force * drag[0, k, 1]
        for i in range(n1):
            forces[2 + i] += force * drag[0, k, 2 + i]
        normal = elbow_speed + rate_2 * drag[1, k, 1]
        for i in range(width):
            normal += drag[1, k, 2 + i] * v[2 + n1 + i]
        force = -drag[1, k, 0] * abs(normal) * normal
        forces[0] += force * (drag[1, k, 1] + cosine * upper.tip_arm)
        forces[1] += force * drag[1, k, 1]
        for i in range(n1):
            forces[2 + i] += force * (drag[1, k, 1] * upper.tip_slope[i]
                                      + cosine * upper.tip[i])
        for i in range(width):
            forces[2 + n1 + i] += force * drag[1, k, 2 + i]


@compiled
def right_side(plant: Plant, p: Array, v: Array, u: Array, anchor: Array, held: Array) -> Array:
    """Return ddp (N,) for commands `u` (2,), friction anchors rad, integrators' torques N m."""
    forces = np.zeros(p.size)
    for j in range(2):
        forces[j] = held[j] + drive_torque(plant.drive[j], u[j], p[j], v[j], p[j] - anchor[j])
        if plant.twist[j, 0] >= 0.0:
            k = int(plant.twist[j, 0])
            forces[k] += gear_torque(plant.twist[j], p[k], v[k])
    if plant.base[0] > 0.0:
        forces[-1] = -plant.base[0] * p[-1] - plant.base[1] * v[-1]
    if plant.drag[0, 0, 0] > 0.0:
        add_air_drag(plant, p, v, forces)
    return acceleration(p, v, forces, plant.gravity, plant.upper, plant.lower,
                        plant.constant_mass)


@compiled
def runge_kutta_step(plant: Plant, p: Array, v: Array, start: Array, middle: Array, end: Array,
                     anchor: Array, held: Array, h: float) -> tuple[Array, Array]:
    """Return (p, v) after one classical fourth-order step; commands at its three times."""
    # One call in a loop, because four calls take four times as long to compile.
    n = p.size
    position, velocity, rate = np.zeros(n), v.copy(), np.zeros(n)
    p_after, v_after = p.copy(), v.copy()
    for stage in range(4):
        reach = h * (0.0, 0.5, 0.5, 1.0)[stage]
        weight = h * (1.0, 2.0, 2.0, 1.0)[stage] / 6.0
        for i in range(n):
            position[i] = p[i] + reach * velocity[i]
            velocity[i] = v[i] + reach * rate[i]
        u = start if stage == 0 else end if stage == 3 else middle
        rate = right_side(plant, position, velocity, u, anchor, held)
        for i in range(n):
            p_after[i] += weight * velocity[i]
            v_after[i] += weight * rate[i]
    return p_after, v_after


@compiled
def blend(out: Array, empty: Array, unit: Array, mass: float) -> None:
    """Write `empty` + `mass` `unit`, (K,); a loop compiles in a tenth of a slice's time."""
    for i in range(out.size):
        out[i] = empty[i] + mass * unit[i]


@compiled
def load_payload(lower: LinkTerms, empty: LinkTerms, unit: LinkTerms, mass: float) -> None:
    """Write the lower link's terms with a payload of `mass` kg to `lower`, in place."""
    blend(lower.moments, empty.moments, unit.moments, mass)
    blend(lower.a, empty.a, unit.a, mass)
    blend(lower.b, empty.b, unit.b, mass)
    blend(lower.point_mass, empty.point_mass, unit.point_mass, mass)
    for i in range(lower.a.size):
        blend(lower.mass[i], empty.mass[i], unit.mass[i], mass)
        blend(lower.shortening[i], empty.shortening[i], unit.shortening[i], mass)
        blend(lower.centrifugal[i], empty.centrifugal[i], unit.centrifugal[i], mass)


@compiled
def measure_angles(plant: Plant, loop: Loop, p: Array, sample: int, out: Array) -> None:
    """Write what the joint sensors (behind or before the gears) read, rad."""
    for j in range(2):
        angle = p[j]
        if plant.twist[j, 0] >= 0.0 and loop.angle[j, 3] == 0.0:
            angle += p[int(plant.twist[j, 0])]
        reading = loop.angle[j, 0] * angle + loop.angle[j, 1] + loop.noise[sample, j]
        if loop.angle[j, 2] > 0.0:
            reading = loop.angle[j, 2] * np.round(reading / loop.angle[j, 2])
        out[j] = reading


@compiled
def delayed_command(loop: Loop, step: int, out: Array) -> None:
    """Write the mean over the step of the command as it reaches the drive."""
    past = step - loop.delay
    whole = int(np.floor(past))
    share = past - whole
    for j in range(2):
        out[j] = 0.0
        if whole >= 0:
            out[j] = (1.0 - share) * loop.command[whole // loop.steps_per_sample, j]
        if share > 0.0 and whole + 1 >= 0:
            out[j] += share * loop.command[(whole + 1) // loop.steps_per_sample, j]


@compiled
def lag_command(drive: Array, h: float, lagged: Array, u: Array, middle: Array,
                end: Array) -> None:
    """Write the command behind each motor's first-order lag in mid-step and at its end."""
    for j in range(2):
        middle[j] = end[j] = u[j]
        if drive[j, LAG] > 0.0:
            middle[j] += (lagged[j] - u[j]) * np.exp(-0.5 * h / drive[j, LAG])
            end[j] += (lagged[j] - u[j]) * np.exp(-h / drive[j, LAG])
        else:
            lagged[j] = u[j]


@compiled
def integrate(drive: Array, h: float, v: Array, u: Array, held: Array) -> None:
    """Add what the velocity loops' sampled integrators gain in a step, N m."""
    for j in range(2):
        error = drive[j, GAIN] * heeded(drive[j], u[j]) - drive[j, LOOP_DAMPING] * v[j]
        held[j] += h * drive[j, INTEGRAL_RATE] * error


@compiled
def run(plant: Plant, loop: Loop, p: Array, v: Array, joint: Array, strain: Array,
        states: Array) -> None:
    """
    Fill `joint` (N, 2) rad, `strain` (N S, G), `states` (N, 2, coordinates) and the commands.

    Row k holds the state at k T and the command applied from then on.
    """
    anchor, lagged, u = p[:2].copy(), np.zeros(2), np.zeros(2)
    middle, end, held_torque = np.zeros(2), np.zeros(2), np.zeros(2)
    step, held = 0, -1.0
    for sample in range(joint.shape[0]):
        measure_angles(plant, loop, p, sample, joint[sample])
        for i in range(p.size):
            states[sample, 0, i], states[sample, 1, i] = p[i], v[i]
        if loop.closed:
            for j in range(2):
                wish = loop.feedback[j, 0] * (loop.reference[sample, j] - joint[sample, j])
                loop.command[sample, j] = min(max(wish, -loop.feedback[j, 1]),
                                              loop.feedback[j, 1])
        for _ in range(loop.steps_per_sample):
            if loop.mass[step] != held:
                held = loop.mass[step]
                load_payload(plant.lower, loop.lower_empty, loop.payload_unit, held)
            for g in range(strain.shape[1]):
                total = 0.0
                for i in range(p.size):
                    total += loop.curvature[g, i] * p[i]
                strain[step, g] = total
            delayed_command(loop, step, u)
            lag_command(plant.drive, loop.step, lagged, u, middle, end)
            integrate(plant.drive, loop.step, v, end, held_torque)
            p, v = runge_kutta_step(plant, p, v, lagged, middle, end, anchor, held_torque,
                                    loop.step)
            for j in range(2):
                lagged[j] = end[j]
                travel = plant.drive[j, TRAVEL]
                anchor[j] = min(max(anchor[j], p[j] - travel), p[j] + travel)
            step += 1
