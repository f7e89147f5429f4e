"""The law of a latent force: which one variable explains it on stretches left out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
import numpy as np
from numpy.typing import NDArray

# Neighbours are alike: whole stretches are left out, a fifth of them at a time.
STRETCHES, FOLDS = 20, 5
# Few knots where samples are, and many evenly spaced ones for what repeats, such as gear teeth.
FEW_KNOTS, MANY_KNOTS = 8, 32
# A knot with a thousandth of its share of the samples counts half: where none were, it is zero.
RIDGE_WEIGHT = 1e-3
# A law explains more than half.
MIN_EXPLAINED_SHARE = 0.5
# Two-sided 5 % shared by five comparisons (Bonferroni).
CLEAR_Z = 2.576
# Keeps logarithms finite where a stretch is explained wholly.
TINY = 1e-300
CONSTANT = 'constant'
STEPPED_VARIABLE = 'speed'


@dataclass(frozen=True)
class LatentSeries:
    """
    A latent force and what it may depend on, where it is to be judged.

    Attributes
    ----------
    site, unit : str
        joint_1, N m; or a gauge, m/m.
    value, deviation : Array
        (N,), posterior mean and standard deviation.
    variables : Mapping
        Name to (unit, values (N,)).
    judged : Array
        Whether a sample counts, (N,): a joint moves, the start is over.
    model_error : float
        Root mean square below which it may be model error.
    simple : tuple of str
        Variables that are taken where no other is better by more than a model error.

    """

    site: str
    unit: str
    value: Array
    deviation: Array
    variables: Mapping[str, tuple[str, Array]]
    scored: NDArray[np.bool_]
    model_error: float
    preferred: tuple[str, ...] = (CONSTANT,)

    @property
    def rms(self) -> float:
        """Return the root mean square where judged."""
        return float(np.sqrt(np.mean(self.value[self.scored]**2)))


@dataclass(frozen=True)
class Law:
    """
    A latent force as a table over one variable, linear between its knots.

    Attributes
    ----------
    site, unit, variable, variable_unit : str
    knots, values, deviations : Array
        (K,); a knot that stands twice is a step. Deviations are standard ones.
    share, share_error : float
        Of the force's power, explained on stretches left out, and its standard error.
    rms : float
        Root mean square of the force.
    exceeds_model_error, clear : bool
        Too large for a model error; and beyond chance better than zero and every other variable.

    """

    site: str
    unit: str
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
        """Tell whether it counts."""
        return self.exceeds_model_error and self.clear

    @property
    def holds(self) -> bool:
        """Tell whether it is better than nothing, beyond chance, where it was not fitted."""
        return self.exceeds_model_error and self.share > CLEAR_Z * self.share_error

    @property
    def occam_penalty(self) -> float:
        """
        Return what a record must show for its table, nats.

        By Laplace's method, ln(w / s) a knot: known to s, and before as large as the force, w.
        """
        return float(np.sum(np.log1p((self.rms / self.deviations)**2))) / 2.0

    def at(self, x: Array) -> Array:
        """Return the force at values of the variable, (N,)."""
        return np.asarray(hat_functions(x, self.knots) @ self.values)


def hat_functions(x: Array, knots: Array) -> Array:
    """
    Return the hat functions of knots at x, constant beyond the ends, (N, K).

    A knot that stands twice parts the line: what is left of it does not know what is right.
    """
    columns = np.zeros((len(x), len(knots)))
    twice = np.flatnonzero(np.diff(knots) == 0.0)
    edges = [0, *(twice + 1), len(knots)]
    for first, stop in zip(edges, edges[1:]):
        inside = (x >= knots[first]) | (first == 0)
        inside &= (x < knots[stop - 1]) | (stop == len(knots))
        for k in range(first, stop):
            columns[inside, k] = np.interp(x[inside], knots[first:stop],
                                           np.eye(stop - first)[k - first])
    return columns


def knots_for(variable: str, x: Array, count: int) -> Array:
    """Return knots over the samples: one for a constant, with a step at zero for a speed."""
    if variable == CONSTANT:
        return np.zeros(1)
    halves = [_placed_knots(part, count // 2)[1:] for part in (-x[x < 0.0], x[x > 0.0]) if len(part)]
    if variable != STEPPED_VARIABLE or len(halves) < 2:
        return _placed_knots(x, count)
    return np.concatenate([-halves[0][::-1], [0.0, 0.0], halves[1]])


def _placed_knots(x: Array, count: int) -> Array:
    """Return knots at quantiles of the samples if few, evenly spaced if many."""
    if count > FEW_KNOTS:
        return np.linspace(x.min(), x.max(), count)
    return np.unique(np.quantile(x, np.linspace(0.0, 1.0, count)))


def _ridge_fit(design: Array, value: Array) -> tuple[Array, Array]:
    """Return the values at the knots (K,), and the inverse of their normal matrix (K, K)."""
    ridge = RIDGE_WEIGHT * len(design) / design.shape[1]
    inverse = np.linalg.inv(design.T @ design + ridge * np.eye(design.shape[1]))
    return inverse @ (design.T @ value), inverse


def stretches_of(count: int) -> NDArray[np.int_]:
    """Return the number of the contiguous stretch of each of the samples, (N,)."""
    return np.arange(count) * STRETCHES // count


@dataclass(frozen=True)
class CrossValidation:
    """One variable tried: what it leaves on each stretch when that is left out, (S,)."""

    variable: str
    knots: Array
    residual_power: Array
    power: Array

    @property
    def share(self) -> float:
        """Return the share of the power explained."""
        return 1.0 - float(self.residual_power.sum() / self.power.sum())

    @property
    def error(self) -> float:
        """Return its standard error, from the stretches."""
        return _ratio_error(self.residual_power, self.power)

    def beats(self, other: CrossValidation, least: float = 0.0) -> bool:
        """
        Tell whether it explains more: beyond chance, and by a share of at least `least`.

        By the logarithm of what each leaves, stretch by stretch, as held-out likelihoods are
        compared; where the other is worse than zero, it counts as zero.
        """
        theirs = np.minimum(other.residual_power, other.power)
        gained = np.log(np.maximum(theirs, TINY)) - np.log(np.maximum(self.residual_power, TINY))
        chance = CLEAR_Z * float(np.std(gained, ddof=1)) / np.sqrt(len(gained))
        share = float(np.sum(theirs - self.residual_power) / self.power.sum())
        return float(gained.mean()) > chance and share > least


def _ratio_error(part: Array, whole: Array) -> float:
    """Return the standard error of sum(part) / sum(whole) over independent stretches."""
    rest = part - whole * part.sum() / whole.sum()
    return float(np.sqrt(len(part) / (len(part) - 1.0) * np.sum(rest**2)) / whole.sum())


def cross_validate(series: LatentSeries) -> list[CrossValidation]:
    """Return all variables tried, the best first; the constant is one of them."""
    value = series.value[series.scored]
    stretch = stretches_of(len(series.value))[series.scored]
    variables = {CONSTANT: ('', np.zeros(len(series.value))), **series.variables}
    validations = [_simplest_sufficient([_validate(name, x[series.scored], value, stretch, count)
                         for count in (FEW_KNOTS, MANY_KNOTS)]) for name, (_, x) in variables.items()]
    return sorted(validations, key=lambda trial: -trial.share)


def _simplest_sufficient(validations: Sequence[CrossValidation]) -> CrossValidation:
    """Return the first that no later one beats."""
    best = validations[0]
    for trial in validations[1:]:
        best = trial if trial.beats(best) else best
    return best


def _validate(variable: str, x: Array, value: Array, stretch: NDArray[np.int_],
           count: int) -> CrossValidation:
    knots = knots_for(variable, x, count)
    design, numbers = hat_functions(x, knots), np.unique(stretch)
    residual_power = np.zeros(len(numbers))
    for fold in range(FOLDS):
        # Of those that are there: a joint may move in every fifth alone.
        out = np.isin(stretch, numbers[fold::FOLDS])
        fit_set, _ = _ridge_fit(design[~out], value[~out])
        squared = (value - design @ fit_set)**2
        for row in range(fold, len(numbers), FOLDS):
            residual_power[row] = squared[stretch == numbers[row]].sum()
    power = np.array([np.sum(value[stretch == number]**2) for number in numbers])
    return CrossValidation(variable, knots, residual_power, power)


def law_of(series: LatentSeries, validations: Sequence[CrossValidation] | None = None) -> Law:
    """
    Return the law over the variable that explains a latent force best.

    A constant, and a gauge's own strain, are taken unless another explains more than a model
    error's worth better; any other variable must beat all its rivals by as much. A law is clear
    where it explains more than half beyond chance.
    """
    validations = validations or cross_validate(series)
    best, least = validations[0], (series.model_error / series.rms)**2
    by_name, alone = {trial.variable: trial for trial in validations}, True
    for name in series.preferred:
        if not best.beats(by_name[name], least):
            best = by_name[name]
            break
    else:
        alone = all(best.beats(rival, least) for rival in validations if rival is not best)
    sure = best.share - CLEAR_Z * best.error > MIN_EXPLAINED_SHARE
    return _law_over(series, best, sure and alone)


def _law_over(series: LatentSeries, best: CrossValidation, clear: bool) -> Law:
    unit, x = series.variables.get(best.variable, ('', np.zeros(len(series.value))))
    design, value = hat_functions(x[series.scored], best.knots), series.value[series.scored]
    values, inverse = _ridge_fit(design, value)
    return Law(series.site, series.unit, best.variable, unit, best.knots, values,
               _clustered_deviations(design, value - design @ values, inverse,
                           stretches_of(len(series.value))[series.scored]),
               best.share, best.error, series.rms, series.rms > series.model_error, clear)


def _clustered_deviations(design: Array, rest: Array, inverse: Array,
                stretch: NDArray[np.int_]) -> Array:
    """Return standard deviations of the values, stretches being independent, (K,)."""
    scores = np.stack([design[stretch == k].T @ rest[stretch == k] for k in np.unique(stretch)])
    return np.sqrt(np.maximum(np.diagonal(inverse @ scores.T @ scores @ inverse), 0.0))
