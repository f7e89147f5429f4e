"""A velocity loop's integrator: against closed forms, sampled controllers, and beside rivals."""

from __future__ import annotations

from dataclasses import replace

from extended_arms import arm, effect, ROBOT, stiff
from flex_plant_sim.diagnosis.causes.search import search
from flex_plant_sim.diagnosis.prediction.added_states import integrals
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base
from flex_plant_sim.effects import catalogue
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
import numpy as np
import pytest
from simulated_records import predictor, simulated, SLOWEST
from truth.configuration import reference_arm
from truth.records import (
    FINITE_ELEMENTS,
    HAVE_MUJOCO,
    make_record,
    MUJOCO,
    NO_MUJOCO,
    TruthCase,
)
from truth.simulation import simulate as simulate_elements

# Nothing but the rotors has inertia.
BARE = replace(stiff(ROBOT, density=1e-6), payload_mass=0.0, elbow_mass=0.0, elbow_inertia=0.0)
RATE, TAU, LAG, SPEED = 8.0, 0.01, 0.03, 0.2
DAMPING = ROBOT.drives[0].damping
INTEGRAL = f'drive_integral:joint_1:integral_rate_per_s={RATE}'
RIVALS = ('drive_integral', 'drive_bandwidth', 'viscous_friction', 'joint_spring')


def response(extended: ExtendedArm, omega: float) -> complex:
    """Return joint 1's response to its command at omega, rad/s."""
    plant = extended.plant
    inverse = np.linalg.solve(1j * omega * np.eye(extended.states) - plant.a[3], plant.b[3])
    return complex((plant.c[3] @ inverse)[0, 0])


def late_speed(*texts: str) -> float:
    """Return joint 1's mean speed, rad/s, from 3 to 4 s of a constant command."""
    command = np.tile([SPEED, 0.0], (401, 1))
    angle = simulate(Simulator(arm(*texts, robot=BARE)), command)[0][:, 0]
    return float(angle[400] - angle[300])


def test_a_bare_rotor_has_the_poles_of_a_pi_loop() -> None:
    """Of J theta'' = d (k u - theta') + w d z: tau s^2 + s + w = 0, beside that of the angle."""
    poles = np.linalg.eigvals(arm(INTEGRAL, robot=BARE).plant.a[3])
    for pole in np.roots([TAU, 1.0, RATE]):
        assert np.min(np.abs(poles - pole)) < 2e-3 * abs(pole)


@pytest.mark.parametrize('inside', [0.0, 0.6, 1.0])
@pytest.mark.parametrize('integral_first', [True, False])
def test_a_lag_acts_on_the_integral_as_well(inside: float, integral_first: bool) -> None:
    """Whichever is named first, the loop integrates what its lag lets through."""
    lag = f'motor_lag:joint_1:time_constant_s={LAG},inside_loop={inside}'
    both = (INTEGRAL, lag) if integral_first else (lag, INTEGRAL)
    for omega in (1.0, 8.0, 60.0):
        s = 1j * omega
        slow = 1.0 / (LAG * s + 1.0)
        # tau s^2 theta = (1 + w / s) (slow (u - inside s theta) - (1 - inside) s theta)
        loop, seen = 1.0 + RATE / s, 1.0 - inside + inside * slow
        expected = loop * slow / (TAU * s**2 + loop * seen * s)
        assert response(arm(*both, robot=BARE), omega) == pytest.approx(expected, rel=3e-3)


def test_a_spring_stops_a_p_loop_and_slows_a_pi_loop() -> None:
    """P: s theta = d k u, at rest. PI: s v = w d (k u - v), at the speed v."""
    stiffness = 40.0
    spring = f'joint_spring:joint_1:stiffness_n_m_per_rad={stiffness},rest_rad=0'
    assert late_speed(spring) == pytest.approx(0.0, abs=5e-3 * SPEED)
    assert late_speed(spring, INTEGRAL) == pytest.approx(
        SPEED / (1.0 + stiffness / (RATE * DAMPING)), rel=1e-3)


@pytest.mark.parametrize('swap', [False, True])
def test_friction_slows_a_p_loop_and_no_pi_loop(swap: bool) -> None:
    """Friction is no part of the loop's error, whichever of both is named first."""
    friction = 'viscous_friction:joint_1:damping_n_m_s=5'
    texts = (friction, INTEGRAL) if swap else (INTEGRAL, friction)
    assert late_speed(friction) == pytest.approx(SPEED / (1.0 + 5.0 / DAMPING), rel=1e-3)
    assert late_speed(*texts) == pytest.approx(SPEED, rel=1e-3)


def test_the_sampled_loop_of_finite_elements_is_the_continuous_one() -> None:
    """A rigid arm's joint 1 under steps of the command; the truth's integrator is sampled."""
    command = np.zeros((150, 2))
    command[:60, 0], command[60:110, 0] = 0.6, -0.8
    true = reference_arm(0.1)
    first = replace(true.joints[0], integral_rate=RATE)
    motion = simulate_elements(replace(true, joints=(first, true.joints[1])), command=command)
    found, plain = (simulate(Simulator(arm(*more, modes=4).at_payload(0.1)), command)[0][:, 0]
                    for more in ((INTEGRAL,), ()))
    assert np.linalg.norm(found - motion.joint[:, 0]) < 0.05 * np.linalg.norm(found - plain)


def test_what_it_has_summed_up_is_known_from_commands_and_angles() -> None:
    """Windows start within a record; the integral there is not at rest."""
    extended, rng = arm(INTEGRAL, 'actuator_bias:joint_1:bias=0.05'), np.random.default_rng(4)
    command = np.repeat(rng.uniform(-0.5, 0.5, (6, 2)), 40, axis=0)
    states = Simulator(extended).advance(command, np.zeros((240, 2)))[0]
    record = Record('simulated', 0.01 * np.arange(240.0), command, states[:, :6], 0.1)
    last = extended.states - 1
    others = np.hstack([states[:, :last], np.zeros((240, 1))])
    found = integrals(extended, np.array([last]), others, record)
    np.testing.assert_allclose(found[:, 0], states[:, last], atol=1e-9)


def test_no_integrator_without_a_rate() -> None:
    assert arm('drive_integral:joint_2:integral_rate_per_s=0').states == arm().states
    assert effect(INTEGRAL).index == 0


@pytest.mark.parametrize('simulator, joint', [
    (FINITE_ELEMENTS, 1), pytest.param(MUJOCO, 2, marks=pytest.mark.skipif(
        not HAVE_MUJOCO, reason=NO_MUJOCO))])
def test_an_integrator_is_named_at_its_joint_with_its_rate(simulator: str, joint: int) -> None:
    """The rate is about four detection limits."""
    case = TruthCase(3, (('drive_integral', {'joint': joint, 'rate': 2.0}),), duration_s=13.0,
                     tolerances=False, simulator=simulator)
    truth = make_record(case)
    record = Record('truth', truth.time, truth.command, np.hstack([truth.joint, truth.strain]),
                    0.1)
    with np.errstate(all='ignore'):
        found = search(Data.of([record], SLOWEST, ROBOT.sample_time),
                       nominal_base(ROBOT, 'assumed_modes', 2), 1, lambda *told: None,
                       [name for name in catalogue() if name not in RIVALS]).posterior
    best = found.fits[0]
    assert [h.label for h in best.hypotheses] == [f'drive_integral:joint_{joint}']
    assert found.effect_probability('drive_integral') > 0.8
    deviation = float(np.sqrt(best.covariance[0, 0]))
    assert abs(best.values[0] - 2.0) < 3.0 * deviation < 1.5


def test_a_filter_corrects_what_the_first_sample_puts_into_an_integral() -> None:
    """Without, a first angle off by its noise was told as something unnamed (1.00)."""
    record = simulated((effect(INTEGRAL),), 12.0)
    filtering = predictor(record, (effect(INTEGRAL),))
    arm, gain = filtering.arm, filtering.gain[0]
    table = arm.schedule.table.reshape(arm.nodes.size, arm.states, -1)[0, :, :arm.states]
    assert np.max(np.abs(np.linalg.eigvals(table - gain @ arm.output_matrix))) < 0.99
