"""The paper's compact form (10)-(16) against its text, its transfer function and its limit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from flex_plant_sim.arm.paper_model import CompactModel, paper_model
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import state_space
from msg_config.errors import InputError
import numpy as np
from paper_equations import constants_33, paper_residual
import pytest

ROBOT = load_robot('reference')


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


def test_a_drive_that_nothing_damps_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match='paper_reduced divides by the damping .* got 0$'):
        CompactModel(ROBOT.with_drive(1, damping=0.0), 2)


def test_m_4_vanishes() -> None:
    """Misprint 3: k_21 u_2 + k_23 theta_2' = -k_22 M_b2 by (2), so nothing is left for M_4."""
    model, rng = CompactModel(ROBOT, 3), np.random.default_rng(5)
    form = model.at(0.4)
    assert not np.any(form.m_4)
    q, command = rng.standard_normal(6), rng.standard_normal(2)
    rates = form.m_6 @ q + form.m_7 @ command
    for j, (drive, link) in enumerate(zip(ROBOT.drives, ROBOT.links)):
        moment = link.bending_stiffness * link.beam(3).shape(0.0, 2) @ q[3 * j:3 * j + 3]
        k = constants_33(drive)
        bracket = k.k_1 * command[j] + k.k_3 * rates[j]
        assert bracket == pytest.approx(-k.k_2 * moment, rel=1e-10)


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
