"""A line in the spectrum of a latent force: something behind it swings, and remembers."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.diagnosis.prediction.law import LatentSeries
from flex_plant_sim.diagnosis.prediction.spectrum import power_density
import numpy as np

# Of Welch: a bin of the mean of so many spectra is known to a third.
WELCH_SEGMENTS = 8
# Bins on either side of a Hann window's peak, and of the background beside it.
PEAK_BINS, BACKGROUND_BINS = 2, 10
# Ten times a smooth background is one bin in 20 000 of a single segment (chi-squared with two
# degrees of freedom), and hardly any of the mean of 8; what holds a smaller share matters little.
PEAK_RATIO, MIN_POWER_SHARE = 10.0, 0.3


@dataclass(frozen=True)
class SpectralLine:
    """
    A line: where it stands and how much of the power it holds.

    Attributes
    ----------
    site : str
    frequency : float
        Hz.
    share : float

    """

    site: str
    frequency: float
    share: float


def line_of(series: LatentSeries, sample_time: float) -> SpectralLine | None:
    """Return the strongest line of a latent force that is no model error; None without one."""
    value = series.value - series.value.mean()
    if series.rms < series.model_error:
        return None
    frequency, power = power_density(value, sample_time, len(value) // WELCH_SEGMENTS, detrend=True)
    at = int(np.argmax(power[BACKGROUND_BINS:])) + BACKGROUND_BINS
    background = np.concatenate([power[at - BACKGROUND_BINS:at - PEAK_BINS], power[at + PEAK_BINS + 1:at + BACKGROUND_BINS + 1]])
    share = float(power[at - PEAK_BINS:at + PEAK_BINS + 1].sum() / power.sum())
    if power[at] < PEAK_RATIO * np.median(background) or share < MIN_POWER_SHARE:
        return None
    return SpectralLine(series.site, float(frequency[at]), share)
