"""Records, base model and nuisances together: residuals and what base parameters explain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.held_out.allowance import model_error
from flex_plant_sim.diagnosis.held_out.nuisance import Nuisance, nuisances, settled, settled_base
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude
from flex_plant_sim.diagnosis.prediction.noise import Steady
from flex_plant_sim.diagnosis.prediction.predictor import Base, Predictor
from flex_plant_sim.diagnosis.record.windows import Windows
from flex_plant_sim.effects.base import Effect
import numpy as np

STEP = 0.2
# What judges takes a hundredth of what gauges see for their own error.
GAUGES_ALONE = Amplitude(0.0, 0.01, 1.0, 0.05)
BLOCKS_PER_WINDOW = 8


@dataclass(frozen=True)
class Weighting:
    """
    How residuals turn into nats.

    Attributes
    ----------
    whitener : Array
        L^-1 with L L' the innovation covariance, (m, m).
    temper : float
        Long-run over white variance of the scores: coloured residuals and model error count
        for less.

    """

    whitener: Array
    temper: float

    @property
    def log_determinant(self) -> float:
        """Return log det of the innovation covariance."""
        return -2.0 * float(np.sum(np.log(np.diagonal(self.whitener))))

    def white(self, residual: Array) -> Array:
        """Return L^-1 e for e (…, m)."""
        return residual @ self.whitener.T

    def white_columns(self, directions: Array) -> Array:
        """Return L^-1 d for every column of directions (…, m, p)."""
        return white_columns(self.whitener, directions)


class Problem:
    """
    What every hypothesis is fitted to.

    Parameters
    ----------
    base : Base
    windows : sequence of Windows
        One per record.
    noise : sequence of Array
        Sensor noise per record, (m,).
    around : tuple of Effect
        Effects that are on while the sensitivity to base parameters is taken.
    judging : bool
        See Predictor.

    """

    def __init__(self, base: Base, windows: Sequence[Windows], noise: Sequence[Array],
                 around: tuple[Effect, ...] = (), judging: bool = False):
        self.judging = judging
        self.around, self.noise = around, tuple(noise)
        self.model_error = model_error([w.record for w in windows])
        self.correlated = windows[0].warm_up / 2.0
        self.base = base
        payload = windows[0].record.payload
        self.nuisances: tuple[Nuisance, ...] = nuisances(base.robot, payload)
        self.precision = np.array([n.tolerance**-2 for n in self.nuisances])
        self.start = np.array(base.deviations or [0.0] * len(self.nuisances))
        self.model = replace(settled_base(base, payload), discrepancy=GAUGES_ALONE)
        self.predictors = [Predictor(self.model, w, s, judging)
                           for w, s in zip(windows, noise)]

    def residual(self, effects: Sequence[Effect] = (), deviations: Array | None = None,
                 gains: Sequence[Steady] | None = None) -> Array:
        """
        Return one-step prediction errors of all windows, (B, W, length, m).

        Parameters
        ----------
        effects : sequence of Effect
            On top of the base's.
        deviations : Array, optional
            Of the base parameters, in place of the base's own, (p,).
        gains : sequence of Steady, optional
            In place of the predictors' own.

        """
        robot = None
        if deviations is not None:
            robot, _ = settled(self.base.robot, self.nuisances, deviations)
            # The base's own effects stay on; what is added is the difference.
            _, added = settled(robot, self.nuisances, deviations - self.start)
            effects = (*effects, *added)
        parts = [p.innovations(effects, robot, None if gains is None else gains[k])
                 for k, p in enumerate(self.predictors)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)

    def gains(self, effects: Sequence[Effect]) -> list[Steady]:
        """Return the predictors' filters for an arm with further effects."""
        return [p.steady_of(p.arm_with(effects)) for p in self.predictors]

    @cached_property
    def nominal(self) -> Array:
        """Return the residual of the base model, (W, length, m)."""
        return self.residual()[0]

    @cached_property
    def sensitivity(self) -> Array:
        """Return d residual / d nuisance, (W, length, m, p), by differences within tolerance."""
        columns, gains = [], self.gains(self.around)
        origin = self.residual(self.around)[0] if self.around else self.nominal
        for k, item in enumerate(self.nuisances):
            step, moved = STEP * item.tolerance, self.start.copy()
            moved[k] += step
            columns.append((self.residual(self.around, moved, gains)[0] - origin) / step)
        return np.stack(columns, axis=-1)

    def thinned(self, samples: int) -> Problem:
        """Return the problem on evenly chosen windows, so few that about `samples` are scored."""
        scored = [p.windows.starts.size * p.windows.length for p in self.predictors]
        every = -(-sum(scored) // samples)
        if every == 1:
            return self
        kept, first = [], 0
        for p in self.predictors:
            kept.append(np.arange(first, first + p.windows.starts.size, every))
            first += p.windows.starts.size
        windows = np.concatenate(kept)
        other = object.__new__(Problem)
        other.__dict__.update(self.__dict__ | {
            'predictors': [p.thinned(every) for p in self.predictors],
            'nominal': self.nominal[windows], 'sensitivity': self.sensitivity[windows]})
        return other

    def weighting(self, residual: Array, sensitivity: Array | None = None) -> Weighting:
        """
        Return the weighting that a residual (W, length, m) asks for.

        Model error that is allowed for joins the covariance. It is the same again and again
        within half a period of the slowest mode, so there it counts as one sample.
        """
        flat = residual.reshape(-1, residual.shape[-1])
        seen, allowed = flat.T @ flat / len(flat), np.diag(self.model_error)
        whitener = np.linalg.inv(np.linalg.cholesky(seen + allowed))
        directions = self.sensitivity if sensitivity is None else sensitivity
        own = temper(residual @ whitener.T, white_columns(whitener, directions))
        share = float(np.trace(whitener @ allowed @ whitener.T)) / len(allowed)
        return Weighting(whitener, own + share * self.correlated)


def white_columns(whitener: Array, directions: Array) -> Array:
    """Return L^-1 d for directions (…, m, p), in one product."""
    m, p = directions.shape[-2:]
    flat = np.moveaxis(directions.reshape(-1, m, p), 1, 0).reshape(m, -1)
    white = np.moveaxis((whitener @ flat).reshape(m, -1, p), 0, 1)
    return white.reshape(directions.shape)


def temper(white: Array, directions: Array) -> float:
    """
    Return the long-run over the white variance of the scores.

    Parameters
    ----------
    white : Array
        Whitened residual, (W, length, m).
    directions : Array
        Whitened sensitivities, (W, length, m, p).

    """
    windows, length = len(white), white.shape[1] // BLOCKS_PER_WINDOW
    kept, blocks = length * BLOCKS_PER_WINDOW, windows * BLOCKS_PER_WINDOW
    errors = white[:, :kept].reshape(blocks, 1, -1)
    columns = directions[:, :kept].reshape(blocks, errors.shape[-1], -1)
    sums = (errors @ columns)[:, 0]
    long_run = np.sum((sums - sums.mean(axis=0))**2, axis=0)
    short = np.einsum('wtmp,wtmp->p', directions, directions)
    return max(0.3, float(np.median(long_run / np.maximum(short, 1e-300))))
