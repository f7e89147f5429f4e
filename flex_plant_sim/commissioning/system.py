"""The residuals of logs linearised in the calibrated parts: a Gauss-Newton step and covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.commissioning.items import Item, with_deviations
from flex_plant_sim.commissioning.residuals import Residuals
import numpy as np

# Step of the finite differences, in tolerances: large against rounding, and small against the size
# at which the residuals become nonlinear.
STEP = 0.1
# Number of blocks per window. Each is longer than half a period of the slowest mode, so that their
# sums are nearly independent; of more, a variance would be known better, but they would not be.
BLOCKS = 8
# Factor of the temper for errors of a model with few modes. They repeat themselves throughout a
# log, so the blocks of one log do not show them. With this value the errors on arms of another
# simulator are about as large as stated (benchmarks/calibration.py).
MODEL_TEMPER = 20.0


@dataclass(frozen=True)
class System:
    """
    The residuals linearised in the deviations, in units of the tolerances.

    Attributes
    ----------
    whitener : Array
        L^-1 with L L' the covariance of the residuals, (m, m).
    precision : Array
        Precision of the posterior, (p, p); the part of the residuals is divided by their temper.
    downhill : Array
        Minus the gradient of the negative log posterior, (p,).
    covariance : Array
        Covariance of the posterior, (p, p).
    temper : float
        Number of residuals that count as one independent sample.

    """

    whitener: Array
    precision: Array
    downhill: Array
    covariance: Array
    temper: float

    @classmethod
    def of(cls, residuals: Residuals, robot: Robot, items: Sequence[Item],
           values: Array) -> System:
        """Return the system at values (p,), by forward differences."""
        errors = residuals.of(with_deviations(robot, items, values))
        columns = []
        for k in range(len(items)):
            moved = values.copy()
            moved[k] += STEP
            columns.append((residuals.of(with_deviations(robot, items, moved)) - errors) / STEP)
        flat = errors.reshape(-1, errors.shape[-1])
        whitener = np.linalg.inv(np.linalg.cholesky(flat.T @ flat / len(flat)))
        white = errors @ whitener.T
        slopes = np.stack([column @ whitener.T for column in columns], axis=-1)
        return cls._of_white(whitener, white, slopes, values)

    @classmethod
    def _of_white(cls, whitener: Array, white: Array, slopes: Array, values: Array) -> System:
        rows = slopes.reshape(-1, slopes.shape[-1])
        temper = temper_of(white, slopes)
        precision = rows.T @ rows / temper + np.eye(len(values))
        downhill = -rows.T @ white.ravel() / temper - values
        covariance = np.asarray(np.linalg.inv(precision), dtype=float)
        return cls(whitener, precision, downhill, covariance, temper)

    @property
    def step(self) -> Array:
        """Return the Gauss-Newton step, (p,)."""
        return np.asarray(np.linalg.solve(self.precision, self.downhill), dtype=float)

    def height(self, errors: Array, values: Array) -> float:
        """Return the negative log posterior of residuals and values, up to a constant."""
        white = errors @ self.whitener.T
        return 0.5 * float(np.sum(white**2) / self.temper + values @ values)


def temper_of(white: Array, slopes: Array) -> float:
    """
    Return the temper: the ratio of the long-run to the white variance of the scores.

    It is the median over the parts, times MODEL_TEMPER. Coloured residuals are not independent, so
    those of a block are summed before the variance is taken.
    """
    windows, length = len(white), white.shape[1] // BLOCKS
    blocks = windows * BLOCKS
    errors = white[:, :length * BLOCKS].reshape(blocks, 1, -1)
    columns = slopes[:, :length * BLOCKS].reshape(blocks, errors.shape[-1], -1)
    sums = (errors @ columns)[:, 0]
    long_run = np.sum((sums - sums.mean(axis=0))**2, axis=0)
    return MODEL_TEMPER * max(1.0, float(np.median(long_run / np.sum(slopes**2, axis=(0, 1, 2)))))
