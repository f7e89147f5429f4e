"""The white noise of each sensor, from the record itself."""

from __future__ import annotations

from math import comb

from flex_plant_sim.arm.second_order import Array
import numpy as np

# Order of the differences: what moves slowly beside the sampling vanishes in them. All inner
# weights of a prime order share that factor, so that differences of what is rounded to steps come
# in lumps: their median was up to 13 % off where the noise is half a step. Of order 6 it is 4 %.
DIFFERENCES = 6
# Noise with rounding, in steps, from which on the median tells it: (0.37^2 + 1 / 12)^(1/2), where
# the noise is 0.37 steps. Below that most differences of a channel that is held are zero; where it
# moves, up to this much is believed of it.
MEDIAN_FROM = 0.47
# Relative standard error of the white noise found in N samples, times the root of N: a median
# tells 1.17 of independent ones (P. J. Huber, Robust Statistics, 1981), and of sixth differences
# 1.4 times that, as neighbours are alike; test_sensor_noise.py measures it.
NOISE_ERROR = 1.6
# Least noise of a gauge, as a share of how much it varies: one that is filtered shows less noise
# than it errs.
LEAST_STRAIN = 1e-3
# Least noise that is believed of any channel, rad and m/m, so that one that never changes may be
# divided by it: a robot file may state no less of an angle.
LEAST_NOISE = 1e-12


def measurement_noise(measured: Array) -> Array:
    """
    Return the standard deviation of the white noise of each channel, (m,).

    Lost samples are NaN in `measured`, (N, m): what is interpolated shows less noise.

    From sixth differences, in which the motion of an arm sampled well above its bandwidth
    leaves nothing; the median ignores the few rows where it does. A filtered sensor shows less
    than it errs, so a thousandth of the strain's own size is the least that is believed.
    """
    found = np.maximum(white_noise(measured), LEAST_NOISE)
    found[2:] = np.maximum(found[2:], LEAST_STRAIN * np.nanstd(measured[:, 2:], axis=0))
    return found


def white_noise(measured: Array) -> Array:
    """Return the standard deviation of what of each channel (N, m) is white, (m,)."""
    weight = np.sqrt(sum(comb(DIFFERENCES, k)**2 for k in range(DIFFERENCES + 1)))
    differences = np.diff(measured, DIFFERENCES, axis=0) / weight
    spread = 1.4826 * np.nanmedian(np.abs(differences), axis=0)
    step = np.array([np.min(d[d > 0], initial=np.inf)
                     for d in np.abs(np.diff(measured, axis=0)).T])
    step = np.where(np.isfinite(step), step, 0.0)
    held = np.minimum(np.sqrt(np.nanmean(differences**2, axis=0)), MEDIAN_FROM * step)
    return np.maximum(np.maximum(spread, held), step / np.sqrt(12.0))
