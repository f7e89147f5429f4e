"""What bent links add to the forces of motion, against drawn points and a closed form."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from extended_arms import arm, effect, ROBOT, stiff
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.filter import Sample
from flex_payload_estimator.estimators.rpe.forces import forces_of_motion, motion_rows
from flex_payload_estimator.estimators.rpe.modes import EXACT_BENDING
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_payload_estimator.estimators.rpe.time_update import FIRST_BIAS, MASS
from flex_plant_sim.arm.ritz import RitzShapes
from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import zero_order_hold
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
from flex_plant_sim.effects import catalogue, kinds
from flex_plant_sim.effects.base import Motion
from flex_plant_sim.effects.mechanics.bending import bending_force, bending_mass, bending_terms
from flex_plant_sim.effects.mechanics.bending_factors import field_factors, momentum_factors
from flex_plant_sim.effects.mechanics.bending_slopes import (
    field_derivatives,
    momentum_derivatives,
    SCALARS,
)
from flex_plant_sim.simulation.stepping import Stepper
import numpy as np
import pytest
from scipy.linalg import eigh
from truth import simulation as truth
from truth.configuration import reference_arm
from truth.records import make_record, TruthCase

BOTH = ('coriolis_centripetal:arm:share=1', 'foreshortening:arm:share=1')
LOOSE = 'loose_payload:arm:compliance_m_per_n=0.02,share=1,damping_ratio=0'
PAYLOAD = ROBOT.payload_mass


def points(robot: Robot, modes: int, p: Array) -> tuple[Array, Array]:
    """
    Return masses (K,) and places (K, 2) of a drawn arm whose links keep their length.

    A coordinate behind the deflections is the payload's displacement across the tip, beyond which
    the payload may be held rigidly.
    """
    x, w = np.polynomial.legendre.leggauss(30)
    masses, places, root, turn = [], [], np.zeros(2), 0.0
    for j, (link, end) in enumerate(zip(robot.links, (robot.elbow_mass, PAYLOAD))):
        shape, q = RitzShapes.of(link.beam(modes)), p[2 + j * modes:2 + (j + 1) * modes]
        turn += p[j]
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        at = np.append(0.5 * link.length * (x + 1.0), link.length)
        drawn = np.array([[link.hub_radius + s - 0.25 * s * w @ (
            shape.shape(0.5 * s * (x + 1.0), 1) @ q)**2, shape.shape(s) @ q] for s in at])
        masses.append(np.append(0.5 * link.mass * w, end))
        places.append(root + drawn @ axes)
        root, turn = places[-1][-1], turn + float(shape.shape(link.length, 1) @ q)
    places[-1][-1] += (p[2 + 2 * modes:].sum() * np.array([-np.sin(turn), np.cos(turn)])
                       + robot.payload_offset * np.array([np.cos(turn), np.sin(turn)]))
    return np.concatenate(masses), np.concatenate(places)


def drawn_energy_and_momentum(robot: Robot, modes: int, p: Array, v: Array) -> tuple[float, float]:
    """Return kinetic energy, J, and angular momentum about the first axis, kg m^2/s."""
    h = 1e-6
    mass, place = points(robot, modes, p)
    speed = (points(robot, modes, p + h * v)[1] - points(robot, modes, p - h * v)[1]) / (2.0 * h)
    upper = robot.links[0]
    hub = v[0] + float(RitzShapes.of(upper.beam(modes)).shape(upper.length, 1) @ v[2:2 + modes])
    rotors = np.array([drive.inertia for drive in robot.drives])
    energy = 0.5 * (mass @ np.sum(speed**2, axis=1) + rotors @ v[:2]**2
                    + robot.elbow_inertia * hub**2)
    spin = place[:, 0] * speed[:, 1] - place[:, 1] * speed[:, 0]
    return float(energy), float(mass @ spin + rotors[0] * v[0] + robot.elbow_inertia * hub)


def lagrange_force(robot: Robot, modes: int, p: Array, v: Array, rate: Array) -> Array:
    """Return d/dt dT/dv - dT/dp of the drawn arm by differences, rate = v', N m and N, (N,)."""
    h, unit = 1e-3, np.eye(p.size)

    def energy(p: Array, v: Array) -> float:
        return drawn_energy_and_momentum(robot, modes, p, v)[0]

    def momentum(time: float) -> Array:
        return np.array([energy(p + time * v, v + time * rate + e)
                         - energy(p + time * v, v + time * rate - e) for e in unit]) / 2.0

    slope = np.array([energy(p + h * e, v) - energy(p - h * e, v) for e in unit]) / (2.0 * h)
    return np.asarray((momentum(h) - momentum(-h)) / (2.0 * h) - slope)


@pytest.mark.parametrize('effects, offset', [((), 0.0), ((LOOSE,), 0.0), ((), 0.1), ((), -0.08)])
@pytest.mark.parametrize('bent', [True, False])
def test_the_estimator_s_forces_of_motion_are_lagrange_s_to_first_order(
        bent: bool, effects: tuple[str, ...], offset: float) -> None:
    """At speeds of the standard moves; rigid links' alone are off by what grows with the bend."""
    modes, step, robot = 2, 1e-5, replace(ROBOT, payload_offset=offset)
    extended = arm(*effects, robot=robot, modes=modes, step=step)
    form, n = extended.form, extended.form.order
    misses = []
    for bend in (0.01, 0.005):
        p = np.r_[0.3, 0.8, bend * np.array([1.0, 0.2, 0.7, -0.3, 1.0])[:n - 2]]
        v = np.r_[1.2, -1.5, 5.0 * p[2:]]
        rate = np.r_[3.0, -4.0, -60.0 * p[2:]]
        eta = float(form.elbow_angle @ p)
        true = form.mass_at(np.cos(eta), PAYLOAD) @ rate - lagrange_force(robot, modes, p, v, rate)
        half = 0.5 * step * np.r_[v, rate]
        found = forces_of_motion(motion_rows(extended, bent), PAYLOAD, np.r_[p, v] - half,
                                 np.r_[p, v] + half, np.zeros((2 * n, n)))[0]
        misses.append(np.linalg.norm(found - true) / np.linalg.norm(true))
    # Second order in the deflections, or first.
    assert misses[0] / misses[1] == pytest.approx(4.0 if bent else 2.0, rel=0.3)
    assert misses[1] < 1e-3 if bent else misses[1] > 1e-2


@pytest.mark.parametrize('step', [0.01, 0.001])
def test_the_estimator_s_step_is_the_simulator_s(step: float) -> None:
    """With the heaviest payload in fast motion, where the forces go with the acceleration."""
    nature, bare = (arm(*texts, modes=2, step=step).at_payload(0.3) for texts in (BOTH, ()))
    bare.nodes = np.array([np.cos(0.8)])
    plant, n = bare.plant, bare.states
    inputs = np.concatenate([plant.a, plant.b, plant.e], axis=-1)[0]
    _, grown = zero_order_hold(plant.a[0], inputs, step)
    x = np.r_[0.3, 0.8, 0.02, 0.002, 0.01, -0.001, 2.0, -2.0, 0.1, 0.0, -0.1, 0.0]
    command, push = np.array([3.0, -3.0]), grown[:, n + 2:].copy()
    after = x + grown[:, :n] @ x + grown[:, n:n + 2] @ command
    found = push @ forces_of_motion(motion_rows(bare), 0.3, x, after, push)[0]
    expected = nature.apply_effects(push, x, after, command, 0.0) - after
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize('modes, step', [(2, 0.01), (2, 0.001), (3, 0.01)])
def test_the_estimator_s_derivatives_are_differences_of_the_simulator_s_steps(modes: int,
                                                                              step: float) -> None:
    """
    Over the state and over the payload, of an arm whose bent links push.

    Two steps of Newton's leave 1e-3 of a derivative.
    """
    stepper = RecursivePredictionError(replace(ROBOT, sample_time=step), 'assumed_modes',
                                       modes).stepper
    bend = np.r_[0.02, 0.002, np.zeros(modes - 2), 0.01, -0.001, np.zeros(modes - 2)]
    x, mass, h = np.r_[0.3, 0.8, bend, 1.5, -2.0, 5.0 * bend], 0.2, 1e-5
    command = np.array([3.0, -3.0])

    def after(payload: float, start: Array) -> Array:
        found = Stepper.of(arm(*BOTH, modes=modes, step=step).at_payload(payload))
        assert found is not None
        return found.run(start, command[None], np.zeros((1, x.size // 2)))[-1]

    def told(slope: Array) -> Array:
        f = stepper.begin(EXACT_BENDING, np.zeros(6), mass, 1e-3, 1.0)
        f.x[:], f.sensitivity[:, FIRST_BIAS] = x, slope
        stepper.predict(f, Sample(step, None, command), Loads.none(np.zeros(6), step))
        np.testing.assert_allclose(f.x, after(mass, x), rtol=0, atol=1e-9)
        return f.sensitivity

    for unit in np.eye(x.size):
        expected = (after(mass, x + h * unit) - after(mass, x - h * unit)) / (2.0 * h)
        np.testing.assert_allclose(told(unit)[:, FIRST_BIAS], expected, rtol=0,
                                   atol=3e-3 * np.abs(expected).max())
    expected = (after(mass + h, x) - after(mass - h, x)) / (2.0 * h)
    np.testing.assert_allclose(told(0.0 * x)[:, MASS], expected, rtol=0,
                               atol=3e-3 * np.abs(expected).max())


def coasting(*texts: str, step: float) -> Array:
    """Return relative changes of the drawn arm's energy and momentum while it coasts for 1 s."""
    robot = ROBOT
    for j in (0, 1):
        robot = robot.with_drive(j, damping=0.0).with_link(j, damping_ratio=0.0)
    extended = arm(*texts, robot=robot, modes=1, step=step)
    stepper, n = Stepper.of(extended), extended.form.order
    assert stepper is not None
    start, count = np.zeros(extended.states), round(1.0 / step)
    start[1], start[n:n + 2] = 0.7, (1.0, -1.6)
    states = stepper.run(start, np.zeros((count, 2)), np.zeros((count, n)))
    found = []
    for x in (states[0], states[-1]):
        energy, momentum = drawn_energy_and_momentum(robot, 1, x[:n], x[n:])
        found.append((energy + 0.5 * x[:n] @ extended.form.stiffness_at(1.0) @ x[:n], momentum))
    return np.array(found[1]) / found[0] - 1.0


@pytest.mark.parametrize('factors, derivatives', [(momentum_factors, momentum_derivatives),
                                                  (field_factors, field_derivatives)])
def test_the_factors_derivatives_are_their_differences(factors: Any, derivatives: Any) -> None:
    z, carried, step = np.random.default_rng(5).normal(size=SCALARS), 0.7, 1e-20

    def at(scalars: Array) -> Array:
        sine, cosine = np.sin(scalars[6]), np.cos(scalars[6])
        return np.array(factors(scalars[:4], (*scalars[4:6], sine, cosine), scalars[7:], carried))

    # A step along the imaginary axis, which loses no digit.
    found = np.array([at(z + 1j * step * unit).imag / step for unit in np.eye(SCALARS)]).T
    assert derivatives(z, carried) == pytest.approx(found, rel=1e-13, abs=1e-13)


def test_a_coasting_arm_keeps_energy_and_angular_momentum_of_its_drawn_points() -> None:
    """The scheme is of second order; what its limit leaves is of third order in (q, q')."""
    bent = [coasting(*BOTH, step=step) for step in (0.004, 0.002, 0.001)]
    straight = [coasting(BOTH[0], step=step) for step in (0.002, 0.001)]
    assert bent[0][0] - bent[1][0] > 3.0 * (bent[1][0] - bent[2][0]) > 0.0
    limit = (4.0 * bent[2] - bent[1]) / 3.0
    assert np.all(np.abs(limit) < 2e-4)
    assert np.all(np.abs(2.0 * straight[1] - straight[0]) > 10.0 * np.abs(limit))


def test_a_spinning_link_stiffens_as_southwell_s_beam() -> None:
    """
    Out of its plane (omega L^2 sqrt(m / EI)) is 3.6817 and 4.1373 at 1 and 2 such units of speed.

    Wright, Smith, Thresher and Wang, J. Applied Mechanics 49 (1982); in the plane of rotation the
    square of the speed is taken off.
    """
    robot = replace(ROBOT, payload_mass=0.0)
    extended, link, n = arm(*BOTH[1:], robot=robot, modes=5), robot.links[1], 12
    unit = np.sqrt(link.bending_stiffness * link.length / link.mass) / link.length**2
    mu, bent = RitzShapes.of(link.beam(5)).modal_mass, 1e-6 * np.eye(n)[7:]
    for speed, expected in ((1.0, 3.6817), (2.0, 4.1373)):
        velocity = np.tile(speed * unit * np.eye(n)[1], (5, 1))
        motion = Motion(0.0, bent, velocity, np.zeros(2), robot, extended.form, 0.0, 0.01,
                        np.hstack([0.01 * velocity, 0.0 * velocity]))
        pull = 1e6 * np.asarray(extended.effects[0].force(motion))[:, 7:]
        stiffness = extended.form.stiffness_at(1.0)[7:, 7:] - pull
        lowest = eigh(stiffness, mu * np.eye(5), eigvals_only=True)[0]
        assert np.sqrt(lowest / unit**2 + speed**2) == pytest.approx(expected, abs=2e-4)


def test_rigid_links_and_the_paper_s_form_have_none() -> None:
    state = np.zeros(2 * 8)
    state[1], state[8:10] = 0.9, (1.3, -0.8)
    rigid = arm(*BOTH[1:], robot=stiff(ROBOT))
    assert np.abs(rigid.smooth_force(rigid.motion_between(state, state, np.zeros(2), 0.0))[:2]
                  ).max() < 1e-12
    paper = arm(*BOTH[1:], model='paper')
    assert not np.any(paper.smooth_force(paper.motion(state, np.zeros(2), 0.0)))


def test_one_instant_or_many_at_once_are_the_same() -> None:
    extended, random = arm(*BOTH), np.random.default_rng(1)
    before, after = 0.1 * random.standard_normal((2, 6, extended.states))
    together = extended.motion_between(before, after, np.zeros((6, 2)), 0.0)
    one_by_one = [extended.smooth_force(extended.motion_between(a, b, np.zeros(2), 0.0))
                  for a, b in zip(before, after)]
    np.testing.assert_allclose(extended.smooth_force(together), one_by_one, rtol=1e-11)


@pytest.mark.parametrize('follow', [False, True])
def test_compiled_forces_are_those_of_arrays(follow: bool) -> None:
    """Of steps by themselves and of steps that follow one another, with a gap between two."""
    extended, random = arm(*BOTH), np.random.default_rng(3)
    n, bent = extended.form.order, effect(BOTH[1])
    before, after = 0.1 * random.standard_normal((2, 6, 1, extended.states))
    if follow:
        before[1:3], before[4:] = after[:2], after[3:5]
    motion = extended.motion_between(before, after, np.zeros((6, 1, 2)), 0.0)
    terms = bending_terms(extended.form, extended.robot, PAYLOAD)
    np.testing.assert_allclose(bent.force(motion), bending_force(
        terms, motion.position, motion.velocity, (after - before)[..., :2 * n],
        extended.step_time), rtol=1e-9)
    np.testing.assert_allclose(bent.inertia(motion), bending_mass(terms, after[..., :n]),
                               rtol=1e-9, atol=1e-12)


def test_a_diagnosis_begins_with_all_of_them() -> None:
    """Without them a fast arm of finite elements, known in every part, is 300 nats off."""
    case = TruthCase(5, (('coriolis_centripetal', {'factor': 2.0}),), duration_s=20.0,
                     payload_true=PAYLOAD, payload_told=PAYLOAD, tolerances=False)
    log = make_record(case)
    record = Record('made', log.time, log.command, np.hstack([log.joint, log.strain]), PAYLOAD)
    base = nominal_base(ROBOT, 'assumed_modes', 3)
    kept = tuple(e for e in base.effects if e.identifier != 'foreshortening')
    data = Data.of([record], slowest_frequency(base, PAYLOAD), ROBOT.sample_time)
    errors = []
    for model in (base, replace(base, effects=kept)):
        likelihood = Likelihood(model, data.windows, data.noise)
        errors.append(np.sum(likelihood.whitened_residual((), np.zeros(len(likelihood.parts)))**2))
    assert 0.5 * (errors[1] - errors[0]) > 300.0
    told = replace(ROBOT, effects=(EffectSpec('foreshortening', 'arm', {'share': 0.0}),))
    assert [e['share'] for e in nominal_base(told, 'assumed_modes', 3).effects] == [0.0, 1.0]
    assert nominal_base(ROBOT, 'paper', 2).effects == ()


def test_it_brings_the_arm_to_the_finite_elements() -> None:
    """Swings with jumps of up to 2 rad/s: what is left is smaller by far than the forces."""
    time = 0.01 * np.arange(300.0)
    held = 1.2 * np.column_stack([np.sin(2 * time) + 0.4 * np.sign(np.sin(1.3 * time)),
                                  np.sin(3 * time) + 0.4 * np.sign(np.sin(1.7 * time))])
    motion = truth.simulate(reference_arm(PAYLOAD), command=held)
    true = np.hstack([motion.joint, motion.fine_strain[::motion.steps_per_sample]])
    misses = []
    for texts in (BOTH, BOTH[:1]):
        extended = arm(*texts, modes=5)
        stepper = Stepper.of(extended)
        assert stepper is not None
        states = stepper.run(np.zeros(extended.states), held,
                             np.zeros((300, extended.form.order)))
        found = states[:-1] @ extended.output_matrix.T
        misses.append(np.linalg.norm(found - true, axis=0)
                      / np.linalg.norm(true - true.mean(axis=0), axis=0))
    assert np.all(misses[0][:2] < 1e-4) and np.all(misses[0][2:] < 8e-3)
    assert np.all(misses[0] < 0.25 * misses[1])


def test_the_estimator_finds_nature_s_share_of_the_forces_of_motion() -> None:
    """On the finite elements, with noise; without what bent links add it finds 1.25."""
    time, random = 0.01 * np.arange(400.0), np.random.default_rng(2)
    held = 0.8 * np.column_stack([np.sin(2 * time) + 0.4 * np.sign(np.sin(1.3 * time)),
                                  np.sin(3 * time) + 0.4 * np.sign(np.sin(1.7 * time))])
    motion = truth.simulate(reference_arm(PAYLOAD), command=held)
    true = np.hstack([motion.joint, motion.fine_strain[::motion.steps_per_sample]])
    noise = np.array([ROBOT.angle_noise] * 2 + [ROBOT.strain_noise] * 4)
    estimator = RecursivePredictionError(ROBOT, 'assumed_modes', 3)
    before = np.vstack([np.zeros((1, 2)), held[:-1]])
    for sample in zip(time.tolist(), true + noise * random.standard_normal(true.shape), before):
        found = estimator.update(*sample)
    assert estimator.incumbent.beta[1] == pytest.approx(1.0, abs=0.06)
    assert found.mass == pytest.approx(PAYLOAD, rel=0.02)


def test_it_is_no_cause_to_be_named() -> None:
    assert effect(BOTH[1]).identifier in kinds() and 'foreshortening' not in catalogue()


@pytest.mark.parametrize('payload', [0.1, 0.3])
def test_an_arm_that_bends_beyond_the_order_stays_finite(payload: float) -> None:
    """Square commands of 5 rad/s on both joints bend the links by half their length."""
    bent = arm(*BOTH).at_payload(payload)
    time = ROBOT.sample_time * np.arange(400.0)
    command = 5.0 * np.where(time // 0.2 % 2 < 1, 1.0, -1.0)[:, None] * np.ones(2)
    stepper = Stepper.of(bent)
    assert stepper is not None
    states = stepper.run(np.zeros(bent.states), command, np.zeros((400, bent.form.order)))
    strain = states @ bent.output_matrix[2:].T
    assert 4e-3 < np.abs(strain).max() < 0.1
