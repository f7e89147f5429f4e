"""
Finds wrong numbers in a record, single ones and steps, that the rest of it contradicts.

The log reader adds a note for each; the numbers themselves are not changed.
"""

from __future__ import annotations

from typing import NamedTuple

from flex_plant_sim.arm.second_order import Array
import numpy as np
from numpy.typing import NDArray

# Order of the autoregression, samples: two samples of six channels determine the state of two
# modes per link.
ORDER = 2
# Least number of rows per fitted coefficient.
ROWS_PER_COEFFICIENT = 4
# Rounds of reweighting in the robust fit; with 3 to 16 the tests find the same errors.
ROUNDS = 8
# Above this misfit, in standard deviations, or this multiple of the mean leverage, a row gets
# less weight in the fit.
ROBUST, LEVERAGE = 3.0, 4.0
# Floor of a standard deviation, as a share of the channel's range, for rounding to few digits.
DIGITS = 1e-9
# An error is reported from this score on, in standard deviations, and if it exceeds this share of
# the channel's range; a smaller one misleads nobody.
MIN_SCORE, MIN_SIZE = 10.0, 0.02
# Columns that may be off from a row on, as encoders slip and lose counts. Strain does step, when
# the arm is hit.
ANGLES = (2, 3)
# Leverage above which a row tells more of its own prediction than all others together. What
# happens there, as after a command that is a single pulse, is an error or the arm's answer.
UNPREDICTED = 0.5
# Share of the squared residuals around an error that the error must explain, and of an error that
# its own column must show: what is left may be the arm's.
EXPLAINED, SHOWN = 0.9, 0.5


class SingleError(NamedTuple):
    """
    A wrong number: its row, its column in (commands, outputs), and the size of the error.

    Where it is `lasting`, all later numbers of the column are off as well: a sensor slipped.
    """

    row: int
    column: int
    error: float
    lasting: bool = False


def single_errors(command: Array, output: Array) -> list[SingleError]:
    """
    Return the single wrong numbers, most certain first; none if there are too few rows.

    Outputs are predicted from the ORDER samples before by least squares, in which rows that fit
    badly or have high leverage weigh less. An error d of an output leaves d in its own residual
    and, multiplied by the coefficients, in the residuals after it; an error of a command only in
    those after it. If this pattern explains nearly all of the residuals there, that number is
    wrong (generalised likelihood ratio: Willsky, Automatica 12, 1976). A lasting error of an
    angle leaves the running sum of the pattern. Rows like no other are not judged. A command must
    also lie outside the range of its neighbours, since a step of the command leaves the same
    pattern.

    Parameters
    ----------
    command, output : Array
        Evenly sampled, (N, 2) and (N, m), angles first; the command of a row acts from that row
        on.

    """
    values = np.hstack([command, output])
    span = np.ptp(values, axis=0) if len(values) else np.zeros(values.shape[1])
    columns = np.flatnonzero(span > 0.0)
    of_output = columns >= command.shape[1]
    size = ORDER * len(columns) + 1
    if len(values) - ORDER < ROWS_PER_COEFFICIENT * size or not of_output.any():
        return []
    scaled = (values[:, columns] - values[0, columns]) / span[columns]
    before = _regressors(scaled)
    fit = _fit(before, scaled[ORDER:, of_output])
    predicted = _predicted(before)
    found: list[tuple[float, SingleError]] = []
    for place, column in enumerate(columns):
        own = np.eye(len(columns))[place][of_output]
        pattern = np.vstack([own, -fit.coefficients[place:-1:len(columns)]])
        for lasting in (False, True) if column in ANGLES else (False,):
            score, error = _scores(fit, np.cumsum(pattern, axis=0) if lasting else pattern)
            bad = np.abs(score) > MIN_SCORE
            bad &= (np.abs(error) > MIN_SIZE) & (score**2 > EXPLAINED * fit.power)
            bad &= predicted & _shows(scaled[:, place], error, lasting) if of_output[place] \
                else _outside_neighbours(scaled[:, place])[ORDER:]
            found += [(-abs(float(score[k])), SingleError(
                int(k) + ORDER, int(column), float(error[k] * span[column]), lasting))
                for k in np.flatnonzero(bad)]
    return _without_overlaps([error for _, error in sorted(found)])


def _predicted(before: Array) -> NDArray[np.bool_]:
    """Return where neither a row nor one that it is predicted from is like no other, (N,)."""
    alone = _leverage(before, _inverse(before.T @ before)) >= UNPREDICTED
    return np.asarray(np.convolve(alone, np.ones(ORDER + 1))[:len(alone)] == 0.0)


def _regressors(scaled: Array) -> Array:
    """Return the ORDER rows before each row side by side, and a one, (N - ORDER, K)."""
    rows = len(scaled) - ORDER
    return np.hstack([*(scaled[ORDER - lag:][:rows] for lag in range(1, ORDER + 1)),
                      np.ones((rows, 1))])


class _Fit(NamedTuple):
    """
    A robust autoregression.

    `coefficients` is (K, m); `white` holds the whitened residuals, padded by ORDER rows of zeros;
    `power` the sum of their squares over ORDER + 1 rows; `whiten` the whitening matrix.
    """

    coefficients: Array
    white: Array
    power: Array
    whiten: Array


def _scores(fit: _Fit, pattern: Array) -> tuple[Array, Array]:
    """Return for each row the score, in standard deviations, and the size of an error, (N,)."""
    white = [fit.whiten @ row for row in pattern]
    rows = len(fit.power)
    # Near the end of the record only the first rows of the pattern fit in.
    there = np.cumsum([row @ row for row in white])
    norm = np.sqrt(there[np.minimum(np.arange(rows)[::-1], len(white) - 1)])
    score = np.sum([fit.white[k:k + rows] @ row for k, row in enumerate(white)], axis=0)
    return _ratio(score, norm), _ratio(score, norm**2)


def _ratio(part: Array, whole: Array) -> Array:
    return np.divide(part, whole, out=np.zeros(len(part)), where=whole > 0.0)


def _fit(before: Array, after: Array) -> _Fit:
    """Return a fit in which rows that fit badly or have high leverage weigh less."""
    weight, size = np.ones(len(before)), before.shape[1]
    for _ in range(ROUNDS):
        weighted = before * weight[:, None]
        inverse = _inverse(weighted.T @ before)
        coefficients = inverse @ (weighted.T @ after)
        residual = after - before @ coefficients
        leverage = _leverage(before, inverse)
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


def _inverse(products: Array) -> Array:
    return np.asarray(np.linalg.pinv(products, rcond=1e-13, hermitian=True))


def _leverage(before: Array, inverse: Array) -> Array:
    return np.asarray(np.sum((before @ inverse) * before, axis=1))


def _shows(values: Array, error: Array, lasting: bool) -> NDArray[np.bool_]:
    """
    Return where a column (N,) is off its own course by an error (N - ORDER,) rather than bent.

    A command that steps leaves the same residuals where the fit is of smoother motion.
    """
    change = np.diff(values, prepend=values[:1])
    before, after = np.roll(change, 1), np.append(change[1:], 0.0)
    # A step is beside the rates around it; a single error makes those to and from it opposite.
    off = change - 0.5 * (before + after) if lasting else 0.5 * (change - after)
    off[-1] = change[-1] - before[-1]
    off = off[ORDER:]
    return np.asarray(off * np.sign(error) > SHOWN * np.abs(error))


def _outside_neighbours(values: Array) -> NDArray[np.bool_]:
    """Return where a value lies outside the range of its two neighbours by MIN_SIZE, (N,)."""
    padded = np.pad(values, 1, mode='edge')
    low = np.minimum(padded[:-2], padded[2:]) - MIN_SIZE
    high = np.maximum(padded[:-2], padded[2:]) + MIN_SIZE
    return (values < low) | (values > high)


def _without_overlaps(errors: list[SingleError]) -> list[SingleError]:
    """Return, of errors whose patterns overlap, only the most certain one."""
    kept: list[SingleError] = []
    for error in errors:
        if all(abs(error.row - other.row) > ORDER for other in kept):
            kept.append(error)
    return kept
