"""Single numbers of a record that the rest of it contradicts: a sample, or a command."""

from __future__ import annotations

from typing import NamedTuple

from flex_plant_sim.arm.second_order import Array
import numpy as np
from numpy.typing import NDArray

# Samples before that predict the next: two of six channels tell the state of two modes a link.
ORDER = 2
# Rows for each number that is fitted, at least.
ROWS = 4
# Of reweighting; with 3 to 16 the tests find the same errors.
ROUNDS = 8
# Standard deviations beyond which a row counts less, and mean leverages.
ROBUST, LEVERAGE = 3.0, 4.0
# Of the channel's range: what digits leave, and what is no more than that.
DIGITS = 1e-9
# Standard deviations; a smaller error than VISIBLE of the range misleads nobody.
STANDS_OUT, VISIBLE = 10.0, 0.02
# Of the square of the residuals around it that the error goes with.
EXPLAINED = 0.9


class SingleError(NamedTuple):
    """A number that stands out: row and column of (commands, outputs), and by how much."""

    row: int
    column: int
    error: float


def single_errors(command: Array, output: Array) -> list[SingleError]:
    """
    Return the numbers that are wrong alone, the surest first; none where there are few rows.

    Outputs are predicted from the ORDER samples before (least squares, with less weight for what
    fits badly or has leverage). An error d of one output leaves d in its own residual and, with
    the coefficients, in those after it; of a command, in those after it only. Where that pattern
    is nearly all there is, it was that number (generalised likelihood ratio: Willsky, Automatica
    12, 1976). A command must also stand out from its neighbours: a step is one.

    Parameters
    ----------
    command, output : Array
        Evenly sampled, (N, 2) and (N, m); a row's command acts from it on.

    """
    values = np.hstack([command, output])
    span = np.ptp(values, axis=0) if len(values) else np.zeros(values.shape[1])
    columns = np.flatnonzero(span > 0.0)
    of_output = columns >= command.shape[1]
    size = ORDER * len(columns) + 1
    if len(values) - ORDER < ROWS * size or not of_output.any():
        return []
    scaled = (values[:, columns] - values[0, columns]) / span[columns]
    rows = len(scaled) - ORDER
    before = np.hstack([*(scaled[ORDER - lag:][:rows] for lag in range(1, ORDER + 1)),
                        np.ones((rows, 1))])
    fit = _fit(before, scaled[ORDER:, of_output])
    found: list[tuple[float, SingleError]] = []
    for place, column in enumerate(columns):
        own = np.eye(len(columns))[place][of_output]
        score, error = _scores(fit, [own, *(-fit.coefficients[place:-1:len(columns)])])
        bad = np.abs(score) > STANDS_OUT
        bad &= (np.abs(error) > VISIBLE) & (score**2 > EXPLAINED * fit.power)
        if not of_output[place]:
            bad &= _apart(scaled[:, place])[ORDER:]
        found += [(-abs(float(score[k])), SingleError(
            int(k) + ORDER, int(column), float(error[k] * span[column])))
            for k in np.flatnonzero(bad)]
    return _alone([error for _, error in sorted(found)])


class _Fit(NamedTuple):
    """Coefficients (K, m), whitened residuals and their squares over ORDER + 1 rows, whitener."""

    coefficients: Array
    white: Array
    power: Array
    whiten: Array


def _scores(fit: _Fit, pattern: list[Array]) -> tuple[Array, Array]:
    """Return for each row how surely an error with a pattern is there, and its size, (N,)."""
    white = [fit.whiten @ row for row in pattern]
    rows = len(fit.power)
    # Near the end only the first rows of the pattern are there.
    there = np.cumsum([row @ row for row in white])
    norm = np.sqrt(there[np.minimum(np.arange(rows)[::-1], len(white) - 1)])
    score = np.sum([fit.white[k:k + rows] @ row for k, row in enumerate(white)], axis=0)
    return _ratio(score, norm), _ratio(score, norm**2)


def _ratio(part: Array, whole: Array) -> Array:
    return np.divide(part, whole, out=np.zeros(len(part)), where=whole > 0.0)


def _fit(before: Array, after: Array) -> _Fit:
    """Return a robust fit: what fits badly, or has leverage, weighs less."""
    weight, size = np.ones(len(before)), before.shape[1]
    for _ in range(ROUNDS):
        weighted = before * weight[:, None]
        inverse = np.linalg.pinv(weighted.T @ before, rcond=1e-13, hermitian=True)
        coefficients = inverse @ (weighted.T @ after)
        residual = after - before @ coefficients
        leverage = np.sum((before @ inverse) * before, axis=1)
        usual = np.median(np.abs(residual), axis=0) / 0.6745 + DIGITS
        misfit = np.sqrt(np.mean((residual / usual)**2, axis=1))
        weight = 1.0 / np.maximum(1.0, misfit / ROBUST)**2 / np.maximum(
            1.0, leverage * len(before) / (LEVERAGE * size))**2
    covariance = (residual * weight[:, None]).T @ residual / weight.sum()
    covariance += DIGITS**2 * np.eye(len(covariance))
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    white = np.vstack([residual @ whiten.T, np.zeros((ORDER, len(whiten)))])
    power = np.convolve(np.sum(white**2, axis=1), np.ones(ORDER + 1))[ORDER:][:len(residual)]
    return _Fit(coefficients, white, power, whiten)


def _apart(values: Array) -> NDArray[np.bool_]:
    """Return where a value is outside what its two neighbours span, (N,)."""
    padded = np.pad(values, 1, mode='edge')
    low = np.minimum(padded[:-2], padded[2:]) - VISIBLE
    high = np.maximum(padded[:-2], padded[2:]) + VISIBLE
    return (values < low) | (values > high)


def _alone(errors: list[SingleError]) -> list[SingleError]:
    """Return the surest of those whose patterns overlap."""
    kept: list[SingleError] = []
    for error in errors:
        if all(abs(error.row - other.row) > ORDER for other in kept):
            kept.append(error)
    return kept
