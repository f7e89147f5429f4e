"""Delta model (19)-(22): against the matrix exponential, exact rationals and the limit T -> 0."""

from __future__ import annotations

from fractions import Fraction
import math

from flex_payload_estimator.model.delta import (
    delta_model,
    digits_over_step,
    halvings_for,
    omega,
    shift_round_trip,
    TERMS,
)
from flex_payload_estimator.model.payload_model import payload_model
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
import numpy as np
from paper_equations import omega_19, omega_exact
import pytest
from scipy.linalg import expm

STEP = 0.01


def arm_matrices(modes: int) -> tuple[Array, Array, int]:
    """Return A and B of the reference arm at theta_2 = 0.5 rad, 0.1 kg, and its halvings of T."""
    model = payload_model(load_robot('reference'), 'paper_reduced', modes)
    return *model.matrices(math.cos(0.5), 0.1), halvings_for(model.radius, STEP, TERMS)


def exact_a_bar(a: Array, step: float, terms: int = 24) -> Array:
    """Return (e^{AT} - I) / T by its series in exact rational arithmetic."""
    size = len(a)
    exact = [[Fraction(float(a[i, j])) for j in range(size)] for i in range(size)]
    power, factor = exact, Fraction(1)
    total = [row[:] for row in exact]
    for k in range(2, terms + 1):
        power = [[sum((power[i][m] * exact[m][j] for m in range(size) if exact[m][j]),
                      Fraction(0)) for j in range(size)] for i in range(size)]
        factor = factor * Fraction(step) / k
        total = [[total[i][j] + factor * power[i][j] for j in range(size)] for i in range(size)]
    return np.array([[float(value) for value in row] for row in total])


@pytest.mark.parametrize('modes', [1, 2, 4])
def test_omega_a_is_the_exponential_s_difference_quotient(modes: int) -> None:
    a, b, halvings = arm_matrices(modes)
    a_bar, _ = delta_model(a, b, STEP, halvings=halvings)
    expected = (expm(a * STEP) - np.eye(len(a))) / STEP
    np.testing.assert_allclose(a_bar, expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


def test_omega_b_is_the_zero_order_hold() -> None:
    a, b, halvings = arm_matrices(2)
    _, b_bar = delta_model(a, b, STEP, halvings=halvings)
    n = len(a)
    both = expm(np.block([[a, b], [np.zeros((2, n + 2))]]) * STEP)
    np.testing.assert_allclose(b_bar, both[:n, n:] / STEP, rtol=0.0,
                               atol=1e-11 * np.abs(b_bar).max())


@pytest.mark.parametrize('terms', range(1, 20))
def test_the_blocks_sum_the_printed_series(terms: int) -> None:
    a = np.array([[0.0, 1.0], [-4.0, -0.3]])
    np.testing.assert_allclose(omega(a, STEP, terms), omega_19(a, STEP, terms),
                               rtol=1e-14, atol=1e-16)


def test_the_delta_model_tends_to_the_continuous_one_with_first_order() -> None:
    a, b, _ = arm_matrices(2)
    steps = np.array([1e-4, 1e-5, 1e-6, 1e-7])
    errors = [np.abs(delta_model(a, b, step)[0] - a).max() for step in steps]
    orders = np.diff(np.log(errors)) / np.diff(np.log(steps))
    np.testing.assert_allclose(orders[1:], 1.0, atol=0.005)


def test_at_a_microsecond_delta_keeps_the_digits_that_shift_loses() -> None:
    a, b, _ = arm_matrices(1)
    exact, scale = exact_a_bar(a, 1e-6), np.abs(a).max()
    slow = np.abs(exact) < 1e-2 * scale
    delta = np.abs(delta_model(a, b, 1e-6)[0] - exact)
    shift = np.abs(shift_round_trip(a, 1e-6) - exact)
    assert delta.max() <= 4e-16 * scale
    assert shift[slow].max() >= 1e4 * max(delta[slow].max(), 1e-17)
    assert shift.max() > 1e-11


def test_fifteen_terms_do_not_suffice_for_fast_modes_and_halving_mends_it() -> None:
    a, b, halvings = arm_matrices(6)
    expected = (expm(a * STEP) - np.eye(len(a))) / STEP
    scale = np.abs(expected).max()
    printed = np.abs(delta_model(a, b, STEP)[0] - expected).max() / scale
    halved = np.abs(delta_model(a, b, STEP, halvings=halvings)[0] - expected).max() / scale
    assert halvings > 3
    assert printed > 1.0
    assert halved < 1e-10


def test_halvings_bound_the_first_term_left_out() -> None:
    for size in (0.1, 2.5, 40.0):
        halvings = halvings_for(size / STEP, STEP, 15)
        left_out = [(size / 2.0**h)**16 / math.factorial(17) for h in (halvings, halvings - 1)]
        assert left_out[0] <= 1e-12
        assert halvings == 0 or left_out[1] > 1e-12
    assert halvings_for(0.0, STEP, 15) == 0


@pytest.mark.parametrize('modes', [2, 6])
@pytest.mark.parametrize('terms', [1, 2, 3, 5, 15, 30])
def test_halving_makes_up_for_any_number_of_terms(terms: int, modes: int) -> None:
    model = payload_model(load_robot('reference'), 'paper_reduced', modes)
    for cosine in (-1.0, 0.3, 1.0):
        a, _ = model.matrices(cosine, 0.1)
        found = omega(a, STEP, terms, halvings_for(model.radius, STEP, terms))
        wanted = omega_exact(a, STEP)
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-11 * np.abs(wanted).max())


def test_the_figure_s_numbers_show_the_cross_over() -> None:
    a, _, _ = arm_matrices(2)
    radius = float(np.abs(np.linalg.eigvals(a)).max())
    delta, shift = digits_over_step(a, np.array([1e-2, 1e-4, 1e-6]), radius)
    assert delta.max() < 1e-12
    assert shift[2] > 1e3 * delta[2]
    assert shift[2] > shift[1]


@pytest.mark.parametrize('terms, halvings', [(0, 0), (15, -1)])
def test_bad_orders_are_refused(terms: int, halvings: int) -> None:
    with pytest.raises(InputError, match="n'"):
        omega(np.eye(2), STEP, terms, halvings)
