"""
Latent forces: the torque at each joint and the error of each gauge that a model does not explain.

They are smoothed from a record under the nominal arm or an extended one; `latent_series` arranges
them, `law` finds what they depend on.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.prediction.filter_run import (
    FilterRun,
    over_payloads,
    payload_arms,
    payload_schedule,
    predictor_matrices,
)
from flex_plant_sim.diagnosis.prediction.first_state import START
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.prediction.process_noise import (
    load_deviations,
    net_torques,
    process_noise_variance,
    REFERENCE_STEP,
)
from flex_plant_sim.diagnosis.prediction.smoother import LatentSystem, smooth, Smoothed
from flex_plant_sim.effects.joint.measured_torque import load_row
import numpy as np

# Passes of the smoother: the first with Gaussian steps, the others with Student-t weights. A
# budget: a joint's dry friction is then within 8 % (rms) of what 16 passes find, with 2 within
# 33 %; on a clean arm 0.1 and 0.7 %.
EM_PASSES = 4
# Degrees of freedom of a torque's steps; heavy tails, as friction jumps where a joint reverses:
# the heaviest of a whole number whose variance is finite.
STUDENT_FREEDOM = 3.0
# Smallest torque, N m, and strain that a drive or a gauge can have, for those that stand still:
# far below any that matters, and a covariance with it keeps its digits.
LEAST = 1e-12


@dataclass(frozen=True)
class LatentPrior:
    """
    The prior scales of latent forces.

    Calibrated by benchmarks/latent_amplitudes.py: with a torque of 0.03 the 95 % bands hold 96 and
    98 % of the samples of joints 1 and 2, with 0.02 94 and 96 %, with 0.01 87 and 93 %. The
    gauge's share hardly matters there.

    Attributes
    ----------
    torque : float
        Standard deviation of a torque's change over one second, over the drive's net torque.
    gauge : float
        Standard deviation of a gauge's error, as a share of the rms strain; its correlation time
        is that of the discrepancy.

    """

    torque: float = 0.03
    gauge: float = DiscrepancyModel.gauge_share


@dataclass(frozen=True)
class LatentForces:
    """
    The latent forces along a record, with the motion they may depend on.

    Attributes
    ----------
    time : Array
        s, (N,).
    torque, torque_deviation : Array
        N m, (N, 2), and posterior standard deviation.
    gauge, gauge_deviation : Array
        Strain, (N, gauges), and posterior standard deviation.
    speed, angle, command : Array
        Of the joints, (N, 2): rad/s, rad, drive unit.
    strain : Array
        Smoothed, without the gauges' error, (N, gauges).
    load : Array
        Bending moment at each link's first gauge, N m, (N, 2); 0 where there is none.
    drive : Array
        Net torque of the drives, see `net_torques`, N m, (2,).
    gauge_time : float
        Correlation time of the gauges' error, s.
    first, stop : int
        Samples to fit laws to, without the initial transient and the locked part.

    """

    time: Array
    torque: Array
    torque_deviation: Array
    gauge: Array
    gauge_deviation: Array
    speed: Array
    angle: Array
    command: Array
    strain: Array
    load: Array
    drive: Array
    gauge_time: float
    first: int
    stop: int


def latent_forces(predictor: Predictor, prior: LatentPrior = LatentPrior(),
                  scored: slice | None = None) -> LatentForces:
    """
    Return the latent forces of a record under the predictor's base.

    Torques are random walks with Student-t steps. Their scale, and that of the gauge errors, is
    the maximum-likelihood one by expectation maximisation, but no smaller than the prior's.

    Parameters
    ----------
    predictor : Predictor
        Of the base, over the whole record.
    prior : LatentPrior
        Their scales.
    scored : slice, optional
        Samples to fit laws to; by default all after the initial transient.

    """
    system = latent_system(predictor, prior)
    least = scale = system.walk_variance[0]
    smoothed = smooth(system)
    known = system.known_step
    if not predictor.arm.gaps:
        # Whether teeth touch only the filter knows: the linear smoother lets them meet anywhere.
        known = _known_step(_along_states(predictor, smoothed.mean[:, :system.states]))
    for _ in range(EM_PASSES - 1):
        squared = smoothed.increment_power
        scale = np.maximum(np.mean(squared / _student_widening(squared, scale), axis=0), least)
        system = replace(system, known_step=known,
                         walk_variance=scale * _student_widening(squared, scale))
        smoothed = smooth(system)
    return _latent_forces_of(predictor, smoothed, scored or slice(
        predictor.windows.warm_up, len(system.measured)))


def _student_widening(squared: Array, scale: Array) -> Array:
    """
    Return the factor on the variance of steps with these mean squares under Student's t, (N, m).

    The reciprocal of the weight of Lange, Little and Taylor, Journal of the American Statistical
    Association 84 (1989). Gauge errors do not jump: their factor is 1.
    """
    wider = (STUDENT_FREEDOM + squared / scale) / (STUDENT_FREEDOM + 1.0)
    wider[:, 2:] = 1.0
    return np.asarray(wider, dtype=float)


def latent_system(predictor: Predictor, prior: LatentPrior) -> LatentSystem:
    """Return the system of the predictor's base with latent forces."""
    arm, record = predictor.arm, predictor.record
    step = arm.step_time
    weights, table = payload_schedule(arm, record.time, predictor.weights_of(arm))
    n = arm.states
    table = table.reshape(len(table), n, -1)
    torques = np.concatenate([table[..., :n], table[..., n + 2:] @ arm.form.force], axis=-1)
    drive = np.maximum(net_torques(arm, predictor.windows), LEAST)
    strain = np.maximum(record.output_deviation[2:], LEAST)
    decay = float(np.exp(-step / predictor.discrepancy['gauge_time_s']))
    gauge = (prior.gauge * strain)**2
    walk_variance = np.concatenate([step * (prior.torque * drive)**2,
                                    gauge * (1.0 - decay**2)])
    return LatentSystem(
        weights, np.ascontiguousarray(torques), _known_step(predictor),
        np.ascontiguousarray(arm.output_matrix),
        np.ascontiguousarray(predictor.measured_by(arm)[:, 0]), predictor.noise**2,
        _process_covariance(predictor, table), decay,
        np.tile(walk_variance, (len(record.time), 1)),
        _initial_mean(predictor), _initial_deviation(predictor, drive, gauge))


def _along_states(predictor: Predictor, states: Array) -> Predictor:
    """Return the predictor with motion-dependent forces evaluated along other states, (N, n)."""
    other = copy(predictor)
    other.states = states
    return other


def _known_step(predictor: Predictor) -> Array:
    """Return what commands, known forces and contact add in each step, (N, n)."""
    arm, rows = predictor.arm, np.arange(len(predictor.record.time))
    open_loop = predictor_matrices(predictor, arm, np.zeros_like(predictor.gain), rows)
    run = FilterRun(predictor, arm, open_loop, rows, 1)
    states = run.trajectory
    inputs = open_loop.step_states(np.zeros_like(states), run.drive)
    if not arm.has_contact:
        return inputs[:, 0]
    free = open_loop.step_states(states, run.drive)
    motion = arm.motion(states, run.command, run.time)
    share, arms = payload_arms(arm, predictor.record.time)
    cosine = np.cos(motion.position[:, 0, 1])
    parted = arm.apply_gaps(states, free, motion, [
        [part[:, None] for part in over_payloads(share, opening, cosine)]
        for opening in zip(*(loaded.openings for loaded in arms))])
    stopped = arm.apply_friction(run.force_response[:, None], states, parted, motion)
    return np.asarray((inputs + stopped - free)[:, 0], dtype=float)


def _process_covariance(predictor: Predictor, table: Array) -> Array:
    """Return the covariance of a step due to force noise on the deflections, (n, n)."""
    arm, base = predictor.arm, predictor.base
    loads = load_deviations(arm, predictor.windows)
    variance = REFERENCE_STEP / arm.step_time * process_noise_variance(
        loads, (0.0, base.noise_shares[1]))
    e = table[len(table) // 2][:, arm.states + 2:]
    return np.asarray((e * variance) @ e.T, dtype=float)


def _initial_mean(predictor: Predictor) -> Array:
    return np.concatenate([predictor.record.output[0, :2],
                           np.zeros(predictor.arm.states - 2)])


def _initial_deviation(predictor: Predictor, drive: Array, gauge: Array) -> Array:
    """Return the standard deviation of the first z, (n + m,)."""
    return np.concatenate([np.full(predictor.arm.states, START), drive, np.sqrt(gauge)])


def _latent_forces_of(predictor: Predictor, smoothed: Smoothed, scored: slice
                      ) -> LatentForces:
    arm, record, n = predictor.arm, predictor.record, predictor.arm.states
    order = arm.form.order
    state, latent = smoothed.mean[:, :n], smoothed.mean[:, n:]
    loads = [load_row(arm.form, arm.robot, j) if link.gauge_positions else np.zeros(order)
             for j, link in enumerate(arm.robot.links)]
    return LatentForces(
        time=record.time, torque=latent[:, :2], torque_deviation=smoothed.deviation[:, :2],
        gauge=latent[:, 2:], gauge_deviation=smoothed.deviation[:, 2:],
        speed=state[:, order:order + 2], angle=state[:, :2], command=record.command,
        strain=(state @ arm.output_matrix.T)[:, 2:], load=state[:, :order] @ np.array(loads).T,
        drive=net_torques(arm, predictor.windows),
        gauge_time=predictor.discrepancy['gauge_time_s'], first=scored.start, stop=scored.stop)
