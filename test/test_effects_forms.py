"""Effects in nature's other forms: slow loops, bristles, loose parts, sliding bases, one gauge."""

from __future__ import annotations

from dataclasses import replace

from bank.terms import hidden_terms
from extended_arms import arm, effect, frequencies, ROBOT, stiff
from flex_plant_sim.arm.robot import EffectSpec
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.likelihood.prior import log_prior_odds
from flex_plant_sim.effects import build, catalogue, sites
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
from msg_config.errors import InputError
import numpy as np
import pytest
from scipy.optimize import least_squares
from truth.configuration import reference_arm
from truth.effects import CATALOGUE
from truth.excitation import set_points
from truth.forms import FORMS
from truth.records import draw_case, HAVE_MUJOCO, make_record, MUJOCO, NO_MUJOCO

# Nothing but the rotors has inertia.
BARE = replace(stiff(ROBOT, density=1e-6), payload_mass=0.0, elbow_mass=0.0, elbow_inertia=0.0)
DRIVE = ROBOT.drives[0]
HELD = ['theta_1', 'theta_2', *(f'q_{link}{mode}' for link in (1, 2) for mode in (1, 2, 3))]


def response(extended: ExtendedArm, omega: float) -> Array:
    """Return the outputs' response to the commands at omega, rad/s, (m, 2)."""
    plant = extended.plant
    inverse = np.linalg.solve(1j * omega * np.eye(extended.states) - plant.a[3], plant.b[3])
    return np.asarray(plant.c[3] @ inverse)


@pytest.mark.parametrize('text, tau, lag', [
    ('drive_bandwidth:joint_1:time_constant_factor=2.5', 0.025, 0.0),
    ('motor_lag:joint_1:time_constant_s=0.03,inside_loop=1', 0.01, 0.03)])
def test_a_bare_rotor_follows_its_loop_s_transfer_function(text: str, tau: float,
                                                           lag: float) -> None:
    """J theta'' = M, M = J/tau (u - theta')/(lag s + 1)."""
    for omega in (2.0, 20.0, 90.0):
        s = 1j * omega
        expected = 1.0 / (s * (tau * s * (lag * s + 1.0) + 1.0))
        got = response(arm(text, robot=BARE), omega)[0, 0]
        assert abs(got / expected - 1.0) < 2e-3


def test_no_bandwidth_where_there_is_no_loop() -> None:
    current = load_robot('quanser_2dsfl')
    assert sites(catalogue()['drive_bandwidth'], current) == ()
    with pytest.raises(InputError, match='drive_bandwidth: site: expected none: this robot has '
                                         "no such place, got 'joint_1'"):
        build(EffectSpec('drive_bandwidth', 'joint_1', {'time_constant_factor': 2.0}), current)


def bristles(command: Array, forward: float, backward: float, stiffness: float, step: float
             ) -> Array:
    """Return a bare rotor's angle under a Maxwell-slip element, in small explicit steps, (S,)."""
    theta = speed = anchor = 0.0
    found, fine = [], round(step / 1e-4)
    for u in command:
        for _ in range(fine):
            anchor = min(max(anchor, theta - forward / stiffness), theta + backward / stiffness)
            torque = (DRIVE.torque_gain * u - DRIVE.damping * speed
                      - stiffness * (theta - anchor))
            speed += step / fine * torque / DRIVE.inertia
            theta += step / fine * speed
        found.append(theta)
    return np.array(found)


@pytest.mark.parametrize('text, levels', [
    ('presliding_friction:joint_1:level_n_m=2,travel_rad=0.01', (2.0, 2.0)),
    ('asymmetric_friction:joint_1:forward_n_m=1,backward_n_m=3,travel_rad=0.01', (1.0, 3.0)),
    # So fast that it is at the sum of its levels at any speed here.
    ('stribeck_friction:joint_1:level_n_m=0.5,extra_n_m=1.5,speed_rad_per_s=2,travel_rad=0.01',
     (2.0, 2.0))])
@pytest.mark.parametrize('step, tolerance', [(0.01, 0.06), (0.002, 0.015)])
def test_bristles_against_small_explicit_steps(text: str, levels: tuple[float, float],
                                               step: float, tolerance: float) -> None:
    sim = Simulator(arm(text, robot=replace(BARE, sample_time=step)))
    command = 0.4 * np.sin(3.0 * step * np.arange(round(3.0 / step)))
    expected, got = bristles(command, *levels, 2.0 / 0.01, step), []
    for u in command:
        sim.step(np.array([u, 0.0]))
        got.append(sim.state[0])
    assert np.abs(got - expected).max() < tolerance * np.ptp(expected)


def test_friction_is_dry_or_of_bristles_and_either_is_as_probable() -> None:
    robot = load_robot('reference')
    dry, yielding = (h for h in all_hypotheses(robot) if h.label == 'asymmetric_friction:joint_1')
    short = yielding.low[2]
    assert dry.low[2] == dry.high[2] == 0.0 and dry.switches == (True,)
    assert short > 0.0 and yielding.switches == (False,) and not yielding.prior(40.0).spiked.any()
    assert not dry.effect_at(np.array([0.2, 0.1, 0.0])).yielding().any()
    whole = log_prior_odds(catalogue()['coulomb_friction'], robot)
    assert log_prior_odds(dry.effect, robot) == pytest.approx(whole - np.log(2.0))


def test_bristles_are_stable_at_any_step_and_stiffness() -> None:
    """A spring of 10^6 N m/rad on the rotor at 20 Hz: no chatter, and it holds."""
    text = 'presliding_friction:joint_1:level_n_m=10,travel_rad=1e-5'
    sim = Simulator(arm(text, robot=replace(BARE, sample_time=0.05)))
    speeds = []
    for _ in range(200):
        sim.step(np.array([0.4, 0.0]))
        speeds.append(sim.state[sim.arm.form.order])
    assert abs(sim.state[0]) < 1.1e-5
    assert np.abs(speeds[-50:]).max() < 1e-9


def test_bristles_without_travel_are_dry_friction() -> None:
    motions = [simulate(Simulator(arm(text)), np.full((80, 2), [0.5, 0.6]))[0] for text in (
        'presliding_friction:joint_2:level_n_m=1,travel_rad=1e-5',
        'coulomb_friction:joint_2:level_n_m=1')]
    assert np.abs(motions[0] - motions[1]).max() < 1e-4 * np.abs(motions[1]).max()


@pytest.mark.parametrize('share', [1.0, 0.4])
def test_a_loose_share_swings_at_its_own_frequency(share: float) -> None:
    text = f'loose_payload:arm:compliance_m_per_n=0.02,damping_ratio=0,share={share}'
    form = arm(text).form
    assert frequencies(form, HELD, 0.1)[0] == pytest.approx((0.02 * share * 0.1)**-0.5, rel=1e-4)
    total = form.payload_mass_at(1.0)
    rigid = np.append(np.zeros(form.order - 1), 1.0)
    assert rigid @ total @ rigid == pytest.approx(share)


def test_a_hub_swings_on_its_gear() -> None:
    text = 'gear_compliance:joint_1:compliance_rad_per_n_m=0.01,sensor_behind_gear=1,hub_share=0.3'
    extended = arm(text, robot=BARE)
    swing = frequencies(extended.form, HELD, 0.0)[0]
    assert swing == pytest.approx((0.01 * 0.3 * DRIVE.inertia)**-0.5, rel=1e-4)
    # Far above that frequency the rotor alone is driven, far below it the whole joint.
    for omega, share in ((1.0, 1.0), (1e4, 0.7)):
        inertia = share * DRIVE.inertia * 1j * omega
        rotor = response(extended, omega)[0, 0]
        motor = response(arm(text.replace('gear=1', 'gear=0'), robot=BARE), omega)[0, 0]
        expected = DRIVE.torque_gain / (1j * omega * (inertia + DRIVE.damping))
        assert abs(motor / expected - 1.0) < 0.01
        assert abs(rotor / motor) == pytest.approx(1.0 if share == 1.0 else 0.0, abs=0.01)


@pytest.mark.parametrize('site, rows', [('arm', (2, 3, 4, 5)), ('link_2', (4, 5)),
                                        ('strain_1b', (3,))])
@pytest.mark.parametrize('text', ['strain_filter:{}:time_constant_s=0.04,damping=0.8',
                                  'strain_delay:{}:delay_s=0.02'])
def test_late_gauges_are_those_of_the_site(text: str, site: str, rows: tuple[int, ...]) -> None:
    s = 30.0j
    slow = (1.0 / (1.0 + 1.6 * 0.04 * s + (0.04 * s)**2) if 'filter' in text
            else np.exp(-0.02 * s))
    ratio = response(arm(text.format(site)), 30.0)[:, 0] / response(arm(), 30.0)[:, 0]
    expected = np.where(np.isin(np.arange(6), rows), slow, 1.0)
    np.testing.assert_allclose(ratio, expected, atol=1e-4)


@pytest.mark.skipif(not HAVE_MUJOCO, reason=NO_MUJOCO)
@pytest.mark.parametrize('name, form, shape', [
    ('base_sliding', '', {}), ('base_compliance', 'rubber', {'damping_ratio': 0.3}),
    ('payload_beside', '', {}), ('drive_integral', '', {}),
    ('loose_payload', 'half_loose', {'share': 0.5}), ('input_delay', 'one_drive', {}),
    ('motor_lag', 'inside_loop', {'inside_loop': 1.0}), ('presliding_friction', '', {}),
    ('gear_compliance', 'heavy_output', {'hub_share': 0.3}),
    ('backlash', 'soft_contact', {'hub_share': 0.05, 'contact_compliance_rad_per_n_m': 8.3e-4})])
def test_effects_explain_another_simulator_s_forms(name: str, form: str,
                                                   shape: dict[str, float]) -> None:
    """Open loop from the record's commands, the effect takes most of the error away."""
    case = replace(draw_case(name, 8, duration_s=2.5), noise=0.0, tolerances=False,
                   simulator=MUJOCO, forms=(form,) if form else ())
    record, (term,) = make_record(case), hidden_terms(case)
    kind = catalogue()[name]
    values = {p.name: p.null for p in kind.parameters} | shape | term.values
    if name == 'motor_lag':
        values['time_constant_s'] = term.size
    hidden = build(EffectSpec(name, term.site, values), ROBOT)
    nature = effect('coriolis_centripetal:arm:share=1')
    errors = []
    for effects in ((nature,), (nature, hidden)):
        extended = ExtendedArm(ROBOT, 'assumed_modes', 4, case.payload_true, effects)
        output = simulate(Simulator(extended), record.command)[0]
        errors.append(np.linalg.norm(output - record.table[:, 3:], axis=0)[2:])
    assert np.all(errors[1] < 0.35 * errors[0])


def fitted_spring(command: Array, elbow: Array) -> Array:
    """Return stiffness, N m/rad, and rest, rad, of the spring that explains elbow angles best."""
    def error(size: Array) -> Array:
        text = f'joint_spring:joint_2:stiffness_n_m_per_rad={size[0]},rest_rad={size[1]}'
        extended = arm('coriolis_centripetal:arm:share=1', text)
        return np.asarray(simulate(Simulator(extended), command)[0][:, 1] - elbow)
    return np.asarray(least_squares(error, [4.0, 0.0], diff_step=1e-3, xtol=1e-3).x)


@pytest.mark.parametrize('joint, rest', [(2, 0.3), (1, -0.2)])
def test_the_hose_of_the_bank_is_as_stiff_as_the_spring_where_it_is_loose(
        joint: int, rest: float) -> None:
    sprung = CATALOGUE['joint_spring'].apply(reference_arm(0.1), {
        'joint': joint, 'rest': rest, 'stiffness': 1.7})
    hose = FORMS['hose'](sprung)
    assert not any(joint.spring for joint in hose.joints)
    s = hose.structure

    def energy(angle: float) -> float:
        """Return that of a spring from beside the upper link's end to a point on the lower."""
        def length(at: float) -> float:
            return float(abs(1j * s.hose_reach - s.hose_reach * np.exp(1j * at)))
        return 0.5 * s.hose_stiffness * (length(angle) - length(s.hose_rest))**2
    step = 1e-3
    around = [energy(rest + k * step) for k in (-1, 0, 1)]
    assert around[1] == pytest.approx(0.0, abs=1e-15)
    assert (around[0] - 2.0 * around[1] + around[2]) / step**2 == pytest.approx(1.7, rel=1e-4)


@pytest.mark.skipif(not HAVE_MUJOCO, reason=NO_MUJOCO)
def test_a_hose_across_the_elbow_is_a_spring_about_where_it_is_loose() -> None:
    """Its pull k (l - l_0) times its lever is no line: the best one over the angles visited."""
    from truth.mujoco.simulation import simulate as moved
    k, reach, rest = 800.0, 0.1, 0.2
    nature = reference_arm(ROBOT.payload_mass)
    nature = replace(nature, structure=replace(
        nature.structure, hose_stiffness=k, hose_reach=reach, hose_rest=rest))
    time = np.linspace(0.0, 9.99, 1000)
    goal = set_points(np.random.default_rng(4), time, nature.excitation)
    record = moved(nature, reference=goal)
    angle = record.joint[:, 1]
    # Both ends are at `reach` from the elbow, a right angle apart where the arm is straight.
    half = np.pi / 4.0 - 0.5 * angle
    stretch = 2.0 * reach * (np.sin(half) - np.sin(np.pi / 4.0 - 0.5 * rest))
    slope, offset = np.polyfit(angle, k * stretch * reach * np.cos(half), 1)
    stiffness, loose = fitted_spring(record.command, angle)
    assert stiffness == pytest.approx(-slope, rel=0.05)
    assert loose == pytest.approx(-offset / slope, abs=0.02)
