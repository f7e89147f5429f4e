"""The values of a cause as the answer states them: intervals, or what one of few values may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.causes.model_averaging import (
    averaged_size_deviations,
    value_indices,
    value_probabilities,
)
from flex_plant_sim.diagnosis.causes.posterior import Posterior
from flex_plant_sim.diagnosis.verdict.results import ParameterValue
from flex_plant_sim.effects.parameter import Parameter
from flex_plant_sim.interval import credible_values, Z95
import numpy as np


def averaged_values(posterior: Posterior, hypothesis: Hypothesis) -> tuple[ParameterValue, ...]:
    """Return the values of a cause of the best set, as sure as all sets with it are of them."""
    # Bounds of the effect, not those of the kind of it that the best set has.
    parameters = hypothesis.effect.at(hypothesis.site, posterior.nominal.robot)
    best = posterior.best
    values = _intervals(parameters, best.values[value_indices(best, hypothesis)],
                        averaged_size_deviations(posterior, hypothesis))
    return tuple(
        _choice(parameter, value.value, value_probabilities(posterior, hypothesis, k))
        if parameter.discrete else value
        for k, (parameter, value) in enumerate(zip(parameters, values)))


def values_in_set(fit: Fit, hypothesis: Hypothesis) -> tuple[ParameterValue, ...]:
    """Return a cause's values in one set, with 95 % intervals within the bounds."""
    indices = value_indices(fit, hypothesis)
    values = _intervals(hypothesis.parameters, fit.values[indices],
                        np.sqrt(np.diagonal(fit.covariance)[indices]))
    return tuple(_choice(parameter, value.value, {value.value: 1.0})
                 if parameter.discrete else value
                 for parameter, value in zip(hypothesis.parameters, values))


def _intervals(parameters: Sequence[Parameter], values: Array, deviations: Array
               ) -> list[ParameterValue]:
    return [ParameterValue(p.name, float(v), float(max(v - h, p.low)), float(min(v + h, p.high)),
                           p.unit)
            for p, v, h in zip(parameters, values, Z95 * deviations)]


def _choice(parameter: Parameter, value: float, probability: Mapping[float, float]
            ) -> ParameterValue:
    """Return a value of few, with those of them that are credible."""
    credible = credible_values(probability)
    return ParameterValue(
        parameter.name, value, min(credible), max(credible), parameter.unit,
        tuple((parameter.value_text(other), probability[other]) for other in credible))
