"""
One step of a filter in one compiled call, or in two: the prediction, and the measurement.

A call from Python, and each array that it returns, costs as much as the arithmetic of a few small
arrays. So everything that a step needs is computed inside, and the filter is written in place.
"""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.likelihood import SCORE, update_statistics
from flex_payload_estimator.estimators.rpe.measurement_update import correct
from flex_payload_estimator.estimators.rpe.model_average import model_averaged
from flex_payload_estimator.estimators.rpe.packing import unpack_compiled
from flex_payload_estimator.estimators.rpe.score import update_score
from flex_payload_estimator.estimators.rpe.small_matrices import applied, inner
from flex_payload_estimator.estimators.rpe.time_update import MASS, predict, walk
from flex_payload_estimator.kalman.in_place import add, put
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
import numpy as np

# What a mode assumes: variance of a drive's model error over the square of its net command;
# variance of the payload's walk in a sampling time, kg^2; variance of a gauge's model error over
# the square of its strain; smallest noise variance over that of the robot file; number of gauge
# gains among beta; largest payload, kg; sampling time, s; the gate, see likelihood.gate_of. See
# modes.noise_model.
NoiseModel = tuple[float, float, float, float, float, float, float, float]
# The sampled arm at some parameters: these, (B,), and series, parts, mass_offset and motion of
# time_update.predict.
ModelPoint = tuple[Array, Array, Array, float, Array]
# What all filters of an arm share: C, (m, n); angles by which bending turns the links' ends over
# the state, rad, (2, n); the robot file's noise variances, (m,); see sensors.speed_feedback.
ArmConstants = tuple[Array, Array, Array, Array]
# Payload, kg, and its variance, kg^2; see model_average.py.
Moments = tuple[float, float]
# Rows of the table of sensors.Loads.
MEAN, STRAIN, SWING, DRIVE = range(4)


@compiled
def is_reading(values: Array, limits: Array) -> bool:
    """Tell whether numbers are finite and within their limits."""
    for i in range(values.size):
        # A comparison with NaN is false.
        if not -limits[i] < values[i] < limits[i]:
            return False
    return True


@compiled
def state_estimate(x: Array, sensitivity: Array, beta: Array, reference: Array, fixed: bool
                   ) -> Array:
    """Return the state at the estimated parameters, x + s (beta - reference), (n,)."""
    if not fixed:
        return x
    state = applied(sensitivity, beta - reference)
    add(state, 1.0, x)
    return state


@compiled
def update_loads(table: Array, packed: Array, reference: Array, fixed: bool, averaged_std: Array,
                 share: float, output: Array, command: Array, speed: Array, told: Array,
                 swing_variance: float) -> tuple[bool, Moments]:
    """
    Update the loads by a sample; return whether the arm moves, and the payload's moments.

    It moves where a gauge varies, or a joint of an arm that has none.

    Parameters
    ----------
    table, share : Array, float
        Table of sensors.Loads, changed; share that a sample counts.
    packed, reference, fixed
        Of the incumbent, see `correct_packed`.
    averaged_std : Array
        See model_average.model_averaged.
    output, command : Array
        Of the sample, (m,) and (2,).
    speed : Array
        See sensors.speed_feedback.
    told : Array
        The robot file's noise variances, (m,).
    swing_variance : float
        Variance of a channel over that of its noise from which it swings.

    """
    x, _, sensitivity, beta, beta_cov, statistics, _ = unpack_compiled(
        packed, speed.shape[1], reference.size, output.size)
    held_by = applied(speed, state_estimate(x, sensitivity, beta, reference, fixed))
    swings, first_gauge = False, 2 if output.size > 2 else 0
    kept = 1.0 - share
    for i in range(output.size):
        if i < 2:
            table[DRIVE, i] = kept * table[DRIVE, i] + share * (command[i] - held_by[i])**2
        else:
            table[STRAIN, i] = kept * table[STRAIN, i] + share * output[i] * output[i]
        deviation = output[i] - table[MEAN, i]
        table[MEAN, i] += share * deviation
        table[SWING, i] = kept * table[SWING, i] + kept * share * deviation * deviation
        swings |= i >= first_gauge and table[SWING, i] > swing_variance * told[i] * statistics[i]
    return swings, model_averaged(beta, beta_cov, averaged_std)


@compiled
def predict_packed(previous: Array, packed: Array, reference: Array, fixed: bool,
                   model: ModelPoint, command: Array, command_variance: Array, loads: Array,
                   steps: int, noise_model: NoiseModel, constants: ArmConstants) -> None:
    """
    Predict a filter over some sampling times of one command: x, P, s and V.

    Parameters
    ----------
    previous : Array
        Is made a copy of `packed` as it was.
    packed : Array
        The filter's arrays, see packing.unpack; changed.
    reference, fixed
        See measurement_update.correct.
    model : ModelPoint
        At the parameters where the model is evaluated.
    command, command_variance : Array
        u and the variance of its disturbance, in its unit and that squared, (2,).
    loads : Array
        Table of sensors.Loads. A drive's model error is a share of its recent net torque, and of
        the present one where that is larger.
    steps : int
        Number of sampling times.
    noise_model : NoiseModel
        See modes.noise_model.
    constants : ArmConstants
        Of the arm.

    """
    speed, (model_beta, series, parts, mass_offset, motion) = constants[3], model
    put(previous, packed)
    x, cov, sensitivity, beta, beta_cov, _, _ = unpack_compiled(
        packed, speed.shape[1], reference.size, loads.shape[1])
    drive_error, walk_variance = noise_model[:2]
    if drive_error > 0.0:
        net = command - applied(speed, state_estimate(x, sensitivity, beta, reference, fixed))
        command_variance = command_variance + drive_error * np.maximum(loads[DRIVE, :2],
                                                                       net * net)
    predict(x, cov, sensitivity, model_beta, series, parts, mass_offset, command, motion,
            np.sqrt(command_variance), steps)
    if walk_variance > 0.0:
        walk(cov, sensitivity, beta_cov, steps * walk_variance)


@compiled
def _noise(noise: Array, gauge_error: float, loads: Array, measured: Array) -> Array:
    """Return the sensors' noise variances with those of the gauges' model errors, (m,)."""
    if not gauge_error > 0.0:
        return noise
    strain_square = measured * measured
    strain_square[:2] = 0.0
    return noise + gauge_error * np.maximum(loads, strain_square)


@compiled
def correct_packed(packed: Array, reference: Array, fixed: bool, loads: Array,
                   noise_model: NoiseModel, constants: ArmConstants, measured: Array,
                   offset: Array) -> tuple[float, float, float]:
    """
    Let a filter learn from a measurement, and keep the innovation with its standard deviation.

    Parameters
    ----------
    packed, reference, fixed, loads, noise_model, constants, measured, offset
        See `predict_packed` and measurement_update.correct.

    Returns
    -------
    log_density, stated_log_density : float
        See likelihood.update_statistics.
    mean_square : float
        Mean square of the whitened innovation; NaN where the state is lost, and then nothing is
        learnt.

    """
    channels, (output, bend, told, _) = measured.size, constants
    gauge_error, least_scale, gains, payload_max, step, gate = noise_model[2:]
    x, cov, sensitivity, beta, beta_cov, statistics, innovations = unpack_compiled(
        packed, output.shape[1], reference.size, channels)
    noise = _noise(told * np.maximum(statistics[:channels], least_scale), gauge_error,
                   loads[STRAIN], measured)
    before = beta_cov[MASS, MASS]
    innovation, variances, scores, log_det, change = correct(
        x, cov, sensitivity, beta, beta_cov, reference, fixed, measured, offset, output, noise,
        int(gains), gate, payload_max)
    if np.isnan(log_det):
        return 0.0, 0.0, np.nan
    log_density, stated = update_statistics(
        statistics, innovation, innovations[0], variances, scores, log_det, told,
        least_scale, gate, step)
    ends = applied(bend, x)
    update_score(statistics[SCORE], change, before, beta_cov[MASS, MASS],
                 0.5 * inner(ends, ends), step)
    put(innovations[0], innovation)
    put(innovations[1], np.sqrt(variances))
    # FilterStep.is_beyond_gate divides alike: at the gate no rounding decides.
    return log_density, stated, min(inner(scores, scores), gate) / channels


@compiled
def step_packed(measured: Array, offset: Array, previous: Array, packed: Array, reference: Array,
                fixed: bool, model: ModelPoint, command: Array, command_variance: Array,
                loads: Array, steps: int, noise_model: NoiseModel, constants: ArmConstants
                ) -> tuple[float, float, float]:
    """Predict, and learn from a measurement: `predict_packed`, then `correct_packed`."""
    predict_packed(previous, packed, reference, fixed, model, command, command_variance, loads,
                   steps, noise_model, constants)
    return correct_packed(packed, reference, fixed, loads, noise_model, constants, measured,
                          offset)
