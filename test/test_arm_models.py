"""The two arm models against the paper's text, finite elements and each other."""

from __future__ import annotations

from dataclasses import replace

from finite_elements import natural_frequencies
from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.paper_model import CompactModel, paper_model, Sign
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np
from paper_equations import constants_33, paper_residual
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
    three = locked_frequencies(assumed_modes(ROBOT, 3), theta_2, payload)[:4] / exact - 1.0
    assert np.all(np.abs(three[:2]) < 3e-4)
    assert np.all(np.abs(three) < (0.002 if payload else 0.01))
    ten = locked_frequencies(assumed_modes(ROBOT, 10), theta_2, payload)[:4] / exact - 1.0
    assert np.all(np.abs(ten) < 1e-4)


@pytest.mark.parametrize('offset', [-0.1, 0.1])
@pytest.mark.parametrize('theta_2', [0.0, 1.2])
def test_a_payload_beyond_the_tip_is_that_of_the_finite_elements(theta_2: float, offset: float
                                                                 ) -> None:
    robot = replace(ROBOT, payload_offset=offset)
    exact = natural_frequencies(robot, theta_2, 0.1)[:4]
    assert abs(exact[0] / natural_frequencies(ROBOT, theta_2, 0.1)[0] - 1.0) > 0.04
    found = locked_frequencies(assumed_modes(robot, 10), theta_2, 0.1)[:4]
    np.testing.assert_allclose(found, exact, rtol=1e-4)
    # In the paper's form the couple at the tip makes the root's moment an alternating series.
    paper = [locked_frequencies(paper_model(robot, n), theta_2, 0.1)[:4] for n in (20, 21)]
    np.testing.assert_allclose(np.mean(paper, axis=0), exact, rtol=0.015)


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
            + form.stiffness_at(0.3) @ state[0] - form.input_matrix @ command)[:2]
    for j, (drive, link) in enumerate(zip(ROBOT.drives, ROBOT.links)):
        bent = state[0, 2 + 3 * j:5 + 3 * j]
        moment = link.bending_stiffness * link.beam(3).shape(0.0, 2) @ bent
        k = constants_33(drive)
        turning = k.k_1 * command[j] + k.k_2 * moment + k.k_3 * state[1, j]
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
