"""Whiteness of a residual against its definition, and what chance makes of it."""

from __future__ import annotations

from flex_plant_sim.whiteness import autocorrelation, ljung_box
import numpy as np
import pytest


def test_autocorrelation_and_statistic_by_their_definitions() -> None:
    """Of two stretches with one mean, summed naively; no product spans the gap."""
    parts, lags = [np.array([0.3, -1.1, 0.8, 0.4, -0.2]), np.array([1.5, -0.9, 0.1, 0.7])], 3
    count, mean = 9, np.concatenate(parts).mean()
    power = sum((x - mean)**2 for part in parts for x in part)
    rho = [sum((part[i] - mean) * (part[i - k] - mean) for part in parts
               for i in range(k, len(part))) / power for k in range(lags + 1)]
    found = autocorrelation(parts, lags)
    assert found == pytest.approx(rho, rel=1e-12)
    expected = count * (count + 2) * sum(rho[k]**2 / (count - k) for k in range(1, lags + 1))
    assert float(ljung_box(found, count)) == pytest.approx(expected, rel=1e-12)


def test_each_column_is_a_residual_of_its_own() -> None:
    values = np.random.default_rng(1).standard_normal((50, 2)) + [0.0, 3.0]
    both = ljung_box(autocorrelation([values], 4), 50)
    each = [ljung_box(autocorrelation([values[:, k]], 4), 50) for k in (0, 1)]
    np.testing.assert_allclose(both, each, rtol=1e-12)


def test_a_constant_has_no_correlation() -> None:
    assert not autocorrelation([np.full(20, 2.0)], 3).any()


def test_the_statistic_is_chi_squared_for_white_noise() -> None:
    """Mean `lags` and variance 2 `lags` of chi-squared."""
    values, lags = np.random.default_rng(0).standard_normal((500, 2000)), 10
    found = ljung_box(autocorrelation([values], lags), 500)
    assert abs(found.mean() - lags) < 4.0 * np.sqrt(2.0 * lags / 2000)
    assert abs(found.var() / (2.0 * lags) - 1.0) < 0.25
