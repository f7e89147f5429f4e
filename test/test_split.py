"""The split (13): as printed (15), (16), by the resolvent identity, and tangent."""

from __future__ import annotations

import math

from flex_payload_estimator.model.payload_model import payload_model, PayloadModel
from flex_payload_estimator.model.split import CompactTerms, KINDS, split_compact, SplitKind
from flex_plant_sim.arm.paper_model import CompactModel
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.state_space import state_space
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from msg_config.errors import InputError
import numpy as np
import pytest

ROBOT = load_robot('reference')
COSINE, MASS = math.cos(0.7), 0.13


def central_difference(model: PayloadModel, mass: float, h: float = 1e-5) -> np.ndarray:
    """Return d(A B)/dm_p of fourth order."""
    def joined(m: float) -> np.ndarray:
        return np.hstack(model.matrices(COSINE, m))
    near, far = joined(mass + h) - joined(mass - h), joined(mass + 2 * h) - joined(mass - 2 * h)
    return (8.0 * near - far) / (12.0 * h)


@pytest.mark.parametrize('modes', [1, 2, 5])
@pytest.mark.parametrize('kind', KINDS)
def test_13_holds(kind: SplitKind, modes: int) -> None:
    form = CompactModel(ROBOT, modes).at(0.7)
    split = split_compact(CompactTerms.of(form), MASS, kind)
    a, b = form.state_space(MASS)
    scale_a, scale_b = np.abs(a).max(), np.abs(b).max()
    np.testing.assert_allclose(split.a_0 + MASS * split.a_m, a, rtol=0, atol=1e-12 * scale_a)
    np.testing.assert_allclose(split.b_0 + MASS * split.b_m, b, rtol=0, atol=1e-12 * scale_b)


def test_the_printed_split_is_15_and_16() -> None:
    form = CompactModel(ROBOT, 2).at(0.7)
    split = split_compact(CompactTerms.of(form), MASS, 'paper')
    lam, (m_20, m_2m), (m_50, m_5m) = form.lam(MASS), form.m_2, form.m_5
    a_m, b_m, a_0, b_0 = (np.zeros_like(x) for x in (split.a, split.b, split.a, split.b))
    a_m[6:, 6:] = lam @ m_2m
    b_m[2:6], b_m[6:] = lam @ m_5m, lam @ m_2m @ lam @ m_50 + lam @ m_20 @ lam @ m_5m
    a_0[:2, 2:6], a_0[2:6, 6:] = form.m_6, np.eye(4)
    a_0[6:, 2:6], a_0[6:, 6:] = lam @ form.m_1, lam @ m_20
    b_0[:2], b_0[2:6] = form.m_7, lam @ form.at('m_5', MASS)
    b_0[6:] = lam @ m_20 @ lam @ m_50 + MASS**2 * lam @ m_2m @ lam @ m_5m + lam @ form.m_4
    np.testing.assert_allclose(split.a_m, a_m, atol=1e-12 * np.abs(a_m).max())
    np.testing.assert_allclose(split.b_m, b_m, atol=1e-12 * np.abs(b_m).max())
    np.testing.assert_allclose(split.a_0, a_0, atol=1e-12 * np.abs(a_0).max())
    # (15) prints Lambda M_5 in the second block of B^0; for (13) it has to be Lambda M_5^0.
    b_0[2:6] = lam @ m_50
    np.testing.assert_allclose(split.b_0, b_0, atol=1e-12 * np.abs(b_0).max())


@pytest.mark.parametrize('name', ['paper_reduced', 'paper', 'assumed_modes'])
def test_the_resolvent_split_is_the_secant_from_zero(name: str) -> None:
    model = payload_model(ROBOT, name, 2)
    split = model.split(COSINE, MASS, 'resolvent')
    for part, whole, empty in zip((split.a_m, split.b_m), (split.a, split.b),
                                  model.matrices(COSINE, 0.0)):
        secant = (whole - empty) / MASS
        np.testing.assert_allclose(part, secant, rtol=0, atol=1e-11 * np.abs(secant).max())
        assert np.abs(secant).max() > 1.0


@pytest.mark.parametrize('name', ['paper_reduced', 'paper', 'assumed_modes'])
@pytest.mark.parametrize('mass', [0.0, MASS])
def test_the_tangent_split_is_the_derivative(name: str, mass: float) -> None:
    model = payload_model(ROBOT, name, 2)
    shift = 1e-4 if mass == 0.0 else 0.0
    split = model.split(COSINE, mass + shift, 'tangent')
    expected = central_difference(model, mass + shift)
    found = np.hstack([split.a_m, split.b_m])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_without_payload_secant_and_tangent_agree() -> None:
    model = payload_model(ROBOT, 'paper_reduced', 2)
    secant, tangent = (model.split(COSINE, 0.0, kind) for kind in ('resolvent', 'tangent'))
    np.testing.assert_allclose(secant.a_m, tangent.a_m, atol=1e-12 * np.abs(secant.a_m).max())
    np.testing.assert_allclose(secant.b_m, tangent.b_m, atol=1e-12 * np.abs(secant.b_m).max())


def test_the_printed_split_is_no_sensitivity() -> None:
    """Freezing Lambda hides the payload's inertia: the printed A^m misses the derivative."""
    model = payload_model(ROBOT, 'paper_reduced', 2)
    printed = model.split(COSINE, MASS, 'paper')
    true = printed.a_slope
    assert np.abs(printed.a_m - true).max() > 0.5 * np.abs(true).max()


@pytest.mark.parametrize('name', ['paper', 'assumed_modes'])
def test_second_order_models_are_the_simulator_s(name: str) -> None:
    a, b = payload_model(ROBOT, name, 3).matrices(COSINE, MASS)
    expected = state_space(ExtendedArm(ROBOT, name, 3).form, COSINE, MASS)
    np.testing.assert_allclose(a, expected.a, rtol=0, atol=1e-12 * np.abs(expected.a).max())
    np.testing.assert_allclose(b, expected.b, rtol=0, atol=1e-12 * np.abs(expected.b).max())


@pytest.mark.parametrize('cosine', [-1.0, -0.3, 0.8])
def test_the_reduced_model_is_appendix_f_at_any_angle(cosine: float) -> None:
    found = payload_model(ROBOT, 'paper_reduced', 3).matrices(cosine, MASS)
    for one, other in zip(found, CompactModel(ROBOT, 3).at_cosine(cosine).state_space(MASS)):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * np.abs(other).max())


@pytest.mark.parametrize('name, kind', [
    *[('paper_reduced', kind) for kind in KINDS],
    *[(name, kind) for name in ('paper', 'assumed_modes') for kind in KINDS[1:]]])
def test_rates_are_the_split_applied(name: str, kind: SplitKind) -> None:
    model, random = payload_model(ROBOT, name, 2), np.random.default_rng(0)
    x, u = random.standard_normal(model.states), random.standard_normal(2)
    split = model.split(COSINE, MASS, kind)
    a, a_m, rows = model.rates(COSINE, MASS, MASS, x, u, kind)
    expected = [split.a @ x + split.b @ u, split.a_m @ x + split.b_m @ u,
                split.a_slope @ x + split.b_slope @ u]
    np.testing.assert_allclose(a, split.a, rtol=0, atol=1e-12 * np.abs(split.a).max())
    np.testing.assert_allclose(a_m, split.a_m, rtol=0, atol=1e-11 * np.abs(split.a_m).max())
    for row, wanted in zip(rows, expected):
        np.testing.assert_allclose(row, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


@pytest.mark.parametrize('name', ['paper_reduced', 'paper', 'assumed_modes'])
@pytest.mark.parametrize('other', [0.01, 1.3])
def test_the_secant_is_the_difference_of_two_payloads(name: str, other: float) -> None:
    model, random = payload_model(ROBOT, name, 2), np.random.default_rng(1)
    x, u = random.standard_normal(model.states), random.standard_normal(2)
    rows = model.rates(COSINE, MASS, other, x, u, 'resolvent')[2]
    (a, b), (beyond_a, beyond_b) = (model.matrices(COSINE, m) for m in (MASS, other))
    wanted = ((beyond_a - a) @ x + (beyond_b - b) @ u) / (other - MASS)
    np.testing.assert_allclose(rows[2], wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_bad_kinds_and_models_are_refused() -> None:
    with pytest.raises(InputError, match='split: expected one of paper, resolvent, tangent'):
        payload_model(ROBOT).split(1.0, 0.1, 'frozen')  # type: ignore[arg-type]
    with pytest.raises(InputError, match='paper_reduced'):
        payload_model(ROBOT, 'assumed_modes').split(1.0, 0.1, 'paper')
    with pytest.raises(InputError, match='paper_reduced'):
        payload_model(ROBOT, 'paper', 1).rates(1.0, 0.1, 0.1, np.zeros(8), np.zeros(2), 'paper')
    with pytest.raises(InputError, match='model: expected one of paper_reduced'):
        payload_model(ROBOT, 'beam')
