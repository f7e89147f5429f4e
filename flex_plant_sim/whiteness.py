"""How white a residual is: its autocorrelation, and Ljung and Box's statistic of it."""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.arm.second_order import Array
import numpy as np


def autocorrelation(parts: Sequence[Array], lags: int) -> Array:
    """
    Return the autocorrelation at lags 0 to `lags`, (lags + 1, ...); zero of a constant.

    Parameters
    ----------
    parts : sequence of Array
        Stretches without gaps of one residual, (N_k, ...), each longer than `lags`.
    lags : int
        Samples.

    """
    mean = sum(part.sum(axis=0) for part in parts) / sum(len(part) for part in parts)
    centred = [part - mean for part in parts]
    found = np.array([sum(np.einsum('i...,i...->...', part[k:], part[:len(part) - k])
                          for part in centred) for k in range(lags + 1)])
    return np.asarray(found / np.where(found[0] > 0.0, found[0], 1.0))


def ljung_box(correlation: Array, samples: int) -> Array:
    """
    Return Q = N (N + 2) sum_{k=1} r_k^2 / (N - k): chi-squared with as many freedoms as lags.

    That holds of white noise (Ljung and Box, Biometrika 65, 1978).

    Parameters
    ----------
    correlation : Array
        r_0, r_1, ... by lag, (lags + 1, ...).
    samples : int
        N, in all stretches together.

    """
    lags = np.arange(1, len(correlation))
    return np.asarray(samples * (samples + 2) * ((1.0 / (samples - lags)) @ correlation[1:]**2))
