"""
Model health while the arm runs: whether innovations are as small and white as they should be.

payload_estimator feeds it every innovation and publishes its report on `diagnostics`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.whiteness import autocorrelation, ljung_box
from msg_config.errors import InputError
import numpy as np
from scipy.special import chdtri, ndtri

# Lags of the whiteness test, as Hyndman and Athanasopoulos advise (Forecasting: Principles and
# Practice, 5.4).
LAGS = 10
# Innovations are clipped to so many standard deviations, so that higher powers do not overflow.
LARGEST = 1e6
# Samples of a window: at 100 Hz four to six of the reference arm's slowest periods (1.07 s with
# 0.28 kg, 0.62 s without a payload), about as many as a window of the diagnosis has.
WINDOW = 400
# Probability that a healthy channel fails the test of a window. With six channels at 100 Hz that
# is once in eleven weeks.
FALSE_ALARM = 1e-7
# Ratio of power to the expected one below which nothing is suspect: noise is seldom told to better
# than 1.4 of it. On right arms it is 1.12 at most (rpe, 32 windows of 400 samples), and chance
# alone would allow 1.41.
EXCESS = 2.0
# Suspect windows in a row before a diagnosis is advised: a single push on the arm is over sooner.
WINDOWS_TO_ADVISE = 3
# Kurtosis from which a residual consists of spikes: that of one of which a tenth of the samples
# has all the power, as it is one over that share. A Gaussian has 3, a Laplace distribution 6.
SPIKE_KURTOSIS = 10.0
# Share of the power in the highest bin and its two neighbours from which a residual oscillates: a
# sine then has about as much power as all else. It has 86 % of its own there where it lies between
# two bins and more elsewhere; white noise of 400 samples has 4 %, in 300 draws at most 8 %.
PEAK_SHARE = 0.4
# Highest bin of a peak that may be a slow error's: of 4000 random walks over a window two in a
# thousand have one of that share beyond it, beyond half of it one in 26.
SLOW_BIN = 4


@dataclass(frozen=True)
class ChannelHealth:
    """
    Health of one channel over one window.

    Attributes
    ----------
    name : str
    nis : float
        Mean of (innovation / its standard deviation)^2; 1 if the model and R are right.
    whiteness : float
        Ljung-Box Q over LAGS, divided by LAGS, its mean for white noise; 1 if white.
    shape : str
        What the residual looks like: 'white', an offset, spikes, noise, an oscillation at a
        frequency, a slow or a fast error. It hints at a cause but names none.
    suspect : bool
        Whether the window contradicts a right model.

    """

    name: str
    nis: float
    whiteness: float
    shape: str
    suspect: bool


@dataclass(frozen=True)
class HealthReport:
    """
    Health of all channels over the last window.

    Attributes
    ----------
    channels : tuple of ChannelHealth
        Empty until the window is full.
    samples : int
        Samples in the window.
    diagnose : bool
        Whether a full diagnosis is worth running.
    text : str
        The result in one line.

    """

    channels: tuple[ChannelHealth, ...]
    samples: int
    diagnose: bool
    text: str


class ModelHealth:
    """
    Watches the normalised innovation over a sliding window.

    For a right model (nu / sigma)^2 has mean 1 and nu is white (Bar-Shalom, Li and Kirubarajan,
    Estimation with Applications to Tracking and Navigation, 2001, 5.4). A channel is suspect
    where that mean exceeds both its chi-squared limit and twice its expected value 1, or where
    Ljung and Box's Q (Biometrika 65, 1978) exceeds its limit and nis is above 1.

    Parameters
    ----------
    names : sequence of str
        Names of the channels.
    sample_time : float
        T, s.
    window : int
        Samples of the window, more than 4 LAGS.

    Raises
    ------
    InputError
        The window is too short.

    """

    def __init__(self, names: Sequence[str], sample_time: float, window: int = WINDOW):
        if window <= 4 * LAGS:
            raise InputError(f'model health: expected a window of more than {4 * LAGS} samples, '
                             f'got {window}')
        self.names, self.sample_time, self.window = tuple(names), sample_time, window
        self.nis_limit = max(EXCESS, chdtri(window, FALSE_ALARM) / window)
        self.whiteness_limit = chdtri(LAGS, FALSE_ALARM) / LAGS
        self.offset_limit = -ndtri(FALSE_ALARM) / np.sqrt(window)
        self.reset()

    def reset(self) -> None:
        """Forget the window."""
        self._ring = np.zeros((self.window, len(self.names)))
        self._count = self._judged = self._bad = 0

    def add(self, innovation: Array, deviation: Array) -> None:
        """Take an innovation and its standard deviation, (m,), unless a number is not finite."""
        # A sum is finite where its terms are; for a few numbers lists are faster than arrays.
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
        """Return the health of the channels over the window; empty before it is full."""
        if self._count < self.window:
            return ()
        scaled = np.roll(self._ring, -(self._count % self.window), axis=0)
        nis, offsets = np.mean(scaled**2, axis=0), np.mean(scaled, axis=0)
        whiteness = ljung_box(autocorrelation([scaled], LAGS), self.window) / LAGS
        return tuple(
            self._channel(name, scaled[:, k], float(nis[k]), float(whiteness[k]),
                          float(offsets[k]))
            for k, name in enumerate(self.names))

    def report(self) -> HealthReport:
        """Return the health over the last window."""
        channels = self.channels()
        samples = min(self._count, self.window)
        diagnose = self._bad >= WINDOWS_TO_ADVISE
        return HealthReport(channels, samples, diagnose, self._text(channels, diagnose))

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
        """Return the health of a channel from its normalised innovations, (window,)."""
        large = nis > self.nis_limit
        # A residual far below sigma may be coloured: then R was chosen wide, the model is right.
        coloured = whiteness > self.whiteness_limit and nis > 1.0
        suspect = large or coloured
        shape = self._shape(scaled, offset, whiteness) if suspect else 'white'
        return ChannelHealth(name, nis, whiteness, shape, suspect)

    def _shape(self, scaled: Array, offset: float, whiteness: float) -> str:
        """Return in words what a suspect residual looks like."""
        if offset**2 > 0.5 * np.mean(scaled**2) and abs(offset) > self.offset_limit:
            return f'offset of {offset:+.1f} standard deviations'
        centred = scaled - scaled.mean()
        if np.mean(centred**4) > SPIKE_KURTOSIS * np.mean(centred**2)**2:
            return 'spikes'
        if whiteness <= self.whiteness_limit:
            return 'more noise than told'
        power = np.abs(np.fft.rfft(centred))**2
        peak = int(np.argmax(power))
        near = power[max(peak - 1, 0):peak + 2].sum()
        frequency = peak / (scaled.size * self.sample_time)
        if near > PEAK_SHARE * power.sum() and peak > SLOW_BIN:
            return f'oscillation at {frequency:.3g} Hz'
        return 'slow error' if frequency < 0.1 / self.sample_time else 'fast error'
