"""
The fit of a set of causes with the parts of the arm: estimates, their covariance, the evidence.

`GaussNewton` makes fits; the posterior and the verdict read them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
import math

from flex_plant_sim.arm.parts import FAR_PART_FACTOR
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet, Hypothesis
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.interval import Z95
import numpy as np
from numpy.typing import NDArray

# Error scale from which on a channel's errors are larger than any model's: smaller excesses leave
# nothing to explain. Noise found in 4000 to 10 000 samples is off by that much at two to three
# standard errors, see NOISE_ERROR; halved and doubled by benchmarks/diagnosis_constants.py.
NOTABLE_EXCESS = 1.05


@dataclass(frozen=True)
class Fit:
    """
    A set of causes, fitted.

    Attributes
    ----------
    hypotheses : tuple of Hypothesis
        The causes; none for `nothing`, and for something unknown alone.
    discrepancy : DiscrepancyModel
        Of the likelihood; where it differs from the nominal one, something unknown is assumed.
    values : Array
        Estimates of the causes' parameters, (k,).
    deviations : Array
        Posterior mean of the parts' deviations, (p,).
    error_scale : Array
        Factor of each channel's errors over what the filter states, at least 1, (m,).
    covariance : Array
        Of (values, deviations), (k + p, k + p); see `sandwich_covariance` for large errors.
    statistics : SufficientStatistics
        From which all of this follows.
    log_evidence : float
        nats, up to a constant of the record; -inf where nothing finite is predicted.
    varying_gain : float
        Gain of the evidence if one of the causes varies over the record, nats, see `constancy`;
        -inf where that was not computed.
    window_log_likelihoods : Array
        ln p of each window at the estimates, up to a constant of the window, nats, (W,).
    slow_scale : Array
        Factor of the channels' errors, averaged over the correlation time of what every model
        misses of them, over what the filter states, (m,). Of all errors they are few.
    slow_means : Array
        Number of such means, (m,).
    varying_part_gains : Array
        Gain of the evidence if a part varies over the record, nats, (p,), see `constancy`; none
        where that was not computed.

    """

    hypotheses: tuple[Hypothesis, ...]
    discrepancy: DiscrepancyModel
    values: Array
    deviations: Array
    error_scale: Array
    covariance: Array
    statistics: SufficientStatistics
    log_evidence: float
    varying_gain: float = -math.inf
    window_log_likelihoods: Array = field(default_factory=lambda: np.zeros(0))
    slow_scale: Array = field(default_factory=lambda: np.zeros(0))
    slow_means: Array = field(default_factory=lambda: np.zeros(0))
    varying_part_gains: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def large_errors(self) -> NDArray[np.bool_]:
        """Return which channels err by more than every model may, (m,)."""
        return np.asarray(self.error_scale > NOTABLE_EXCESS)

    @property
    def has_large_errors(self) -> bool:
        """Return whether a channel, at once or slowly, errs by more than every model may."""
        return bool(self.large_errors.any() or np.any(self.slow_scale > NOTABLE_EXCESS))


def may_be_null(fit: Fit, index: int) -> bool:
    """Tell whether the 95 % intervals of all sizes of one of a fit's causes hold their null."""
    cause, causes = fit.hypotheses[index], CauseSet(fit.hypotheses, 1.0)
    std = np.sqrt(np.diagonal(fit.covariance)[:fit.values.size])
    deviation = np.abs(causes.split(fit.values)[index] - cause.null)
    return bool(np.all((deviation < Z95 * causes.split(std)[index])[cause.is_size]))


def with_far_part(fit: Fit, name: str, index: int) -> Fit:
    """Return a fit re-evaluated with one part, by name and index, that is not as its file says."""
    tolerances = fit.statistics.tolerances.copy()
    tolerances[index] *= FAR_PART_FACTOR
    statistics = replace(fit.statistics, tolerances=tolerances)
    error_scale = statistics.likeliest_error_scale()
    return replace(fit, discrepancy=replace(fit.discrepancy, far_part=name),
                   error_scale=error_scale,
                   deviations=statistics.part_marginal(error_scale).mean, statistics=statistics,
                   covariance=statistics.joint_marginal(error_scale).covariance,
                   log_evidence=statistics.log_evidence(error_scale))
