"""
One step of a filter in one compiled call, or in two: ahead to the next sample, and what it tells.

A call from Python, and each array that it returns, costs as much as the arithmetic of a few small
arrays. So all that a step needs is worked out inside, and what a filter knows is written in place.
"""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.correction import correct
from flex_payload_estimator.estimators.rpe.evidence import weigh
from flex_payload_estimator.estimators.rpe.kernel import predict, walk
from flex_payload_estimator.estimators.rpe.knowledge import parts_of
from flex_payload_estimator.estimators.rpe.model_average import model_averaged
from flex_payload_estimator.estimators.rpe.products import applied, inner
from flex_payload_estimator.kalman.in_place import add, add_matrix, put
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# What a mode assumes: variance of the model error of a drive over the square of its net command,
# and that by which the payload walks a sampling time, kg^2; variance of the model error of a gauge
# over the square of what it sees; noise variance over the told one, at least; how many gauges'
# gains are among beta; the largest payload, kg; the sampling time, s.
Assumed = tuple[float, float, float, float, float, float, float]
# What a filter says: payload, kg, and its variance, kg^2, see model_averaged.
Said = tuple[float, float]
# Rows of Loads' table.
MEAN, STRAIN, SWING, DRIVE = range(4)
# e' Sigma^-1 e beyond which a sample's noise counts as larger: six normal draws squared sum to
# more once in 10^7 samples.
GATE = 44.0


@compiled
def state_of(x: Array, sens: Array, beta: Array, anchor: Array, held: bool) -> Array:
    """Return the state for the parameters believed, (n,)."""
    if not held:
        return x
    state = applied(sens, beta - anchor)
    add(state, 1.0, x)
    return state


@compiled
def followed(after: Array, known: Array, anchor: Array, held: bool, lasting: Array, table: Array,
             share: float, output: Array, command: Array, speed: Array, told: Array, swing: float
             ) -> tuple[bool, Said]:
    """
    Write the loads after a sample; return whether a gauge swings beyond its noise, and `Said`.

    Parameters
    ----------
    after, table, share : Array, Array, float
        Zeros, where they are written, and those before, see sensors.Loads.
    known, anchor, held, told
        Of the incumbent, see `learnt`.
    lasting : Array
        See model_averaged.
    output, command : Array
        (m,) and (2,).
    speed : Array
        See sensors.speed_feedback.
    swing : float
        Variance of a gauge over that of its noise that is a swing.

    """
    x, _, sens, beta, spread, record, _ = parts_of(known, speed.shape[1], anchor.size, output.size)
    held_by, swings = applied(speed, state_of(x, sens, beta, anchor, held)), False
    add_matrix(after, 1.0 - share, table)
    for i in range(output.size):
        if i < 2:
            after[DRIVE, i] += share * (command[i] - held_by[i])**2
        off = output[i] - table[MEAN, i]
        after[MEAN, i] = table[MEAN, i] + share * off
        if i > 1:
            after[STRAIN, i] += share * output[i] * output[i]
        after[SWING, i] += (1.0 - share) * share * off * off
        swings |= i > 1 and after[SWING, i] > swing * told[i] * record[i]
    return swings, model_averaged(beta, spread, lasting)


@compiled
def ahead(kept: Array, known: Array, anchor: Array, held: bool, about: Array, series: Array,
          parts: Array, away: float, motion: Array, command: Array, doubt: Array, speed: Array,
          loads: Array, steps: int, assumed: Assumed) -> None:
    """
    Bring a filter some sampling times on, with one command: x, P, s and V.

    Parameters
    ----------
    kept : Array
        What the filter knew before is left here.
    known : Array
        What it knows, see knowledge.parted.
    anchor, held
        See correction.correct.
    about, series, parts, away, motion
        The model; see kernel.predict, whose anchor `about` is.
    command, doubt : Array
        u, (2,), and the variance of its disturbance, (2,).
    speed : Array
        See sensors.speed_feedback.
    loads : Array
        See sensors.Loads: the error is of what was carried of late, and no less than of now.
    steps : int
        How many sampling times.
    assumed : Assumed
        See hypothesis.assumed.

    """
    put(kept, known)
    x, cov, sens, beta, spread, _, _ = parts_of(known, speed.shape[1], anchor.size,
                                                loads.shape[1])
    push, walked = assumed[:2]
    if push > 0.0:
        net = command - applied(speed, state_of(x, sens, beta, anchor, held))
        doubt = doubt + push * np.maximum(loads[DRIVE, :2], net * net)
    predict(x, cov, sens, about, series, parts, away, command, motion, np.sqrt(doubt), steps)
    if walked > 0.0:
        walk(cov, sens, spread, steps * walked)


@compiled
def learnt(known: Array, anchor: Array, held: bool, loads: Array, measured: Array, offset: Array,
           output: Array, told: Array, assumed: Assumed) -> tuple[float, float, float, float]:
    """
    Let a filter learn from a measurement; its reading is the innovation and its deviations.

    Parameters
    ----------
    known, loads, assumed
        See `ahead`.
    anchor, held, measured, offset, output
        See correction.correct.
    told : Array
        See evidence.weigh.

    Returns
    -------
    tuple
        The log-likelihoods, see evidence.weigh; mean square of the whitened innovation, NaN where
        the state is lost: then nothing is learnt.

    """
    channels, (error, least, gains, heaviest, step) = measured.size, assumed[2:]
    x, cov, sens, beta, spread, record, reading = parts_of(known, output.shape[1], anchor.size,
                                                           channels)
    noise = told * np.maximum(record[:channels], least)
    if error > 0.0:
        seen = measured * measured
        seen[:2] = 0.0
        noise = noise + error * np.maximum(loads[STRAIN], seen)
    innovation, variances, scores, log_det = correct(
        x, cov, sens, beta, spread, anchor, held, measured, offset, output, noise, int(gains),
        GATE, heaviest)
    if np.isnan(log_det):
        return 0.0, 0.0, np.nan, 0.0
    gained, stated, fallen = weigh(record, innovation, reading[0], variances, scores, log_det,
                                   told, GATE, step)
    put(reading[0], innovation)
    put(reading[1], np.sqrt(variances))
    return gained, stated, min(inner(scores, scores), GATE) / channels, fallen


@compiled
def stepped(measured: Array, offset: Array, output: Array, told: Array, kept: Array, known: Array,
            anchor: Array, held: bool, about: Array, series: Array, parts: Array, away: float,
            motion: Array, command: Array, doubt: Array, speed: Array, loads: Array, steps: int,
            assumed: Assumed) -> tuple[float, float, float, float]:
    """Do both."""
    ahead(kept, known, anchor, held, about, series, parts, away, motion, command, doubt, speed,
          loads, steps, assumed)
    return learnt(known, anchor, held, loads, measured, offset, output, told, assumed)
