"""A payload beside the lower link's axis, against a drawn arm and one of rigid segments."""

from __future__ import annotations

from dataclasses import replace

from extended_arms import arm, ROBOT
from flex_plant_sim.arm.ritz import RitzShapes
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.search import search
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base
from flex_plant_sim.effects import catalogue
from flex_plant_sim.effects.base import Motion
from flex_plant_sim.simulation.simulator import simulate, Simulator
import numpy as np
import pytest
from simulated_records import SLOWEST
from truth.records import HAVE_MUJOCO, make_record, MUJOCO, NO_MUJOCO, TruthCase

MODES, BESIDE, PAYLOAD = 2, 0.06, 0.2
HELD = f'payload_beside:arm:beside_m={BESIDE}'
NATURE = ('coriolis_centripetal:arm:share=1', 'foreshortening:arm:share=1')
CASE = TruthCase(2, duration_s=18.0, payload_true=0.15, payload_told=0.15, tolerances=False,
                 simulator=MUJOCO)


def drawn_payload(p: Array, beside: float) -> Array:
    """Return where the payload is on drawn links that keep their length, (2,)."""
    x, w = np.polynomial.legendre.leggauss(30)
    place, turn = np.zeros(2), 0.0
    for j, link in enumerate(ROBOT.links):
        shape, q = RitzShapes.of(link.beam(MODES)), p[2 + j * MODES:2 + (j + 1) * MODES]
        turn += p[j]
        slopes = shape.shape(0.5 * link.length * (x + 1.0), 1) @ q
        drawn = np.array([link.hub_radius + link.length * (1.0 - 0.25 * w @ slopes**2),
                          shape.shape(link.length) @ q])
        place += drawn @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        turn += float(shape.shape(link.length, 1) @ q)
    return place + beside * np.array([-np.sin(turn), np.cos(turn)])


def drawn_force(p: Array, v: Array, rate: Array, beside: float) -> Array:
    """Return d/dt dT/dv - dT/dp of the drawn payload by differences, (N,)."""
    h, unit = 1e-3, np.eye(p.size)

    def energy(p: Array, v: Array) -> float:
        h = 1e-5
        speed = (drawn_payload(p + h * v, beside) - drawn_payload(p - h * v, beside)) / (2.0 * h)
        return float(0.5 * PAYLOAD * speed @ speed)

    def momentum(time: float) -> Array:
        return np.array([energy(p + time * v, v + time * rate + e)
                         - energy(p + time * v, v + time * rate - e) for e in unit]) / 2.0

    slope = np.array([energy(p + h * e, v) - energy(p - h * e, v) for e in unit]) / (2.0 * h)
    return np.asarray((momentum(h) - momentum(-h)) / (2.0 * h) - slope)


@pytest.mark.parametrize('theta_2', [0.8, -2.0])
@pytest.mark.parametrize('bend', [0.0, 0.01])
def test_its_forces_are_lagrange_s_of_the_drawn_payload(theta_2: float, bend: float) -> None:
    held, plain, step = arm(HELD, modes=MODES), arm(modes=MODES), 1e-5
    p = np.r_[0.3, theta_2, bend * np.array([1.0, 0.2, 0.7, -0.3])]
    v, rate = np.r_[1.2, -1.5, 5.0 * p[2:]], np.r_[3.0, -4.0, -60.0 * p[2:]]
    motion = Motion(0.0, p, v, np.zeros(2), held.robot, held.form, PAYLOAD, step,
                    step * np.r_[v, rate])
    cosine = np.cos(held.form.elbow_angle @ p)
    mass = held.form.mass_at(cosine, PAYLOAD) - plain.form.mass_at(cosine, PAYLOAD)
    true = drawn_force(p, v, rate, BESIDE) - drawn_force(p, v, rate, 0.0)
    found = mass @ rate - held.effects[0].force(motion)
    assert np.linalg.norm(found - true) < 1e-4 * np.linalg.norm(true)


def test_its_mass_is_the_slope_of_its_force() -> None:
    held, rng = arm(HELD, modes=MODES), np.random.default_rng(3)
    n, step = held.form.order, 0.01
    p, v, change = rng.normal(size=(3, 4, n)) * np.array([0.3, 1.0, 0.1])[:, None, None]

    def force(gained: Array) -> Array:
        return np.asarray(held.effects[0].force(Motion(
            0.0, p, v, np.zeros(2), held.robot, held.form, PAYLOAD, step,
            np.concatenate([0.0 * p, gained], axis=-1))))

    motion = Motion(0.0, p, v, np.zeros(2), held.robot, held.form, PAYLOAD, step)
    mass = held.effects[0].inertia(motion)
    np.testing.assert_allclose(force(change) - force(0.0 * change),
                               -(mass @ change[..., None])[..., 0] / step, atol=1e-12)


@pytest.mark.skipif(not HAVE_MUJOCO, reason=NO_MUJOCO)
@pytest.mark.parametrize('beside', [0.05, -0.05])
def test_the_arm_moves_as_one_of_rigid_segments(beside: float) -> None:
    """Open loop, by the forces of straight links joint 2 would miss 44 % of the change."""
    case = replace(CASE, effects=(('payload_beside', {'beside': beside}),), duration_s=4.0,
                   noise=0.0)
    record = make_record(case)
    clean = make_record(replace(case, effects=()), record.command)
    held, plain = (simulate(Simulator(arm(*NATURE, *more, modes=4).at_payload(0.15)),
                            record.command)[0] for more in (
        (f'payload_beside:arm:beside_m={beside}',), ()))
    change = record.table[:, 3:] - clean.table[:, 3:]
    miss = np.linalg.norm(held - plain - change, axis=0) / np.linalg.norm(change, axis=0)
    assert np.all(miss < 0.1)


@pytest.mark.skipif(not HAVE_MUJOCO, reason=NO_MUJOCO)
def test_a_payload_beside_the_axis_is_told_beside_a_zero_of_joint_2() -> None:
    """Of rigid links both look nearly the same; in 18 s of these they are equally likely."""
    truth = make_record(replace(CASE, effects=(('payload_beside', {'beside': -0.05}),)))
    record = Record('truth', truth.time, truth.command, np.hstack([truth.joint, truth.strain]),
                    0.15)
    asked = ('payload_beside', 'angle_offset')
    with np.errstate(all='ignore'):
        found = search(Data.of([record], SLOWEST, ROBOT.sample_time),
                       nominal_base(ROBOT, 'assumed_modes', 2), 1, lambda *told: None,
                       [name for name in catalogue() if name not in asked]).posterior
    single = {fit.hypotheses[0].label: fit for fit in reversed(found.fits)
              if len(fit.hypotheses) == 1}
    told = single['payload_beside:arm']
    assert told.log_evidence > found.best.log_evidence - 2.0
    assert told.values[0] == pytest.approx(-0.05, abs=0.01)
