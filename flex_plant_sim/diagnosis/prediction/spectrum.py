"""
Welch's power density, for latent forces and the report.

It is written out here because importing scipy.signal would double the start time of every tool.
"""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view


def power_density(values: Array, sample_time: float, length: int,
                  detrend: bool = False) -> tuple[Array, Array]:
    """
    Return frequencies, Hz, (F,), and the one-sided power density at them, (F, ...).

    The mean over Hann windows that overlap by half: P. D. Welch, IEEE Transactions on Audio and
    Electroacoustics 15 (1967).

    Parameters
    ----------
    values : Array
        (N, ...), N >= `length`.
    sample_time : float
        s.
    length : int
        Samples of a window.
    detrend : bool
        Whether the mean of each window is subtracted.

    """
    parts = sliding_window_view(values, length, axis=0)[::length - length // 2]
    if detrend:
        parts = parts - parts.mean(axis=-1, keepdims=True)
    window = np.hanning(length + 1)[:-1]
    power = np.mean(np.abs(np.fft.rfft(window * parts))**2, axis=0)
    density = power * sample_time / (window @ window)
    # One-sided: doubled but for zero and the Nyquist frequency, which have no negative partner.
    density[..., 1:(length + 1) // 2] *= 2.0
    return np.arange(length // 2 + 1) / (length * sample_time), np.moveaxis(density, -1, 0)
