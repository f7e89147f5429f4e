"""A base on springs both ways, against Lagrange's equations of a rigid arm in fixed axes."""

from __future__ import annotations

from extended_arms import arm, frequencies, ROBOT
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Motion
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np
from numpy.typing import NDArray
import pytest

BASE, PAYLOAD = 4.0, 0.1
CORIOLIS = 'coriolis_centripetal:arm:share=1'
SLIDING = f'base_sliding:arm:compliance_m_per_n=1e-3,mass_kg={BASE},damping_ratio={{}}'
HELD = ['theta_1', 'theta_2', *(f'q_{link}{mode}' for link in (1, 2) for mode in (1, 2, 3))]
# Half the time over which momenta are differentiated, s.
DT = 1e-4


def test_a_base_carries_the_arm_s_whole_mass_on_its_spring() -> None:
    form = arm(SLIDING.format(0.0)).form
    total = BASE + ROBOT.links[0].mass + ROBOT.elbow_mass + ROBOT.links[1].mass + PAYLOAD
    assert frequencies(form, HELD, PAYLOAD) == pytest.approx([(1e-3 * total)**-0.5] * 2, rel=1e-9)


def points(turns: Array) -> tuple[Array, NDArray[np.complex128]]:
    """Return masses and the derivatives of their places over (theta_1, theta_2), (2, P)."""
    gauss, weights = np.polynomial.legendre.leggauss(3)
    first, second = ROBOT.links
    upper = first.hub_radius + np.r_[0.5 * first.length * (1.0 + gauss), first.length]
    lower = second.hub_radius + np.r_[0.5 * second.length * (1.0 + gauss), second.length]
    masses = np.r_[0.5 * first.mass * weights, ROBOT.elbow_mass,
                   0.5 * second.mass * weights, PAYLOAD]
    out, on = np.exp(1j * turns[0]), np.exp(1j * turns.sum())
    places = np.r_[upper * out, upper[-1] * out + lower * on]
    return masses, 1j * np.stack([places, np.r_[0.0 * upper, lower * on]])


def kinetic_energy(turns: Array, base_velocity: complex, rates: Array) -> float:
    """Return the kinetic energy of base, rigid links, elbow and payload, J."""
    masses, slopes = points(turns)
    moving = base_velocity + rates @ slopes
    return float(0.5 * BASE * abs(base_velocity)**2 + 0.5 * masses @ np.abs(moving)**2)


def slopes_of_energy(turns: Array, base_velocity: complex, rates: Array) -> tuple[Array, Array]:
    """Return momenta of (theta_1, theta_2, base x, base y), and the slopes over the angles."""
    def central(of: int, step: float) -> float:
        ends = []
        for sign in (-step, step):
            state = np.r_[rates, base_velocity.real, base_velocity.imag, turns]
            state[of] += sign
            ends.append(kinetic_energy(state[4:], complex(*state[2:4]), state[:2]))
        return (ends[1] - ends[0]) / (2.0 * step)

    return (np.array([central(k, 1e-2) for k in range(4)]),
            np.array([central(k, 1e-5) for k in (4, 5)]))


def needed_forces(position: Array, velocity: Array, gained: Array) -> Array:
    """Return the forces on (theta_1, theta_2, u, v) that this motion needs, by Lagrange."""
    def at(time: float) -> tuple[Array, complex, Array]:
        now = position + velocity * time + 0.5 * gained * time**2
        rate = velocity + gained * time
        shift = complex(now[3], now[2])
        base = (complex(rate[3], rate[2]) + 1j * rate[0] * shift) * np.exp(1j * now[0])
        return now[:2], complex(base), rate[:2]

    momenta = [slopes_of_energy(*at(time))[0] for time in (-DT, DT)]
    needed = (momenta[1] - momenta[0]) / (2.0 * DT)
    on_base = complex(*needed[2:]) * np.exp(-1j * position[0])
    return np.r_[needed[:2] - slopes_of_energy(*at(0.0))[1], on_base.imag, on_base.real]


def modelled_forces(extended: ExtendedArm, position: Array, velocity: Array, gained: Array
                    ) -> Array:
    """Return what the model says of that: M p'' less the forces of the effects."""
    form, step = extended.form, 1e-2
    chosen = [form.names.index(name) for name in (
        'theta_1', 'theta_2', 'slide_base', 'slide_base_along') if name in form.names]
    wide = np.zeros((3, form.order))
    wide[:, chosen] = np.stack([position, velocity, gained])[:, :len(chosen)]
    motion = Motion(0.0, wide[0], wide[1], np.zeros(2), extended.robot, form, PAYLOAD, step,
                    step * np.r_[wide[1], wide[2]])
    forces = form.mass_at(np.cos(position[1]), PAYLOAD) @ wide[2] - extended.smooth_force(motion)
    return np.asarray(forces[chosen])


def test_it_shifts_as_lagrange_s_equations_say() -> None:
    rng = np.random.default_rng(5)
    extended, alone = arm(CORIOLIS, SLIDING.format(0.0)), arm(CORIOLIS)
    for _ in range(4):
        position = np.r_[rng.uniform(-1.5, 1.5, 2), rng.uniform(-0.1, 0.1, 2)]
        velocity, gained = rng.uniform(-1.0, 1.0, 4), rng.uniform(-5.0, 5.0, 4)
        # What the arm needs on a base that stands still is checked elsewhere, inertias included.
        standing = [np.r_[1.0, 1.0, 0.0, 0.0] * of for of in (position, velocity, gained)]
        needed, found = (needed_forces(position, velocity, gained),
                         modelled_forces(extended, position, velocity, gained))
        needed[:2] -= needed_forces(*standing)[:2]
        found[:2] -= modelled_forces(alone, *standing)
        np.testing.assert_allclose(found, needed, rtol=1e-5, atol=1e-5)


def test_it_brakes_alike_in_all_directions() -> None:
    """The brake in fixed axes, c (u' + w v) across and c (v' - w u) along."""
    rng = np.random.default_rng(6)
    braked, free = (arm(SLIDING.format(ratio)) for ratio in (0.1, 0.0))
    brake = 0.2 * np.sqrt(BASE / 1e-3)
    position, velocity = rng.uniform(-1.0, 1.0, (2, 4))
    motion = (position, velocity, np.zeros(4))
    found = modelled_forces(braked, *motion) - modelled_forces(free, *motion)
    across, along = velocity[0] * position[3], -velocity[0] * position[2]
    np.testing.assert_allclose(found[2:], brake * np.array([across, along]), atol=1e-9)
    np.testing.assert_allclose(np.diagonal(braked.form.damping - free.form.damping)[-2:], brake)
