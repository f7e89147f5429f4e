"""A line in the spectrum of a latent force: something behind it swings, and remembers."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.diagnosis.prediction.law import Series
from flex_plant_sim.diagnosis.prediction.spectrum import power_density
import numpy as np

# Of Welch: a bin of the mean of so many spectra is known to a third.
SEGMENTS = 8
# Bins on either side of a Hann window's peak, and of the background beside it.
PEAK, BESIDE = 2, 10
# Ten times a smooth background is one bin in 20 000 of a single segment (chi-squared with two
# degrees of freedom), and hardly any of the mean of 8; what holds a smaller share matters little.
ABOVE, SHARE = 10.0, 0.3


@dataclass(frozen=True)
class Line:
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


def line_of(series: Series, sample_time: float) -> Line | None:
    """Return the strongest line of a latent force that is no model error; None without one."""
    value = series.value - series.value.mean()
    if series.size < series.relevant:
        return None
    frequency, power = power_density(value, sample_time, len(value) // SEGMENTS, level=True)
    at = int(np.argmax(power[BESIDE:])) + BESIDE
    beside = np.concatenate([power[at - BESIDE:at - PEAK], power[at + PEAK + 1:at + BESIDE + 1]])
    share = float(power[at - PEAK:at + PEAK + 1].sum() / power.sum())
    if power[at] < ABOVE * np.median(beside) or share < SHARE:
        return None
    return Line(series.site, float(frequency[at]), share)
