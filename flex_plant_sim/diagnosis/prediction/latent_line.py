"""
Lines in the spectrum of a latent force, which show that an oscillation is behind it.

`latent_view` states one where no single variable explains the force.
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.diagnosis.prediction.law import LatentSeries
from flex_plant_sim.diagnosis.prediction.spectrum import power_density
import numpy as np

# Segments of Welch's estimate: a mean of so many spectra is known to a third in each bin.
WELCH_SEGMENTS = 8
# Bins to either side of a line that a Hann window spreads it over, and of its background.
PEAK_BINS, BACKGROUND_BINS = 2, 10
# Bins without which a line and its background have no room.
LEAST_BINS = 2 * BACKGROUND_BINS + 1
# A line is ten times its background: by chance one bin in 20 000 of a single segment exceeds that
# (chi-squared, two degrees of freedom), and hardly any of a mean of 8. It holds so much power.
PEAK_RATIO, MIN_POWER_SHARE = 10.0, 0.3


@dataclass(frozen=True)
class SpectralLine:
    """
    A line in a spectrum.

    Attributes
    ----------
    site : str
    frequency : float
        Hz.
    share : float
        Of the power.

    """

    site: str
    frequency: float
    share: float


def line_of(series: LatentSeries, sample_time: float) -> SpectralLine | None:
    """
    Return the strongest line of a force that exceeds model errors; None if there is none.

    Nor is one told of a record too short for a line beside its background.
    """
    value = series.value - series.value.mean()
    segment = len(value) // WELCH_SEGMENTS
    if series.rms <= series.model_error or segment < 2 * LEAST_BINS:
        return None
    frequency, power = power_density(value, sample_time, segment, detrend=True)
    peak = int(np.argmax(power[BACKGROUND_BINS:])) + BACKGROUND_BINS
    background = np.concatenate([power[peak - BACKGROUND_BINS:peak - PEAK_BINS],
                                 power[peak + PEAK_BINS + 1:peak + BACKGROUND_BINS + 1]])
    share = float(power[peak - PEAK_BINS:peak + PEAK_BINS + 1].sum() / power.sum())
    if power[peak] < PEAK_RATIO * np.median(background) or share < MIN_POWER_SHARE:
        return None
    return SpectralLine(series.site, float(frequency[peak]), share)
