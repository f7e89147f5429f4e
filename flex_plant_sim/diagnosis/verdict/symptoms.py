"""
The symptoms of a model: size, whiteness and dependences of its residuals, whatever the cause.

The report and the JSON answer give them for the nominal and for the extended model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction import free_run
from flex_plant_sim.diagnosis.prediction.free_run import (
    end_errors,
    horizon_samples,
    start_instants,
)
from flex_plant_sim.diagnosis.prediction.latent_series import REST_SPEED_SHARE
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.prediction.spectrum import power_density
from flex_plant_sim.tiny import TINY
from flex_plant_sim.whiteness import autocorrelation, ljung_box
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.special import chdtrc

# Horizons of free runs that a table has room for, s. After the shortest one an error of torque has
# moved the arm.
DRIFTED, SWING, _, LONGEST = free_run.HORIZONS
SHOWN_HORIZONS = (DRIFTED, SWING, LONGEST)
# Number of lags, samples: a quarter of the reference arm's slowest period.
LAGS = 20
# Number of folds of the cross-validation: each fifth is predicted from the other four.
FOLDS = 5
# Number of past commands, samples: a delay of 0.05 s, the longest start of a fit, at 100 Hz.
COMMAND_LAGS = 6
# Number of free runs of DRIFTED at most: they overlap less than longer ones.
SHORT_STARTS = 900
# Error from which the prediction has diverged: sums of its fourth power are still finite.
LARGEST_ERROR = 1e50


@dataclass(frozen=True)
class Whiteness:
    """
    How far the past of a residual predicts its future.

    Attributes
    ----------
    statistic : float
        Ljung and Box, Biometrika 65 (1978): Q over `lags` lags.
    lags : int
    p_value : float
        p-value of Q for a white residual; with many samples any residual fails.
    predictable : float
        Share of the variance that an autoregression with `lags` lags explains, which is what
        matters in practice.

    """

    statistic: float
    lags: int
    p_value: float
    predictable: float


@dataclass(frozen=True)
class ChannelResidual:
    """
    The symptoms in one channel.

    Attributes
    ----------
    channel, unit : str
    noise : float
        Standard deviation of the sensor's white noise, from the record itself.
    swing : float
        Root mean square of the reading about its mean.
    free_run : Mapping
        Root mean square error by horizon, s; the sample time means one-step prediction.
    whiteness : Whiteness
        Whiteness of the one-step residual.
    one_step, drifted : Mapping
        Share of the power that a shape explains on held-out stretches, by shape: of the one-step
        residual, and of the error after DRIFTED seconds of free run.
    bands : tuple
        (low Hz, high Hz, share of the one-step residual's power, share if it were white).

    """

    channel: str
    unit: str
    noise: float
    swing: float
    free_run: Mapping[float, float]
    whiteness: Whiteness
    one_step: Mapping[str, float]
    drifted: Mapping[str, float]
    bands: tuple[tuple[float, float, float, float], ...]

    def results(self) -> dict[str, Any]:
        """Return the figures for JSON; NaN where it diverged."""
        found = asdict(self)
        found['free_run'] = {f'{h:g}': v for h, v in self.free_run.items()}
        return found


def whiteness(parts: Sequence[Array]) -> Whiteness:
    """Return the whiteness of a residual, given as stretches (N_k,) without gaps."""
    count = sum(len(part) for part in parts)
    lags = min(LAGS, *(len(part) - 1 for part in parts))
    rho = autocorrelation(parts, lags)
    if not rho.any():
        return Whiteness(0.0, lags, 1.0, 0.0)
    statistic = float(ljung_box(rho, count))
    explained = float(rho[1:] @ solve_toeplitz(rho[:-1], rho[1:]))
    adjusted = 1.0 - (1.0 - explained) * count / max(count - lags, 1)
    return Whiteness(statistic, lags, float(chdtrc(lags, statistic)), max(adjusted, 0.0))


def shapes(predictor: Predictor) -> dict[str, Array]:
    """
    Return the shapes that a residual may depend on, by name: columns (N, k) over the record.

    They are computed from the predicted state and the commands, not from the measured channels,
    whose noise is also in the residual.
    """
    arm, record, order = predictor.arm, predictor.record, predictor.arm.form.order
    states = _zero_if_diverged(predictor.states)
    angle, speed = states[:, :2], states[:, order:order + 2]
    load = arm.output(states, record.time)[:, 2:]
    rest = np.maximum(REST_SPEED_SHARE * np.sqrt(np.mean(speed**2, axis=0)), TINY)
    padded = np.vstack([np.repeat(record.command[:1], COMMAND_LAGS, axis=0), record.command])
    commands = [padded[k:k + len(record.time)] for k in range(1, COMMAND_LAGS + 1)]
    time = (record.time - record.time[0])[:, None] / max(np.ptp(record.time), TINY)
    return {
        'velocity sign': np.tanh(speed / rest),
        'speed': np.hstack([speed, speed * np.abs(speed)]),
        'angle': np.hstack([np.sin(angle), np.cos(angle)]),
        'load': load,
        'command': np.hstack(commands),
        'time': np.hstack([time, time**2])}


def explained_share(residual: Array, columns: Array, fold: NDArray[np.int_]) -> Array:
    """
    Return the share of each channel's power that the columns explain on held-out rows, (m,).

    Parameters
    ----------
    residual : Array
        (N, m).
    columns : Array
        (N, k); a constant is added.
    fold : Array
        Number of the held-out group of each row, (N,).

    """
    design = np.hstack([np.ones((len(columns), 1)), columns])
    scale = np.sqrt(np.mean(design**2, axis=0))
    design = design[:, scale > 0.0] / scale[scale > 0.0]
    left, constant = np.zeros(residual.shape[1]), np.zeros(residual.shape[1])
    for k in np.unique(fold):
        out = fold == k
        fitted = np.linalg.lstsq(design[~out], residual[~out], rcond=1e-8)[0]
        left += np.sum((residual[out] - design[out] @ fitted)**2, axis=0)
        constant += np.sum((residual[out] - residual[~out].mean(axis=0))**2, axis=0)
    return np.clip(1.0 - left / np.maximum(constant, TINY), 0.0, 1.0)


def _dependences(residual: Array, columns: Mapping[str, Array],
                 fold: NDArray[np.int_]) -> list[dict]:
    constant = np.mean(residual, axis=0)**2 / np.maximum(np.mean(residual**2, axis=0), TINY)
    shares = {'constant': constant, **{
        name: explained_share(residual, values, fold) for name, values in columns.items()}}
    return [{name: float(share[k]) for name, share in shares.items()}
            for k in range(residual.shape[1])]


def natural_frequencies(predictor: Predictor) -> Array:
    """Return the vibration frequencies of the base model at the middle angle, Hz, ascending."""
    plant = predictor.arm.plant.a
    poles = np.linalg.eigvals(plant[len(plant) // 2])
    swinging = poles[poles.imag > 1e-3 * np.abs(poles)]
    return np.sort(np.abs(swinging)) / (2.0 * np.pi)


def spectrum(parts: Sequence[Array], sample_time: float) -> tuple[Array, Array]:
    """Return frequencies, Hz, (F,), and the power density (F, m) of stretches (N_k, m)."""
    length = min(512, *(len(part) for part in parts))
    spectra = [power_density(part, sample_time, length) for part in parts]
    weight = np.array([len(part) for part in parts], dtype=float)
    power = np.tensordot(weight / weight.sum(), [density for _, density in spectra], axes=1)
    return spectra[0][0], power


def bands(parts: Sequence[Array], edges: Array, sample_time: float
          ) -> list[tuple[tuple[float, float, float, float], ...]]:
    """Return for each channel (low, high, share of power, share if white) between edges, Hz."""
    frequency, power = spectrum(parts, sample_time)
    inside = [(frequency >= low) & (frequency < high) for low, high in zip(edges, edges[1:])]
    total = np.maximum(power.sum(axis=0), TINY)
    return [tuple((float(low), float(high), float(power[i, k].sum() / total[k]),
                   float(i.mean())) for low, high, i in zip(edges, edges[1:], inside))
            for k in range(power.shape[1])]


def band_edges(predictor: Predictor) -> Array:
    """Return edges of bands below the slowest mode, around two modes, and above; Hz."""
    nyquist = 0.5 / predictor.base.robot.sample_time
    modes = natural_frequencies(predictor)
    inner = [0.5 * modes[0], *(np.sqrt(modes[:2] * modes[1:3]))] if len(modes) > 2 else []
    return np.array([0.0, *(f for f in inner if f < 0.9 * nyquist), 1.01 * nyquist])


def one_step(predictor: Predictor) -> Array:
    """Return measured minus predicted over the record except for its first window, (N, m)."""
    with np.errstate(over='ignore', invalid='ignore'):
        predicted = predictor.arm.output(predictor.states, predictor.record.time)
    return (predictor.record.output - predicted)[predictor.windows.warm_up:]


def describe(predictors: Sequence[Predictor]) -> tuple[ChannelResidual, ...]:
    """
    Return the symptoms in every channel over all records.

    Parameters
    ----------
    predictors : sequence of Predictor
        One for each record, of the model to judge.

    """
    first = predictors[0]
    robot = first.base.robot
    step, channels = robot.sample_time, zip(robot.output_names, robot.output_units)
    raw = [one_step(p) for p in predictors]
    steps = [_zero_if_diverged(e) for e in raw]
    now = _over_records(predictors, steps, [
        p.windows.warm_up + np.arange(len(e)) for p, e in zip(predictors, steps)])
    rows, final = zip(*(drift(p) for p in predictors))
    later = _over_records(predictors, final, rows)
    in_bands = bands(steps, band_edges(first), step)
    runs = _free_run_errors(predictors, raw, SHOWN_HORIZONS)
    noise = np.sqrt(np.mean([p.noise**2 for p in predictors], axis=0))
    swing = np.std(np.vstack([p.record.output for p in predictors]), axis=0)
    return tuple(ChannelResidual(
        name, unit, float(noise[k]), float(swing[k]),
        {h: float(e[k]) for h, e in runs.items()}, whiteness([part[:, k] for part in steps]),
        now[k], later[k], in_bands[k]) for k, (name, unit) in enumerate(channels))


def _over_records(predictors: Sequence[Predictor], residuals: Sequence[Array],
                  rows: Sequence[NDArray[np.int_]]) -> list[dict]:
    """Return the dependences of residuals at given sample numbers over all records."""
    found = [shapes(p) for p in predictors]
    columns = {name: np.vstack([s[name][r] for s, r in zip(found, rows)]) for name in found[0]}
    fold = np.concatenate([r // p.windows.length % FOLDS for p, r in zip(predictors, rows)])
    return _dependences(np.vstack(residuals), columns, fold)


def drift(predictor: Predictor,
          horizon: float = DRIFTED) -> tuple[NDArray[np.int_], Array]:
    """Return the middle samples of short free runs, (S,), and the errors at their ends, (S, m)."""
    samples = horizon_samples(horizon, predictor.base.robot.sample_time)
    count = len(predictor.record.time)
    starts = start_instants(predictor.windows.warm_up, count - samples, SHORT_STARTS)
    final = end_errors(predictor, starts, [samples], count)[samples]
    return starts + samples // 2, _zero_if_diverged(final)


def _zero_if_diverged(values: Array) -> Array:
    """Return values, with zero where a prediction has diverged and so shows no dependence."""
    return np.where(np.abs(values) < LARGEST_ERROR, values, 0.0)


def _free_run_errors(predictors: Sequence[Predictor], steps: Sequence[Array],
                     horizons: Sequence[float]) -> dict[float, Array]:
    step = predictors[0].base.robot.sample_time
    found: dict[float, list[Array]] = {step: list(steps)}
    for p in predictors:
        samples = {h: horizon_samples(h, step) for h in horizons}
        count = len(p.record.time)
        fitting = {h: k for h, k in samples.items() if p.windows.warm_up + k < count}
        if not fitting:
            continue
        starts = start_instants(p.windows.warm_up, count - min(fitting.values()))
        ends = end_errors(p, starts, set(fitting.values()), count)
        for h, k in fitting.items():
            found.setdefault(h, []).append(ends[k])
    with np.errstate(over='ignore', invalid='ignore'):
        return {h: np.sqrt(np.mean(np.vstack(e)**2, axis=0)) for h, e in found.items()}
