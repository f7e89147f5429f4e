"""Filters that begin with what another one knows: after a rest, in a mode, or relinearised."""

from __future__ import annotations

from dataclasses import replace
import math

from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.filter_step import FilterStep
from flex_payload_estimator.estimators.rpe.likelihood import (
    initial_statistics,
    NOISE_RATIO,
    SCORE,
)
from flex_payload_estimator.estimators.rpe.linearised import at_payload, LinearisedModel
from flex_payload_estimator.estimators.rpe.modes import freedom, Mode, ROUGH, ROUGH_ON_TRIAL
from flex_payload_estimator.estimators.rpe.packing import pack
from flex_payload_estimator.estimators.rpe.sample_window import StoredSample
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_payload_estimator.estimators.rpe.time_update import CORIOLIS, FIRST_BIAS, MASS
from flex_payload_estimator.estimators.rpe.zero import reading_sensitivity, zero_column
from flex_plant_sim.arm.second_order import Array
import numpy as np

# Least standard deviation of the payload at a restart, as a share of (m + soft mass), and of the
# state that it adds, as a share of that at the very start.
RESTART_PAYLOAD_STD, RESTART_STATE_STD = 0.3, 0.01
# And of the payload in standard deviations of the filter before, which may be surer than right:
# chosen.
RESTART_DEVIATIONS = 3.0
# Gauss-Newton passes over the sample window, see window_pass.py.
PASSES = 3


def hand_over_rest(rested: Filter, f: Filter) -> None:
    """
    Give a filter the state, gauge biases and noise found at rest; it keeps its payload and zero.

    The other parameters of the filter at rest are marginalised: with g the gauges' columns,
    cov(x, beta_g) = s V_g, so the state is x with sensitivity G = s V_g V_gg^-1 to the biases and
    P = P_rest + s V s' - G (s V_g)'. Of theta_2 the reading is handed over, see zero.py.

    Parameters
    ----------
    rested : Filter
        At rest; unchanged.
    f : Filter
        Changed in place.

    """
    zero = zero_column(rested.sizes[2])
    gauges = slice(FIRST_BIAS, zero)
    bias_cov = rested.beta_cov[gauges, gauges]
    sensitivity = reading_sensitivity(rested)
    cross_cov = (sensitivity @ rested.beta_cov)[:, gauges]
    slope = cross_cov @ np.linalg.pinv(bias_cov, hermitian=True)
    state_cov = rested.cov + sensitivity @ rested.beta_cov @ sensitivity.T
    f.x[:], f.cov[:], f.sensitivity[:, gauges] = rested.x, state_cov - cross_cov @ slope.T, slope
    f.x[1] += rested.beta[zero] - f.beta[zero]
    f.sensitivity[1, zero] = -1.0
    f.beta[gauges], f.beta_cov[gauges, gauges] = rested.beta[gauges], bias_cov
    f.statistics[:], f.innovations[:] = rested.statistics, rested.innovations
    # What noise did to the payload at rest is not handed over, as that payload is not.
    f.statistics[SCORE] = 0.0
    f.x -= f.sensitivity @ (f.beta - f.reference)


def _restarted(new: Filter, f: Filter, x: Array, beta: Array, beta_cov: Array, state_std: float,
               stepper: FilterStep) -> Filter:
    """Return `new` with the state covariance and noise of f, and the parameters given."""
    states, _, channels = f.sizes
    zero, before, sensitivity = zero_column(channels), reading_sensitivity(f), np.zeros(
        (states, beta.size))
    cov = f.cov + before @ f.beta_cov @ before.T + state_std**2 * stepper.start_cov
    x = x.copy()
    x[1] += f.beta[zero] - beta[zero]
    sensitivity[1, zero] = -1.0
    statistics = initial_statistics(channels)
    statistics[:channels] = f.noise_scale
    packed = pack(x, cov, sensitivity, beta, beta_cov, statistics, f.innovations)
    return replace(new, packed=packed, sizes=(states, beta.size, channels), age=0.0,
                   age_linearised=0.0, previous=None)


def restarted(f: Filter, mode: Mode, state_std: float, stepper: FilterStep) -> Filter:
    """
    Return a filter of a mode at the state of another filter, with the parameters' prior.

    Parameters
    ----------
    f : Filter
        Gives state, noise and payload.
    mode : Mode
        Of the new filter.
    state_std : float
        Standard deviation of the state beyond what f states, as a share of that at the start.
    stepper : FilterStep
        Model and prior.

    """
    prior = stepper.prior_of(mode)
    std = max(RESTART_DEVIATIONS * math.sqrt(f.variance), RESTART_PAYLOAD_STD * (
        f.mass + stepper.schedule.soft_mass))
    beta = prior.mean.copy()
    beta[MASS] = f.beta[MASS]
    if not mode.free_parts:
        beta[CORIOLIS] = min(stepper.shares, key=lambda share: abs(share - f.beta[CORIOLIS]))
    return _restarted(replace(f, mode=mode, model=None, passes=0), f, f.state, beta,
                      prior.covariance(std), state_std, stepper)


def linearised_every_sample(f: Filter) -> Filter:
    """Return the same filter, linearised about its estimate at every sample from now on."""
    new = replace(f, packed=f.packed.copy(), model=None, previous=None)
    new.x[:] = f.state
    return new


def relinearised(f: Filter, stepper: FilterStep, model: LinearisedModel | None = None) -> Filter:
    """Return the same filter, linearised about a model, or about its estimate, from now on."""
    if model is None:
        model = stepper.lineariser.model_about(stepper.prior.within(f.beta)) \
            if f.mode.free_parts else about_file(f.beta, f.mode, stepper)
    new = replace(f, packed=f.packed.copy(), model=model, age_linearised=f.age, previous=None)
    new.x += f.sensitivity @ (new.reference - f.reference)
    return new


def about_file(beta: Array, mode: Mode, stepper: FilterStep) -> LinearisedModel:
    """Return a mode's model about parameters, (B,), with the parts' tables of the robot file."""
    return at_payload(stepper.schedule, beta.copy(), stepper.motion[mode.bending],
                      mode.free_parts)


def about_cells(f: Filter, mode: Mode, stepper: FilterStep) -> list[LinearisedModel]:
    """Return a mode's models about each payload cell, parts as told, and the rest as f found."""
    prior, models = stepper.prior, []
    reference = prior.within(f.beta)
    reference[prior.zero + 1:] = prior.mean[prior.zero + 1:]
    for low, high in stepper.payload_cells():
        reference[MASS] = 0.5 * (low + high)
        models.append(about_file(reference, mode, stepper))
    return models


def restarted_at(f: Filter, first: Sample, loads: Loads, rested: Filter | None,
                 stepper: FilterStep, model: LinearisedModel | None = None) -> Filter:
    """
    Return a filter that begins from its prior at an earlier sample, linearised about f's estimate.

    Parameters
    ----------
    f : Filter
        Gives mode and linearisation point: payload, share of the forces of motion, and parts.
    first, loads : Sample, Loads
        Where it begins.
    rested : Filter or None
        What was known at that sample of an arm at rest.
    stepper : FilterStep
        Model and prior.
    model : LinearisedModel or None
        About which it is linearised, where that is not f's estimate.

    """
    prior, new = stepper.prior_of(f.mode), relinearised(f, stepper, model)
    beta = prior.mean.copy()
    beta[MASS] = new.reference[MASS]
    if not f.mode.free_parts:
        beta[CORIOLIS] = new.reference[CORIOLIS]
    beta_cov = prior.covariance(RESTART_PAYLOAD_STD * (beta[MASS] + stepper.schedule.soft_mass))
    new = _restarted(new, f, new.x, beta, beta_cov, 0.0, stepper)
    new.passes, new.log_likelihood, new.age_linearised = f.passes + 1, 0.0, f.age
    begin_at(new, first, loads, rested, stepper)
    return new


def begin_at(new: Filter, first: Sample, loads: Loads, rested: Filter | None,
             stepper: FilterStep) -> None:
    """Begin a filter at a sample: from the rest before it if its noise was known, else anew."""
    if rested is not None and (new.noise_scale < NOISE_RATIO * rested.noise_scale).all():
        hand_over_rest(rested, new)
        return
    stepper.relocate(new, first.measured)
    if first.measured is not None:
        stepper.correct(new, first, loads)


def with_payload_walk(f: Filter, walk: float) -> tuple[Filter, Filter | None]:
    """
    Return a filter that knows what f knows, and whose payload walks, kg/sqrt(s).

    Then the same filter linearised as f is; None where f is linearised about its estimate too.
    The first follows the payload wherever it goes; the second is compared with f. Where the point
    of linearisation moves, a filter seems to learn of the parts what it does not (Huang, Mourikis
    and Roumeliotis, Int. J. Robotics Research 29, 2010): it expects less than f, and would be the
    likelier for that alone.
    """
    mode = f.mode._replace(payload_walk=walk)
    return _in_mode(linearised_every_sample(f), mode), \
        None if f.model is None else _in_mode(f, mode)


def with_constant_payload(f: Filter, stepper: FilterStep) -> list[Filter]:
    """
    Return filters of f's mode whose payload no longer walks.

    One is restarted at the present state; with free parts, another keeps what f knows.
    """
    mode = f.mode._replace(payload_walk=0.0)
    return [_wide_restart(f, mode, stepper), *([_in_mode(f, mode)] if mode.free_parts else [])]


def in_other_mode(f: Filter, mode: Mode, last: StoredSample, stepper: FilterStep) -> Filter:
    """
    Return a filter of another mode, after the last sample.

    From `coarse` to `rough` it takes from f the noise alone, and any payload of the range: what
    drove f far off may be over. `coarse` is linearised about what f found until its first pass:
    about its moving estimate it falls to where a payload shows most, at nothing, and is sure.
    """
    if freedom(mode) < freedom(f.mode):
        mass = 0.5 * stepper.payload_max
        new = stepper.begin(mode, f.innovations[0], mass, mass / math.sqrt(3.0))
        new.noise_scale[:] = f.noise_scale
        begin_at(new, last.sample, last.loads, None, stepper)
        return new
    if mode.name == ROUGH.name:
        return _wide_restart(f, ROUGH_ON_TRIAL, stepper)
    return relinearised(_wide_restart(f, mode, stepper), stepper)


def _in_mode(f: Filter, mode: Mode) -> Filter:
    new = f.copy()
    new.mode = mode
    return new


def _wide_restart(f: Filter, mode: Mode, stepper: FilterStep) -> Filter:
    new = restarted(f, mode, RESTART_STATE_STD, stepper)
    if not mode.free_parts:
        # It has the present state and gauge biases, without which a pass over the window begins.
        new.passes = PASSES
    return new
