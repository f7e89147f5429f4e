"""Energy of the assumed-modes arm: kept without damping, never gained with it."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects import build
from flex_plant_sim.effects.base import Motion
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Simulator
import numpy as np
import pytest
from scipy.integrate import solve_ivp

SECONDS = 10.0


def undamped(name: str = 'reference') -> Robot:
    """Return a robot with neither damping in its links nor in its drives."""
    robot = load_robot(name)
    for index in (0, 1):
        robot = robot.with_link(index, damping_ratio=0.0).with_drive(index, damping=0.0)
    return robot


def energies(form: SecondOrderForm, states: Array, cosine: float, payload: float) -> Array:
    """Return T + V of states (N, 2 order), J."""
    position, velocity = states[:, :form.order], states[:, form.order:]
    mass, stiffness = form.mass_at(cosine, payload), form.stiffness_at(cosine)
    return 0.5 * (np.einsum('ki,ij,kj->k', velocity, mass, velocity)
                  + np.einsum('ki,ij,kj->k', position, stiffness, position))


def run(robot: Robot, modes: int, payload: float = 0.1, size: float = 1e-7) -> Array:
    """
    Return the energies over ten seconds of the simulator, from a random state, unforced.

    The state is so small that theta_2, hence M, stays: the simulator's equations leave out the
    Coriolis forces that a changing M brings about.
    """
    arm = ExtendedArm(robot, 'assumed_modes', modes, payload)
    simulator, order = Simulator(arm), arm.form.order
    rng = np.random.default_rng(modes)
    # Equal energies in all modes: velocities of the mass matrix' own scale.
    scale = 1.0 / np.sqrt(np.diag(arm.form.mass_at(1.0, payload)))
    simulator.state[order:] = size * scale * rng.standard_normal(order)
    states = []
    for _ in range(round(SECONDS / robot.sample_time)):
        states.append(simulator.state.copy())
        simulator.step(np.zeros(2))
    return energies(arm.form, np.array(states), 1.0, payload)


@pytest.mark.parametrize('modes', [1, 3, 6])
@pytest.mark.parametrize('name', ['reference', 'quanser_2dsfl'])
def test_energy_is_constant_without_damping(name: str, modes: int) -> None:
    energy = run(undamped(name), modes)
    assert np.max(np.abs(energy / energy[0] - 1.0)) < 1e-8


@pytest.mark.parametrize('modes', [1, 3, 6])
@pytest.mark.parametrize('name', ['reference', 'quanser_2dsfl'])
def test_energy_never_increases_with_damping(name: str, modes: int) -> None:
    energy = run(load_robot(name), modes)
    assert np.all(np.diff(energy) <= 1e-12 * energy[:-1])
    assert energy[-1] < 0.1 * energy[0]


@pytest.mark.parametrize('what', ['links', 'drives'])
def test_each_kind_of_damping_takes_energy(what: str) -> None:
    robot, damped = undamped(), load_robot('reference')
    robot = replace(robot, **{what: getattr(damped, what)})
    energy = run(robot, 2)
    assert np.all(np.diff(energy) <= 1e-12 * energy[:-1])
    assert energy[-1] < energy[0]


def large_motion(share: float) -> Array:
    """Return the energies of a wide, unforced swing, Coriolis forces scaled by `share`."""
    robot, payload = undamped(), 0.1
    form = assumed_modes(robot, 1)
    effect = build(EffectSpec('coriolis_centripetal', 'arm', {'share': share}))
    n = form.order

    def cosine(position: Array) -> float:
        return float(np.cos(form.elbow_angle @ position))

    def rate(_: float, x: Array) -> Array:
        motion = Motion(0.0, x[:n], x[n:], np.zeros(2), robot, form, payload, 0.01)
        force = effect.force(motion) - form.stiffness_at(cosine(x[:n])) @ x[:n]
        return np.concatenate([x[n:], np.linalg.solve(form.mass_at(cosine(x[:n]), payload),
                                                      force)])

    start = np.array([0.1, 0.8, 0.02, -0.01, 1.5, -2.5, 0.0, 0.1])
    swing = solve_ivp(rate, (0.0, 2.0), start, method='DOP853', rtol=1e-10, atol=1e-12,
                      t_eval=np.linspace(0.0, 2.0, 101))
    return np.array([energies(form, x[None], cosine(x[:n]), payload)[0] for x in swing.y.T])


def test_energy_of_a_wide_swing_needs_the_coriolis_forces() -> None:
    """M changes with the angle between the links; nature's share of Coriolis balances it."""
    energy = large_motion(1.0)
    assert np.max(np.abs(energy / energy[0] - 1.0)) < 1e-8
    without = large_motion(0.0)
    assert np.max(np.abs(without / without[0] - 1.0)) > 1e-2
