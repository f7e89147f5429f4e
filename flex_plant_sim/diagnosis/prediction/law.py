"""
The law of a latent force: the one variable that explains it best under cross-validation.

`latent_view` collects the laws of all latent forces; the search and the extended robot use them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from statistics import NormalDist

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.tiny import TINY
import numpy as np
from numpy.typing import NDArray

# Contiguous stretches of a record, as neighbouring samples are correlated, and folds of them.
STRETCHES, FOLDS = 20, 5
# Knots of a table: few, at quantiles of the samples, or many, evenly spaced, for what repeats over
# the variable, such as gear teeth.
FEW_KNOTS, MANY_KNOTS = 8, 32
# Ridge, in samples over the mean number of samples per knot: a knot without samples is zero, and
# one with that number a thousandth too small.
RIDGE_WEIGHT = 1e-3
# Share of a force's power that a law has to explain: more than it leaves.
MIN_EXPLAINED_SHARE = 0.5
# Normal deviate of two-sided 5 % shared by five comparisons (Bonferroni).
CLEAR_Z = NormalDist().inv_cdf(1.0 - 0.5 * 0.05 / 5)
# Name of the law that depends on nothing, of time, and of the variable whose tables may step at
# zero.
CONSTANT, TIME = 'constant', 'time'
STEPPED_VARIABLE = 'speed'


@dataclass(frozen=True)
class LatentSeries:
    """
    A latent force and the variables that it may depend on.

    Attributes
    ----------
    site, unit : str
        joint_1, N m; or a gauge, m/m.
    value, deviation : Array
        Posterior mean and standard deviation, in `unit`, (N,).
    variables : Mapping
        Name to (unit, values (N,)).
    scored : Array
        Whether a sample counts, (N,): the joint moves, the initial transient is over.
    model_error : float
        Root mean square, in `unit`, below which a force may be model error.
    preferred : tuple of str
        Variables that are chosen unless another is better by more than a model error.
    error_samples : float
        Samples for which a model error lasts: a table over time averages over many. A torque's
        may last.

    """

    site: str
    unit: str
    value: Array
    deviation: Array
    variables: Mapping[str, tuple[str, Array]]
    scored: NDArray[np.bool_]
    model_error: float
    preferred: tuple[str, ...] = (CONSTANT,)
    error_samples: float = math.inf

    def model_error_over(self, variable: str, knots: Array) -> float:
        """
        Return the root mean square, in `unit`, that a table (K,) may have of model error.

        Over time it has of an error of the correlation time t what K means over T / K leave of it,
        the share 2 t K / T of its power.
        """
        if variable != TIME:
            return self.model_error
        left = 2.0 * self.error_samples * knots.size / np.count_nonzero(self.scored)
        return self.model_error * math.sqrt(min(left, 1.0))

    @property
    def rms(self) -> float:
        """Return the root mean square over the scored samples."""
        return float(np.sqrt(np.mean(self.value[self.scored]**2)))


@dataclass(frozen=True)
class Law:
    """
    A latent force as a table over one variable, linear between its knots.

    Attributes
    ----------
    site, variable, variable_unit : str
    knots, values, deviations : Array
        Knots, forces there and their standard deviations, (K,); a repeated knot is a step.
    share, share_error : float
        Share of the force's power that is explained on stretches left out; its standard error.
    rms : float
        Root mean square of the force.
    exceeds_model_error : bool
        Whether the force is too large for a model error.
    clear : bool
        Whether the law explains more than half and more than any other variable, beyond chance.

    """

    site: str
    variable: str
    variable_unit: str
    knots: Array
    values: Array
    deviations: Array
    share: float
    share_error: float
    rms: float
    exceeds_model_error: bool
    clear: bool

    @property
    def stated(self) -> bool:
        """Tell whether the law is worth stating."""
        return self.exceeds_model_error and self.clear

    @property
    def holds(self) -> bool:
        """Tell whether it explains something on stretches left out, beyond chance."""
        return self.exceeds_model_error and self.share > CLEAR_Z * self.share_error

    @property
    def occam_penalty(self) -> float:
        """
        Return the Occam factor of its table, nats: ln(1 + w^2 / s^2) / 2 for each knot.

        By Laplace's method, for a knot that is known to s with a prior as wide as the force, w.
        """
        return float(np.sum(np.log1p((self.rms / self.deviations)**2))) / 2.0

    def at(self, x: Array) -> Array:
        """Return the force at values of the variable, (N,)."""
        return np.asarray(hat_functions(x, self.knots) @ self.values)


def hat_functions(x: Array, knots: Array) -> Array:
    """
    Return the linear basis functions of knots at x, constant beyond the ends, (N, K).

    At a repeated knot the table steps: the functions to its left and right are independent.
    """
    basis = np.zeros((len(x), len(knots)))
    repeated = np.flatnonzero(np.diff(knots) == 0.0)
    edges = [0, *(repeated + 1), len(knots)]
    for first, stop in zip(edges, edges[1:]):
        inside = (x >= knots[first]) | (first == 0)
        inside &= (x < knots[stop - 1]) | (stop == len(knots))
        for k in range(first, stop):
            basis[inside, k] = np.interp(x[inside], knots[first:stop],
                                         np.eye(stop - first)[k - first])
    return basis


def knots_for(variable: str, x: Array, count: int) -> Array:
    """Return knots over samples x: one for a constant, with a step at zero for a speed."""
    if variable == CONSTANT:
        return np.zeros(1)
    halves = [_placed_knots(part, count // 2)[1:]
              for part in (-x[x < 0.0], x[x > 0.0]) if len(part)]
    if variable != STEPPED_VARIABLE or len(halves) < 2:
        return _placed_knots(x, count)
    return np.concatenate([-halves[0][::-1], [0.0, 0.0], halves[1]])


def _placed_knots(x: Array, count: int) -> Array:
    """Return few knots at quantiles of the samples, many knots evenly spaced."""
    if count > FEW_KNOTS:
        return np.linspace(x.min(), x.max(), count)
    return np.unique(np.quantile(x, np.linspace(0.0, 1.0, count)))


def _ridge_fit(design: Array, value: Array) -> tuple[Array, Array]:
    """Return ridge-regression values at knots, (K,), and the inverse normal matrix, (K, K)."""
    ridge = RIDGE_WEIGHT * len(design) / design.shape[1]
    inverse = np.linalg.inv(design.T @ design + ridge * np.eye(design.shape[1]))
    return inverse @ (design.T @ value), inverse


def stretches_of(count: int) -> NDArray[np.int_]:
    """Return the number of the contiguous stretch that each sample belongs to, (N,)."""
    return np.arange(count) * STRETCHES // count


@dataclass(frozen=True)
class CrossValidation:
    """The power of a force and what one variable leaves of it, on stretches left out, (S,)."""

    variable: str
    knots: Array
    residual_power: Array
    power: Array

    @property
    def share(self) -> float:
        """Return the share of the power explained; 0 where there is no force."""
        explained = self.power.sum() - self.residual_power.sum()
        return float(explained / max(self.power.sum(), TINY))

    @property
    def error(self) -> float:
        """Return the standard error of that share, from the stretches."""
        return _ratio_error(self.residual_power, self.power)

    def beats(self, other: CrossValidation, least: float = 0.0) -> bool:
        """
        Tell whether it explains more than another: beyond chance, and by a power `least`.

        The logarithms of the residual power are compared stretch by stretch, as held-out
        likelihoods are. Where the other leaves more than there was, it counts as no law.
        """
        theirs = np.minimum(other.residual_power, other.power)
        gained = np.log(np.maximum(theirs, TINY)) - np.log(np.maximum(self.residual_power, TINY))
        chance = CLEAR_Z * float(np.std(gained, ddof=1)) / np.sqrt(len(gained))
        return (float(gained.mean()) > chance
                and float(np.sum(theirs - self.residual_power)) > least)


def _ratio_error(part: Array, whole: Array) -> float:
    """Return the standard error of sum(part) / sum(whole) over independent stretches."""
    total = max(whole.sum(), TINY)
    rest = part - whole * part.sum() / total
    return float(np.sqrt(len(part) / (len(part) - 1.0) * np.sum(rest**2)) / total)


def cross_validate(series: LatentSeries) -> list[CrossValidation]:
    """Return the validation of every variable and of a constant, the best first."""
    value = series.value[series.scored]
    stretch = stretches_of(len(series.value))[series.scored]
    variables = {CONSTANT: ('', np.zeros(len(series.value))), **series.variables}
    validations = [_simplest_sufficient([
        _validate(name, x[series.scored], value, stretch, count)
        for count in (FEW_KNOTS, MANY_KNOTS)]) for name, (_, x) in variables.items()]
    return sorted(validations, key=lambda validation: -validation.share)


def _simplest_sufficient(validations: Sequence[CrossValidation]) -> CrossValidation:
    """Return the first validation that no later one beats."""
    best = validations[0]
    for validation in validations[1:]:
        best = validation if validation.beats(best) else best
    return best


def _validate(variable: str, x: Array, value: Array, stretch: NDArray[np.int_],
              count: int) -> CrossValidation:
    """Return the validation of a table with a number of knots."""
    knots = knots_for(variable, x, count)
    design, numbers = hat_functions(x, knots), np.unique(stretch)
    residual_power = np.zeros(len(numbers))
    for fold in range(FOLDS):
        # Folds are made of the stretches that have samples: a joint may rest in all others.
        out = np.isin(stretch, numbers[fold::FOLDS])
        values, _ = _ridge_fit(design[~out], value[~out])
        squared = (value - design @ values)**2
        for row in range(fold, len(numbers), FOLDS):
            residual_power[row] = squared[stretch == numbers[row]].sum()
    power = np.array([np.sum(value[stretch == number]**2) for number in numbers])
    return CrossValidation(variable, knots, residual_power, power)


def law_of(series: LatentSeries, validations: Sequence[CrossValidation] | None = None) -> Law:
    """
    Return the law over the variable that explains a latent force best.

    A preferred variable is chosen unless another explains more by at least the power of a model
    error; any other variable must beat all others by as much for the law to be clear.
    """
    validations = validations or cross_validate(series)
    best, count = validations[0], np.count_nonzero(series.scored)
    least = series.model_error_over(best.variable, best.knots)**2 * count
    by_name, unrivalled = {found.variable: found for found in validations}, True
    for name in series.preferred:
        if not best.beats(by_name[name], least):
            best = by_name[name]
            break
    else:
        unrivalled = all(best.beats(rival, least) for rival in validations if rival is not best)
    sure = best.share - CLEAR_Z * best.error > MIN_EXPLAINED_SHARE
    return _law_over(series, best, sure and unrivalled)


def _law_over(series: LatentSeries, best: CrossValidation, clear: bool) -> Law:
    unit, x = series.variables.get(best.variable, ('', np.zeros(len(series.value))))
    design, value = hat_functions(x[series.scored], best.knots), series.value[series.scored]
    values, inverse = _ridge_fit(design, value)
    return Law(series.site, best.variable, unit, best.knots, values,
               _clustered_deviations(design, value - design @ values, inverse,
                                     stretches_of(len(series.value))[series.scored]),
               best.share, best.error, series.rms,
               series.rms > series.model_error_over(best.variable, best.knots), clear)


def _clustered_deviations(design: Array, residual: Array, inverse: Array,
                          stretch: NDArray[np.int_]) -> Array:
    """Return standard deviations of the values with independent stretches as clusters, (K,)."""
    scores = np.stack([design[stretch == k].T @ residual[stretch == k]
                       for k in np.unique(stretch)])
    return np.sqrt(np.maximum(np.diagonal(inverse @ scores.T @ scores @ inverse), 0.0))
