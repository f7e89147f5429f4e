"""The split (13): as printed (15), (16), and by the resolvent identity."""

from __future__ import annotations

import math

from flex_payload_estimator.model.payload_model import payload_model, PayloadModel
from flex_payload_estimator.model.split import rates_at
from flex_plant_sim.arm.paper_model import CompactModel
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import state_space
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from msg_config.errors import InputError
import numpy as np
from paper_equations import split_15
import pytest

ROBOT = load_robot('reference')
COSINE, MASS = math.cos(0.7), 0.13


def central_difference(model: PayloadModel, mass: float, h: float = 1e-5) -> np.ndarray:
    """Return d(A B)/dm_p of fourth order."""
    def joined(m: float) -> np.ndarray:
        return np.hstack(model.matrices(COSINE, m))
    near, far = joined(mass + h) - joined(mass - h), joined(mass + 2 * h) - joined(mass - 2 * h)
    return (8.0 * near - far) / (12.0 * h)


def split(model: PayloadModel, mass: float, other: float, as_printed: bool) -> list[Array]:
    """Return A^m, B^m and the secants A', B' of A and B to another payload."""
    x, u = np.eye(model.states), np.eye(2)
    rates = [rates_at(COSINE, model.tables, mass, other, row, np.zeros(2), as_printed)
             for row in x]
    rates += [rates_at(COSINE, model.tables, mass, other, 0.0 * x[0], row, as_printed)
              for row in u]
    rows = np.stack([found[2] for found in rates], axis=-1)
    np.testing.assert_allclose(rates[0][1], rows[1, :, :-2], rtol=0, atol=1e-9)
    return [rows[1, :, :-2], rows[1, :, -2:], rows[2, :, :-2], rows[2, :, -2:]]


@pytest.mark.parametrize('modes', [1, 2, 5])
@pytest.mark.parametrize('as_printed', [True, False])
def test_the_rates_are_a_x_and_b_u(modes: int, as_printed: bool) -> None:
    model, random = payload_model(ROBOT, 'paper_reduced', modes), np.random.default_rng(0)
    x, u = random.standard_normal(model.states), random.standard_normal(2)
    found, _, rows = rates_at(COSINE, model.tables, MASS, MASS, x, u, as_printed)
    a, b = CompactModel(ROBOT, modes).at(0.7).state_space(MASS)
    np.testing.assert_allclose(found, a, rtol=0, atol=1e-12 * np.abs(a).max())
    np.testing.assert_allclose(rows[0], a @ x + b @ u, rtol=0, atol=1e-12 * np.abs(a).max())


def test_the_printed_split_is_15_and_16() -> None:
    model = payload_model(ROBOT, 'paper_reduced', 2)
    (a, b), (a_m, b_m) = model.matrices(COSINE, MASS), split(model, MASS, MASS, True)[:2]
    for found, wanted in zip((a - MASS * a_m, a_m, b - MASS * b_m, b_m),
                             split_15(ROBOT, 2, 0.7, MASS)):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(a).max())


@pytest.mark.parametrize('name', ['paper_reduced', 'paper', 'assumed_modes'])
def test_the_resolvent_split_is_the_secant_from_zero(name: str) -> None:
    model = payload_model(ROBOT, name, 2)
    found = split(model, MASS, MASS, False)[:2]
    for part, whole, empty in zip(found, model.matrices(COSINE, MASS),
                                  model.matrices(COSINE, 0.0)):
        secant = (whole - empty) / MASS
        np.testing.assert_allclose(part, secant, rtol=0, atol=1e-11 * np.abs(secant).max())
        assert np.abs(secant).max() > 1.0


@pytest.mark.parametrize('name', ['paper_reduced', 'paper', 'assumed_modes'])
@pytest.mark.parametrize('mass', [1e-4, MASS])
def test_at_one_payload_the_secant_is_the_derivative(name: str, mass: float) -> None:
    model = payload_model(ROBOT, name, 2)
    expected = central_difference(model, mass)
    found = np.hstack(split(model, mass, mass, False)[2:])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize('name', ['paper_reduced', 'paper', 'assumed_modes'])
@pytest.mark.parametrize('other', [0.01, 1.3])
def test_the_secant_is_the_difference_of_two_payloads(name: str, other: float) -> None:
    model = payload_model(ROBOT, name, 2)
    for part, here, there in zip(split(model, MASS, other, False)[2:],
                                 model.matrices(COSINE, MASS), model.matrices(COSINE, other)):
        wanted = (there - here) / (other - MASS)
        np.testing.assert_allclose(part, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_the_printed_split_is_no_sensitivity() -> None:
    """Freezing Lambda hides the payload's inertia: the printed A^m misses the derivative."""
    a_m, _, true, _ = split(payload_model(ROBOT, 'paper_reduced', 2), MASS, MASS, True)
    assert np.abs(a_m - true).max() > 0.5 * np.abs(true).max()


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


def test_a_bad_model_is_refused() -> None:
    with pytest.raises(InputError, match='model: expected one of paper_reduced'):
        payload_model(ROBOT, 'beam', 2)
