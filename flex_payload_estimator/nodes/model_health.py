"""Model health while the arm runs: whether the innovation is as small and white as it should."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from flex_plant_sim.arm.second_order import Array
from msg_config.errors import InputError
import numpy as np
from scipy.special import chdtri, ndtri

# As Hyndman and Athanasopoulos advise (Forecasting: Principles and Practice, 5.4).
LAGS = 10
# Beyond so many standard deviations all are alike; higher powers must not overflow.
LARGEST = 1e6
# How rarely a healthy channel fails a window's test; six channels, a window a second: weekly.
FALSE_ALARM = 1e-7
# R_1 and R_2 are known roughly: only what is twice too large is told.
EXCESS = 2.0
# In a row: what pushes the arm once is over sooner.
WINDOWS_TO_ADVISE = 3
# Where a share of the samples has all the power, kurtosis is one over it; of a Gaussian it is 3.
SPIKE_KURTOSIS = 10.0
# Of the power, in the highest bin and beside it: a sine has 86 % there between two bins and more
# elsewhere, white noise of 400 samples 4 %, in 300 draws at most 8 %.
PEAK_SHARE = 0.4


@dataclass(frozen=True)
class ChannelHealth:
    """
    One channel over one window.

    Attributes
    ----------
    name : str
    nis : float
        Mean of (innovation / its standard deviation)^2; 1 if the model and R are right.
    whiteness : float
        Ljung-Box Q over LAGS, divided by its mean LAGS for white noise; 1 if white.
    offset : float
        Mean of innovation / standard deviation.
    shape : str
        'white', 'offset', 'slow', 'oscillation at … Hz', 'spikes' or 'noise'; what the
        residual looks like, which hints at a cause but names none.
    suspect : bool
        The window contradicts a right model.

    """

    name: str
    nis: float
    whiteness: float
    offset: float
    shape: str
    suspect: bool


@dataclass(frozen=True)
class HealthReport:
    """
    Every channel over the last window.

    Attributes
    ----------
    channels : tuple of ChannelHealth
    samples : int
        How many the window holds; no verdict before it is full.
    nis : float
        Mean over the channels.
    diagnose : bool
        A full diagnosis is worth running.
    text : str
        One line.

    """

    channels: tuple[ChannelHealth, ...]
    samples: int
    nis: float
    diagnose: bool
    text: str


class ModelHealth:
    """
    Watches the normalised innovation over a sliding window.

    For a right model (nu / sigma)^2 has mean 1 and nu is white (Bar-Shalom, Li and Kirubarajan,
    Estimation with Applications to Tracking and Navigation, 2001, 5.4). A channel is suspect
    where the mean exceeds both its chi-squared limit and twice 1, or where Ljung and Box's Q
    (Biometrika 65, 1978) exceeds its limit and the excess is not too small to matter.

    Parameters
    ----------
    names : sequence of str
        Channels.
    sample_time : float
        T, s.
    window : int
        Samples, more than 4 LAGS.

    """

    def __init__(self, names: Sequence[str], sample_time: float, window: int = 400):
        if window <= 4 * LAGS:
            raise InputError(f'model health: expected a window of more than {4 * LAGS} samples, '
                             f'got {window}')
        self.names, self.sample_time, self.window = tuple(names), sample_time, window
        self.nis_limit = max(EXCESS, chdtri(window, FALSE_ALARM) / window)
        self.whiteness_limit = max(EXCESS, chdtri(LAGS, FALSE_ALARM) / LAGS)
        self.offset_limit = -ndtri(FALSE_ALARM) / np.sqrt(window)
        self.reset()

    def reset(self) -> None:
        """Forget the window."""
        self._ring = np.zeros((self.window, len(self.names)))
        self._count = self._judged = self._bad = 0

    def add(self, innovation: Array, deviation: Array) -> None:
        """Take an innovation and its standard deviation, (m,); what is not finite is left out."""
        # A sum is finite where its terms are; for a few numbers lists are quicker than arrays.
        deviations = deviation.tolist()
        if not (math.isfinite(sum(deviations) + sum(innovation.tolist()))
                and min(deviations) > 0.0):
            return
        scaled = innovation / deviation
        if not scaled.dot(scaled) < LARGEST**2:
            scaled = np.clip(scaled, -LARGEST, LARGEST)
        self._ring[self._count % self.window] = scaled
        self._count += 1
        if self._count >= self._judged + self.window:
            self._judged = self._count
            suspect = any(channel.suspect for channel in self.channels())
            self._bad = self._bad + 1 if suspect else 0

    def channels(self) -> tuple[ChannelHealth, ...]:
        """Return the channels over the samples in the window; empty before it is full."""
        if self._count < self.window:
            return ()
        scaled = np.roll(self._ring, -(self._count % self.window), axis=0)
        nis, offsets = np.mean(scaled**2, axis=0), np.mean(scaled, axis=0)
        whiteness = ljung_box(scaled) / LAGS
        return tuple(
            self._channel(name, scaled[:, k], float(nis[k]), float(whiteness[k]),
                          float(offsets[k]))
            for k, name in enumerate(self.names))

    def report(self) -> HealthReport:
        """Return the health over the last window."""
        channels = self.channels()
        samples = min(self._count, self.window)
        diagnose = self._bad >= WINDOWS_TO_ADVISE
        nis = float(np.mean([c.nis for c in channels])) if channels else float('nan')
        return HealthReport(channels, samples, nis, diagnose, self._text(channels, diagnose))

    def _text(self, channels: tuple[ChannelHealth, ...], diagnose: bool) -> str:
        if not channels:
            return f'collecting {self.window} samples'
        suspects = [c for c in channels if c.suspect]
        if not suspects:
            return 'the model explains the measurements'
        worst = max(suspects, key=lambda c: c.nis * c.whiteness)
        advice = '; a full diagnosis (flex_diagnose) is worth running' if diagnose else ''
        return f'{worst.name} does not fit the model: {worst.shape}{advice}'

    def _channel(self, name: str, scaled: Array, nis: float, whiteness: float,
                 offset: float) -> ChannelHealth:
        large = nis > self.nis_limit
        # A residual far below sigma may be coloured: R was chosen wide, the model is not wrong.
        coloured = whiteness > self.whiteness_limit and nis > 1.0
        suspect = large or coloured
        shape = self._shape(scaled, offset, whiteness) if suspect else 'white'
        return ChannelHealth(name, nis, whiteness, offset, shape, suspect)

    def _shape(self, scaled: Array, offset: float, whiteness: float) -> str:
        if offset**2 > 0.5 * np.mean(scaled**2) and abs(offset) > self.offset_limit:
            return f'offset of {offset:+.1f} standard deviations'
        centred = scaled - scaled.mean()
        if np.mean(centred**4) > SPIKE_KURTOSIS * np.mean(centred**2)**2:
            return 'spikes'
        if whiteness <= self.whiteness_limit:
            return 'more noise than R_2 says'
        power = np.abs(np.fft.rfft(centred))**2
        peak = int(np.argmax(power))
        near = power[max(peak - 1, 0):peak + 2].sum()
        frequency = peak / (scaled.size * self.sample_time)
        if near > PEAK_SHARE * power.sum() and peak > 4:
            return f'oscillation at {frequency:.3g} Hz'
        return 'slow error' if frequency < 0.1 / self.sample_time else 'fast error'


def ljung_box(values: Array) -> Array:
    """
    Return Q = N (N + 2) sum_{k=1}^{LAGS} r_k^2 / (N - k), chi-squared with LAGS if white.

    Parameters
    ----------
    values : Array
        (N,), or one series a column, (N, m).

    """
    centred = values - values.mean(axis=0)
    variance = np.einsum('i...,i...->...', centred, centred)
    count = len(values)
    lags = np.arange(1, LAGS + 1)
    r = np.array([np.einsum('i...,i...->...', centred[k:], centred[:-k]) for k in lags])
    r = r / np.where(variance > 0.0, variance, 1.0)
    return np.asarray(count * (count + 2) * ((1.0 / (count - lags)) @ r**2))
