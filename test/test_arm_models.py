"""The two arm models against the paper's text, finite elements and each other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from finite_elements import natural_frequencies
from flex_plant_sim.arm_model import Array, SecondOrderForm
from flex_plant_sim.assumed_modes import assumed_modes
from flex_plant_sim.extended_arm import ExtendedArm
from flex_plant_sim.paper_model import CompactModel, paper_model, Sign
from flex_plant_sim.robot import load_robot, Robot
from flex_plant_sim.state_space import state_space
import numpy as np
import pytest
from scipy.linalg import eigh

ROBOT = load_robot('reference')
# theta_2, payload, joint-locked frequencies of the design notes, rad/s.
NOTES = [(0.0, 0.1, [7.87, 25.47, 143.4, 218.8]), (np.pi / 2.0, 0.1, [9.45, 19.36, 142.5, 212.7]),
         (0.0, 0.0, [10.15, 39.30, 166.5, 254.2])]
CASES = [case[:2] for case in NOTES]


def locked_frequencies(form: SecondOrderForm, theta_2: float, payload: float) -> Array:
    mass = form.mass_at(np.cos(theta_2), payload)[2:, 2:]
    stiffness = form.stiffness_at(np.cos(theta_2))[2:, 2:]
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness))
    return np.sqrt(np.sort_complex(squares).real)


@pytest.mark.parametrize('theta_2, payload, expected', NOTES)
def test_finite_elements_of_the_tests_agree_with_the_design_notes(
        theta_2: float, payload: float, expected: list[float]) -> None:
    found = natural_frequencies(ROBOT, theta_2, payload)[:4]
    np.testing.assert_allclose(found, expected, rtol=6e-4)


@pytest.mark.parametrize('theta_2, payload', CASES)
def test_paper_model_converges_to_the_finite_elements(theta_2: float, payload: float) -> None:
    exact = natural_frequencies(ROBOT, theta_2, payload)[:4]
    errors = [np.abs(locked_frequencies(paper_model(ROBOT, n), theta_2, payload)[:4] / exact - 1.0)
              for n in (2, 5, 10)]
    assert np.all(errors[2] < 0.02)
    assert np.max(errors[0]) > np.max(errors[1]) > np.max(errors[2])


@pytest.mark.parametrize('theta_2, payload', CASES)
def test_assumed_modes_agree_with_the_finite_elements(theta_2: float, payload: float) -> None:
    exact = natural_frequencies(ROBOT, theta_2, payload)[:4]
    three = locked_frequencies(assumed_modes(ROBOT, 3), theta_2, payload)[:2] / exact[:2] - 1.0
    assert np.all(np.abs(three) < 0.002)
    ten = locked_frequencies(assumed_modes(ROBOT, 10), theta_2, payload)[:4] / exact - 1.0
    assert np.all(np.abs(ten) < 1e-4)


@pytest.mark.parametrize('name', ['reference', 'quanser_2dsfl'])
def test_assumed_modes_converge_from_above(name: str) -> None:
    """Rayleigh-Ritz: every frequency lies above the exact one and falls with more shapes."""
    robot = load_robot(name)
    exact = natural_frequencies(robot, 0.7, robot.payload_mass)[:4]
    found = [locked_frequencies(assumed_modes(robot, n), 0.7, robot.payload_mass)[:4]
             for n in (2, 3, 5, 8)]
    assert np.all(found[-1] > exact * (1.0 - 1e-6))
    assert np.all(np.diff(found, axis=0) < 1e-9 * exact)
    np.testing.assert_allclose(found[-1], exact, rtol=2e-4)


def test_the_two_models_tend_to_the_same_arm() -> None:
    paper = locked_frequencies(paper_model(ROBOT, 20), 0.4, 0.2)[:4]
    modes = locked_frequencies(assumed_modes(ROBOT, 8), 0.4, 0.2)[:4]
    np.testing.assert_allclose(paper, modes, rtol=0.01)


@pytest.mark.parametrize('modes', [1, 2, 3, 6, 10, 20])
@pytest.mark.parametrize('name', ['reference', 'quanser_2dsfl'])
def test_mass_matrix_is_symmetric_and_definite(name: str, modes: int) -> None:
    form = assumed_modes(load_robot(name), modes)
    scale = np.sqrt(np.diag(form.mass_at(1.0, 0.0)))
    for cosine in np.linspace(-1.0, 1.0, 9):
        for payload in (0.0, 0.1, 0.5, 5.0):
            mass = form.mass_at(cosine, payload)
            np.testing.assert_allclose(mass, mass.T, rtol=0.0, atol=1e-12 * np.max(mass))
            assert eigh(mass / np.outer(scale, scale), eigvals_only=True)[0] > 0.0


def rigid_mass(robot: Robot, theta_2: float, payload: float) -> Array:
    """Return the textbook mass matrix of a rigid two-link arm (Craig, chapter 6), no hubs."""
    (upper, lower), c = robot.links, np.cos(theta_2)
    l_1, l_2 = upper.length, lower.length
    own_1 = upper.mass * l_1**2 / 3.0 + robot.elbow_mass * l_1**2 + robot.elbow_inertia
    own_2 = lower.mass * l_2**2 / 3.0 + payload * l_2**2
    cross = (lower.mass * l_2 / 2.0 + payload * l_2) * l_1 * c
    carried = (lower.mass + payload) * l_1**2
    return np.array([[own_1 + carried + own_2 + 2.0 * cross, own_2 + cross],
                     [own_2 + cross, own_2]])


@pytest.mark.parametrize('theta_2', [0.0, 0.9, np.pi])
def test_rigid_block_is_the_textbook_s(theta_2: float) -> None:
    rotors = np.diag([drive.inertia for drive in ROBOT.drives])
    for payload in (0.0, 0.3):
        block = assumed_modes(ROBOT, 3).mass_at(np.cos(theta_2), payload)[:2, :2]
        np.testing.assert_allclose(block, rotors + rigid_mass(ROBOT, theta_2, payload), rtol=1e-12)


def paper_residual(robot: Robot, modes: int, theta_2: float, payload: float, state: Array,
                   sign: Sign) -> Array:
    """
    Return left minus right side of (6) and (4), term by term from the text; (2 modes,).

    Parameters
    ----------
    robot : Robot
        Without hub radius.
    modes : int
        n.
    theta_2 : float
        rad.
    payload : float
        m_p, kg.
    state : Array
        Rows p, p', p''; (3, 2 + 2n).
    sign : str
        Sign of M_e in (43).

    """
    (upper, lower), n = robot.links, modes
    beam_1, beam_2 = upper.beam(n), lower.beam(n)
    tip_1, slope_1 = beam_1.shape(upper.length), beam_1.shape(upper.length, 1)
    tip_2 = beam_2.shape(lower.length)
    mu_1, mu_2 = beam_1.modal_mass, beam_2.modal_mass
    q_1, q_2 = state[:, 2:2 + n], state[:, 2 + n:]
    turn_1, turn_2 = state[2, 0], state[2, 1]
    elbow = upper.length * turn_1 + sum(tip_1[j] * q_1[2, j] for j in range(n))
    elbow_turn = turn_1 + sum(slope_1[j] * q_1[2, j] for j in range(n))
    moment = lower.bending_stiffness * sum(beam_2.shape(0.0, 2)[j] * q_2[0, j] for j in range(n))
    shear = lower.bending_stiffness * sum(beam_2.shape(0.0, 3)[j] * q_2[0, j] for j in range(n))
    reaction = (shear * np.cos(theta_2)
                + (lower.mass + payload) * np.sin(theta_2)**2 * elbow)
    flip = 1.0 if sign == 'corrected' else -1.0
    torque = flip * (-robot.elbow_inertia * elbow_turn + moment)
    rows = []
    for i in range(n):
        zeta = upper.damping_ratio * beam_1.frequencies[i] / beam_1.frequencies[0]
        left = (beam_1.frequencies[i]**2 * q_1[0, i]
                + 2.0 * zeta * beam_1.frequencies[i] * q_1[1, i] + q_1[2, i])
        hub = -robot.elbow_mass / mu_1 * tip_1[i] * elbow
        rows.append(left - (beam_1.alpha[i] * turn_1 + hub - reaction / mu_1 * tip_1[i]
                            + slope_1[i] / mu_1 * torque))
    for i in range(n):
        zeta = lower.damping_ratio * beam_2.frequencies[i] / beam_2.frequencies[0]
        left = (beam_2.frequencies[i]**2 * q_2[0, i]
                + 2.0 * zeta * beam_2.frequencies[i] * q_2[1, i] + q_2[2, i])
        alpha = beam_2.alpha[i] - payload / mu_2 * lower.length * tip_2[i]
        beta = beam_2.beta[i] - payload / mu_2 * tip_2[i]
        kappa = [-payload / mu_2 * tip_2[i] * tip_2[j] for j in range(n)]
        rows.append(left - (sum(kappa[j] * q_2[2, j] for j in range(n))
                            + alpha * (turn_2 + elbow_turn) + beta * elbow * np.cos(theta_2)))
    return np.array(rows)


@pytest.mark.parametrize('sign', ['corrected', 'as_printed'])
@pytest.mark.parametrize('modes', [1, 2, 4])
def test_paper_model_term_by_term(modes: int, sign: Sign) -> None:
    """Misprints 1, 2 and 7: the form is (4) and (6) with M_e and F_ye as corrected."""
    rng = np.random.default_rng(modes)
    form = paper_model(ROBOT, modes, sign)
    scale = np.repeat([link.beam(1).modal_mass for link in ROBOT.links], modes)
    for theta_2, payload in [(0.0, 0.0), (0.6, 0.1), (-1.9, 0.3), (np.pi / 2.0, 1.0)]:
        state = rng.standard_normal((3, 2 + 2 * modes))
        rows = (form.mass_at(np.cos(theta_2), payload) @ state[2] + form.damping @ state[1]
                + form.stiffness_at(np.cos(theta_2)) @ state[0])[2:] / scale
        expected = paper_residual(ROBOT, modes, theta_2, payload, state, sign)
        np.testing.assert_allclose(rows, expected, rtol=1e-9, atol=1e-9 * np.max(np.abs(expected)))


def test_shoulder_and_elbow_rows_are_the_full_actuators_32() -> None:
    form, rng = paper_model(ROBOT, 3), np.random.default_rng(1)
    state, command = rng.standard_normal((3, 8)), rng.standard_normal(2)
    rows = (form.mass_at(0.3, 0.1) @ state[2] + form.damping @ state[1]
            + form.stiffness_at(0.3) @ state[0] - form.input @ command)[:2]
    for j, (drive, link) in enumerate(zip(ROBOT.drives, ROBOT.links)):
        bent = state[0, 2 + 3 * j:5 + 3 * j]
        moment = link.bending_stiffness * link.beam(3).shape(0.0, 2) @ bent
        turning = drive.k_1 * command[j] + drive.k_2 * moment + drive.k_3 * state[1, j]
        assert rows[j] / drive.inertia == pytest.approx(state[2, j] - turning, rel=1e-11)


def test_as_printed_the_arm_is_unstable() -> None:
    """
    Misprint 1: empty and stretched, with n = 2, poles at +19 +- 220j; corrected, none.

    Reduced actuators; the double pole at zero is the two joint angles.
    """
    poles = {sign: np.linalg.eigvals(CompactModel(ROBOT, 2, sign).at(0.0).state_space(0.0)[0])
             for sign in ('corrected', 'as_printed')}
    worst = poles['as_printed'][np.argmax(poles['as_printed'].real)]
    assert (round(worst.real), round(abs(worst.imag))) == (19, 220)
    assert np.max(poles['corrected'].real) < 1e-9


def test_as_printed_is_unstable_at_every_angle_and_payload() -> None:
    corrected, printed = CompactModel(ROBOT, 2), CompactModel(ROBOT, 2, 'as_printed')
    for theta_2 in np.linspace(0.0, np.pi, 7):
        for payload in (0.0, 0.1, 0.3):
            poles = [np.linalg.eigvals(model.at(theta_2).state_space(payload)[0])
                     for model in (corrected, printed)]
            assert np.max(poles[0].real) < 1e-9
            assert np.max(poles[1].real) > 1.0


@pytest.mark.parametrize('model', ['paper', 'assumed_modes', 'paper_reduced'])
@pytest.mark.parametrize('modes', [1, 2, 3, 5])
def test_corrected_models_are_stable(model: str, modes: int) -> None:
    poles = np.linalg.eigvals(ExtendedArm(ROBOT, model, modes).plant.a)
    assert np.max(poles.real) < 1e-7


@pytest.mark.parametrize('payload', [0.0, 0.07, 0.4])
def test_affine_in_the_payload_14(payload: float) -> None:
    """M_2, M_3 and M_5 at a payload are M^0 + m_p M^m to the last digit of (4), (6) and (11)."""
    modes, theta_2 = 2, 0.8
    model, rng = CompactModel(ROBOT, modes), np.random.default_rng(3)
    form = model.at(theta_2)
    q, rate, swing = rng.standard_normal((3, 2 * modes))
    command, command_rate = rng.standard_normal((2, 2))
    turn = form.m_6 @ rate + form.m_7 @ command_rate
    state = np.zeros((3, 2 + 2 * modes))
    state[:, 2:], state[2, :2] = [q, rate, swing], turn
    residual = paper_residual(ROBOT, modes, theta_2, payload, state, 'corrected')
    right = (form.m_1 @ q + form.at('m_2', payload) @ rate + form.at('m_3', payload) @ swing
             + form.m_4 @ command + form.at('m_5', payload) @ command_rate)
    np.testing.assert_allclose(swing - right, residual, rtol=1e-9,
                               atol=1e-10 * np.max(np.abs(residual)))


def test_m_4_vanishes() -> None:
    """Misprint 3: k_21 u_2 + k_23 theta_2' = -k_22 M_b2 by (2), so nothing is left for M_4."""
    model, rng = CompactModel(ROBOT, 3), np.random.default_rng(5)
    form = model.at(0.4)
    assert not np.any(form.m_4)
    q, command = rng.standard_normal(6), rng.standard_normal(2)
    rates = form.m_6 @ q + form.m_7 @ command
    for j, (drive, link) in enumerate(zip(ROBOT.drives, ROBOT.links)):
        moment = link.bending_stiffness * link.beam(3).shape(0.0, 2) @ q[3 * j:3 * j + 3]
        bracket = drive.k_1 * command[j] + drive.k_3 * rates[j]
        assert bracket == pytest.approx(-drive.k_2 * moment, rel=1e-10)


def test_equation_60_swaps_m_6_and_m_7() -> None:
    """Misprint 8: M_6 multiplies q (2n), M_7 the two commands; swapped, the sizes disagree."""
    form = CompactModel(ROBOT, 3).at(0.0)
    assert form.m_6.shape == (2, 6)
    assert form.m_7.shape == (2, 2)
    np.testing.assert_allclose(np.diag(form.m_7), [1.0, 1.0], rtol=1e-14)


def flexible_response(model: CompactModel, theta_2: float, payload: float, s: complex) -> Any:
    """Return q(s) / u(s) from (10) itself, (2n, 2)."""
    form = model.at(theta_2)
    size = len(form.m_1)
    left = (s * s * (np.eye(size) - form.at('m_3', payload)) - s * form.at('m_2', payload)
            - form.m_1)
    return np.linalg.solve(left, form.m_4 + s * form.at('m_5', payload))


@pytest.mark.parametrize('s', [0.3 + 1.0j, 2.0j, -1.0 + 30.0j, 400.0j])
def test_state_of_equation_12(s: complex) -> None:
    """
    Misprint 5: the third block is q' - Lambda M_5 u, and with it (12) is (10) exactly.

    Read as q' + M_5 u or as q' - M_5 u, q' is not the derivative of q.
    """
    model, theta_2, payload = CompactModel(ROBOT, 2), 0.5, 0.1
    form = model.at(theta_2)
    a, b = form.state_space(payload)
    x = np.linalg.solve(s * np.eye(len(a)) - a, b)
    exact = flexible_response(model, theta_2, payload, s)
    np.testing.assert_allclose(x[2:6], exact, rtol=1e-8, atol=1e-12)
    m_5 = form.at('m_5', payload)
    right = x[6:] + form.lam(payload) @ m_5
    np.testing.assert_allclose(right, s * exact, rtol=1e-7, atol=1e-10)
    for wrong in (x[6:] - m_5, x[6:] + m_5):
        assert np.max(np.abs(wrong - s * exact)) > 0.05 * np.max(np.abs(m_5))


def test_split_15_needs_the_payload_free_m_5() -> None:
    """Misprint 15: B^0 of (15) has Lambda M_5^0; with Lambda M_5, (13) counts m_p twice."""
    payload, form = 0.2, CompactModel(ROBOT, 2).at(0.3)
    lam, (m_20, m_2m), (m_50, m_5m) = form.lam(payload), form.m_2, form.m_5
    lower = (lam @ m_20 @ lam @ m_50 + payload**2 * lam @ m_2m @ lam @ m_5m + lam @ form.m_4)
    slope = lam @ m_2m @ lam @ m_50 + lam @ m_20 @ lam @ m_5m
    b = form.state_space(payload)[1]
    np.testing.assert_allclose(lower + payload * slope, b[6:], rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(lam @ m_50 + payload * lam @ m_5m, b[2:6], rtol=1e-12, atol=1e-12)
    printed = lam @ form.at('m_5', payload) + payload * lam @ m_5m
    assert np.max(np.abs(printed - b[2:6])) > 0.05 * np.max(np.abs(b[2:6]))


def test_output_matrix_17() -> None:
    """
    Misprints 6 and 16: C has zeros for the third state block, and its first rows are angles.

    Strain is b/2 w''; two rows on each link's own q.
    """
    for model, states in (('paper_reduced', 10), ('paper', 12), ('assumed_modes', 12)):
        arm = ExtendedArm(ROBOT, model, 2)
        c = arm.output_matrix
        assert c.shape == (6, states)
        assert not np.any(c[:, 6:])
        np.testing.assert_array_equal(c[:2], np.eye(2, states))
        assert not np.any(c[2:4, 4:]) and not np.any(c[4:, 2:4])
        assert not np.any(c[2:, :2])
    link = ROBOT.links[1]
    rows = 0.5 * link.thickness * link.beam(2).shape(np.array([0.025, 0.25]), 2)
    np.testing.assert_allclose(ExtendedArm(ROBOT, 'paper', 2).output_matrix[4:, 4:6], rows,
                               rtol=1e-14)


def test_strain_under_a_tip_force_is_the_textbook_s() -> None:
    """Stress resultant at the gauge: epsilon = b F (L - x) / 2EI, exact with two Ritz shapes."""
    link, form = ROBOT.links[1], assumed_modes(ROBOT, 2)
    push = form.payload_mass[0, 4:, 1] / link.length  # phi_2(L), from the payload's row
    q = np.linalg.solve(form.stiffness[0, 4:, 4:], push)
    lever = link.length - np.array(link.gauge_positions)
    np.testing.assert_allclose(form.strain[2:, 4:] @ q,
                               0.5 * link.thickness * lever / link.bending_stiffness, rtol=1e-9)


def slow_poles(a: Array) -> Array:
    poles = np.linalg.eigvals(a)
    return np.sort_complex(poles[(np.abs(poles) < 60.0) & (poles.imag > 0.1)])


def test_reduced_model_is_the_limit_of_fast_drives() -> None:
    """The poles of (12) and of the full form (32) approach each other as tau does zero."""
    differences = []
    for tau in (1e-3, 1e-4, 1e-5):
        drives = [replace(d, damping=d.inertia / tau, torque_gain=d.inertia / tau)
                  for d in ROBOT.drives]
        robot = replace(ROBOT, drives=(drives[0], drives[1]))
        full = slow_poles(state_space(paper_model(robot, 2), np.cos(0.5), 0.1).a)
        reduced = slow_poles(CompactModel(robot, 2).at(0.5).state_space(0.1)[0])
        differences.append(np.max(np.abs(full - reduced)))
    assert differences[-1] < 1e-3
    orders = np.log10(np.array(differences[:-1]) / differences[1:])
    assert np.all(orders > 0.9)


def test_end_point_weight_leaves_an_integrator_free() -> None:
    """
    Misprint 11: C'^T C' sees one combination of the joint angles, C_theta as well sees both.

    Popov-Belevitch-Hautus at the double pole zero of (12).
    """
    form = CompactModel(ROBOT, 2).at(0.3)
    a, _ = form.state_space(0.1)
    end_point = np.zeros((1, len(a)))
    end_point[0, 1] = 1.0
    end_point[0, 4:6] = ROBOT.links[1].beam(2).shape(0.5) / 0.5
    angles = np.eye(2, len(a))
    assert np.linalg.matrix_rank(np.vstack([a, end_point])) == len(a) - 1
    assert np.linalg.matrix_rank(np.vstack([a, angles, end_point])) == len(a)
