"""Sensors: from the true surface strain to the amplifiers' output, and the noise of a log."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import bilinear, lfilter, lfilter_zi

from truth.beam_elements import Array
from truth.configuration import Sensors
from truth.simulation import Motion

# Coloured share of the noise: first-order Gauss-Markov of this correlation time.
COLOURED_SHARE = 0.2
CORRELATION_TIME = 0.2


def low_pass(signal: Array, sensors: Sensors, step: float) -> Array:
    """Return `signal` (N, G) behind w^2 / (s^2 + 2 zeta w s + w^2) or w / (s + w), from rest."""
    cutoff = sensors.filter_cutoff
    denominator = ([1.0, cutoff] if sensors.filter_first_order else
                   [1.0, 2.0 * sensors.filter_damping * cutoff, cutoff**2])
    b, a = bilinear([denominator[-1]], denominator, fs=1.0 / step)
    start = lfilter_zi(b, a)[:, None] * signal[0]
    return np.asarray(lfilter(b, a, signal, axis=0, zi=start)[0])


def gauge_gains(sensors: Sensors, time: Array) -> Array:
    """Return the gauges' gains at times (N,) s, (N, G); if they warm up, from 1 at the start."""
    warm = (np.ones(len(time)) if sensors.gain_warming == 0.0
            else 1.0 - np.exp(-time / sensors.gain_warming))
    return 1.0 + np.outer(warm, np.array(sensors.strain_gain) - 1.0)


def logged_angles(reading: Array, noise: Array, sensors: Sensors, sample_time: float) -> Array:
    """
    Return the angles (N, 2) rad as a log has them, from what the controller read with `noise`.

    What is late is measured again: the motion of before, with the noise of now.
    """
    time, found = sample_time * np.arange(len(reading)), reading.copy()
    for k, delay in enumerate(sensors.angle_delay):
        if delay > 0.0:
            motion = CubicSpline(time, reading[:, k] - noise[:, k])
            found[:, k] = quantise(motion(np.maximum(time - delay, 0.0)) + noise[:, k],
                                   sensors.angle_step[k])
    return found


def amplifier_output(motion: Motion, sensors: Sensors, sample_time: float) -> Array:
    """Return strain readings (N, G) m/m before noise and quantisation."""
    step = sample_time / motion.steps_per_sample
    strain = motion.fine_strain.copy()
    strain[:, sensors.crosstalk_to] += (sensors.crosstalk
                                        * motion.fine_strain[:, sensors.crosstalk_from])
    strain *= gauge_gains(sensors, np.asarray(step * np.arange(len(strain)), dtype=float))
    late = list(sensors.late or range(strain.shape[1]))
    if sensors.filter_cutoff > 0.0:
        strain[:, late] = low_pass(strain[:, late], sensors, step)
    fine_time = step * np.arange(strain.shape[0])
    time = sample_time * np.arange(motion.joint.shape[0])
    sampled = np.column_stack([
        np.interp(time - sensors.strain_delay * (gauge in late), fine_time, column)
        for gauge, column in enumerate(strain.T)])
    return sampled + np.array(sensors.strain_bias) + np.outer(time, sensors.strain_drift)


def sensor_noise(rng: np.random.Generator, shape: tuple[int, int], deviation: float,
                 sample_time: float) -> Array:
    """Return noise (N, channels) of standard deviation `deviation`, white plus coloured."""
    white = rng.standard_normal(shape)
    decay = float(np.exp(-sample_time / CORRELATION_TIME))
    drive = rng.standard_normal(shape) * (1.0 - decay**2) ** 0.5
    coloured = np.asarray(lfilter([1.0], [1.0, -decay], drive, axis=0))
    return deviation * ((1.0 - COLOURED_SHARE**2) ** 0.5 * white + COLOURED_SHARE * coloured)


def quantise(signal: Array, step: float) -> Array:
    """Return `signal` rounded to multiples of `step` (0: as it is)."""
    return step * np.round(signal / step) if step > 0.0 else signal
