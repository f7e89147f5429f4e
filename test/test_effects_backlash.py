"""Backlash: free flight, contact, energy and independence of the step."""

from __future__ import annotations

from extended_arms import arm, COMMANDS, outputs, ROBOT
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Simulator
import numpy as np
import pytest

GAP = 'backlash:joint_2:gap_rad=0.03,sensor_behind_gear={},hub_share=0.1'
ROTOR = 0.9


def states_of(extended: ExtendedArm, commands: Array) -> Array:
    """Return the states (N, n) before each command."""
    sim, states = Simulator(extended), []
    for command in commands:
        states.append(sim.state.copy())
        sim.step(command)
    return np.array(states)


def test_a_link_rests_while_its_rotor_crosses_half_the_gap() -> None:
    extended, drive = arm(GAP.format(0)), ROBOT.drives[1]
    states = states_of(extended, np.tile([0.0, 0.2], (30, 1)))
    tau = ROTOR * drive.inertia / drive.damping
    time = np.arange(30) * ROBOT.sample_time
    rotor = 0.2 * (time - tau * (1.0 - np.exp(-time / tau)))
    crossing = rotor < 0.015
    read = states @ extended.output_matrix[1]
    assert 5 < crossing.sum() < 15
    np.testing.assert_allclose(read[crossing], rotor[crossing], atol=1e-12)
    np.testing.assert_allclose(states[crossing, 1], 0.0, atol=1e-12)
    assert states[-1, 1] > 0.01
    lead = states[:, extended.form.names.index('gap_joint_2')]
    np.testing.assert_allclose(lead[crossing.sum() + 1:crossing.sum() + 5], -0.015, atol=1e-15)


@pytest.mark.parametrize('model', ['assumed_modes', 'paper'])
def test_lead_stays_within_the_gap_and_both_sensors_agree(model: str) -> None:
    behind, motor = (arm(GAP.format(side), model=model) for side in (1, 0))
    states = states_of(behind, COMMANDS)
    lead = states[:, behind.form.names.index('gap_joint_2')]
    assert np.max(np.abs(lead)) <= 0.015 and np.ptp(np.sign(lead)) == 2.0
    difference = states @ (behind.output_matrix - motor.output_matrix).T
    np.testing.assert_allclose(difference[:, 1], lead, atol=1e-15)


@pytest.mark.parametrize('model', ['assumed_modes', 'paper'])
def test_backlash_does_not_depend_on_the_step(model: str) -> None:
    coarse = outputs(arm(GAP.format(1), model=model))
    fine = outputs(arm(GAP.format(1), step=0.001, model=model))
    clean = outputs(arm(model=model))
    effect_size = np.linalg.norm(fine - clean, axis=0)
    assert np.all(np.linalg.norm(coarse - fine, axis=0)[1:] < 0.1 * effect_size[1:])


@pytest.mark.parametrize('modes, step', [(1, 0.001), (3, 0.001), (1, 0.01), (3, 0.01)])
def test_backlash_never_feeds_energy_in(modes: int, step: float) -> None:
    robot = ROBOT
    for j in (0, 1):
        robot = robot.with_drive(j, damping=0.0).with_link(j, damping_ratio=0.0)
    sim = Simulator(arm(GAP.format(1), robot=robot, modes=modes, step=step))
    form, n = sim.arm.form, sim.arm.form.order
    k, inertia = form.names.index('gap_joint_2'), ROTOR * robot.drives[1].inertia
    sim.state[2:4], sim.state[n + 1] = 0.02, 0.5

    def energy() -> float:
        p, rate = sim.state[:n].copy(), sim.state[n:].copy()
        rotor = rate[1] - rate[k]
        p[k] = rate[k] = 0.0
        cosine = np.cos(p[1])
        return 0.5 * (rate @ form.mass_at(cosine, 0.1) @ rate + inertia * (rotor**2 - rate[1]**2)
                      + p @ form.stiffness_at(cosine) @ p)

    before = energy()
    for _ in range(200):
        sim.step(np.zeros(2))
        assert energy() < 1.02 * before
