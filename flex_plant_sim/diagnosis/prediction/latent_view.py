"""
All that the latent forces of some records show: shares explained, laws, spectral lines.

The search takes the laws from here, the verdict and the report everything else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.latent_forces import latent_forces
from flex_plant_sim.diagnosis.prediction.latent_line import line_of, SpectralLine
from flex_plant_sim.diagnosis.prediction.latent_series import COMMANDS, gauge_series, torque_series
from flex_plant_sim.diagnosis.prediction.law import (
    CONSTANT,
    cross_validate,
    CrossValidation,
    LatentSeries,
    Law,
    law_of,
    MIN_EXPLAINED_SHARE,
    TIME,
)
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.joint.measured_torque import MeasuredTorque
from flex_plant_sim.effects.joint.torque_ripple import TorqueRipple
import numpy as np

# Digits of a number in a table; finer than any law is known.
TABLE_DIGITS = 5
# Periods a turn of the ripples that a joint may have.
PERIODS = TorqueRipple.parameters[-1].starts
# Bins of a curve in pictures and JSON, equally full; samples that a bin needs for a spread.
CURVE_BINS, MIN_BIN_SAMPLES = 24, 5


def binned(x: Array, value: Array) -> Array:
    """
    Return centres, means and standard deviations of a value over x, (3, K).

    Bins hold equally many samples; those with too few are left out.
    """
    edges = np.quantile(x, np.linspace(0.0, 1.0, CURVE_BINS + 1))
    inside = np.clip(np.searchsorted(edges, x, side='right') - 1, 0, CURVE_BINS - 1)
    bins = [inside == k for k in range(CURVE_BINS) if np.sum(inside == k) >= MIN_BIN_SAMPLES]
    rows = [(x[b].mean(), value[b].mean(), value[b].std()) for b in bins]
    return np.array(rows).reshape(-1, 3).T


@dataclass(frozen=True)
class Finding:
    """
    What one latent force shows.

    Attributes
    ----------
    series : LatentSeries
    validations : tuple of CrossValidation
        Of every variable, the best first.
    law : Law
    line : SpectralLine or None
        The strongest line of its spectrum, where there is one.

    """

    series: LatentSeries
    validations: tuple[CrossValidation, ...]
    law: Law
    line: SpectralLine | None

    @property
    def exceeds_model_error(self) -> bool:
        """Tell whether the force is too large for a model error."""
        return self.series.rms > self.series.model_error

    @property
    def has_memory(self) -> bool:
        """Tell whether it exceeds model errors and no one variable explains half of it."""
        return self.exceeds_model_error and self.validations[0].share < MIN_EXPLAINED_SHARE

    @property
    def likely_variables(self) -> tuple[CrossValidation, ...]:
        """Return the two best of the variables that explain half of it, the best first."""
        return tuple(v for v in self.validations[:2] if v.share >= MIN_EXPLAINED_SHARE)

    @property
    def has_shape_of_no_effect(self) -> bool:
        """
        Tell whether its law is stated and of no effect's shape, by more than a model error.

        Lines with a step are gains, dampings, springs, dry friction; a wave over a joint's angle
        is a ripple. The evidence judges them by name. A line over time, a drift, it tempers as if
        that went with the motion; and no effect lets a gauge read a command.
        """
        law, scored = self.law, self.series.scored
        if not law.stated or law.variable == CONSTANT:
            return False
        x = self.series.variables[law.variable][1][scored]
        curve, straight = law.at(x), np.column_stack([np.ones_like(x), x, np.sign(x)])
        if law.variable == TIME or law.variable in COMMANDS:
            straight = straight[:, :1]
        waves = [np.column_stack([straight, np.sin(k * x), np.cos(k * x)])
                 for k in PERIODS if law.variable == 'angle']
        left = min(np.mean((curve - shape @ np.linalg.lstsq(shape, curve, rcond=None)[0])**2)
                   for shape in (straight, *waves))
        return bool(np.sqrt(left) > self.series.model_error_over(law.variable, law.knots))

    def results(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        law, line = self.law, self.line
        return {
            'unit': self.series.unit, 'rms': self.series.rms,
            'relevant': self.exceeds_model_error,
            'deviation': float(np.median(self.series.deviation[self.series.scored])),
            'explained': {v.variable: {'share': v.share, 'error': v.error}
                          for v in self.validations},
            'law': {'variable': law.variable, 'unit': law.variable_unit, 'stated': law.stated,
                    'knots': law.knots, 'values': law.values, 'deviations': law.deviations,
                    'share': law.share, 'error': law.share_error},
            'remembers': self.has_memory,
            'line': line and {'frequency_hz': line.frequency, 'share': line.share},
            'curves': {name: dict(zip(('at', 'mean', 'deviation'), self.curve(name)))
                       for name in self.series.variables}}

    def curve(self, variable: str) -> Array:
        """Return bin centres of a variable, mean and deviation of the force in them, (3, K)."""
        scored = self.series.scored
        return binned(self.series.variables[variable][1][scored], self.series.value[scored])


@dataclass(frozen=True)
class LatentView:
    """The latent forces of records under one base model, and what each of them shows."""

    torques: tuple[Finding, ...]
    gauges: tuple[Finding, ...]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Return the findings of torques, then of gauges."""
        return (*self.torques, *self.gauges)

    @property
    def laws(self) -> tuple[Law, ...]:
        """Return the laws of torques that hold on stretches left out."""
        return tuple(finding.law for finding in self.torques if finding.law.holds)

    @property
    def law_effects(self) -> tuple[Effect, ...]:
        """Return these laws as effects for the extended robot."""
        return tuple(law_effect(law) for law in self.laws)

    def results(self) -> dict[str, Any]:
        """Return the figures for JSON, by joint and gauge."""
        return {finding.series.site: finding.results() for finding in self.findings}


def latent_view(predictors: Sequence[Predictor]) -> LatentView:
    """
    Return what the latent forces of records show.

    Parameters
    ----------
    predictors : sequence of Predictor
        One for each record, with its locked windows, where no law is fitted.

    """
    forces = tuple(latent_forces(p, scored=p.windows.others) for p in predictors)
    robot, step = predictors[0].base.robot, predictors[0].arm.step_time
    torques, gauges = torque_series(forces, robot), gauge_series(forces, robot)
    return LatentView(tuple(_finding(s, step) for s in torques),
                      tuple(_finding(s, step) for s in gauges))


def torque_laws(predictors: Sequence[Predictor]) -> tuple[Law, ...]:
    """
    Return the laws of `latent_view` alone: gauges and spectra, unread, would cost as much.

    Of a joint with backlash none: where its teeth meet earlier or later than in the filter, the
    torque is that of the contact.
    """
    forces = tuple(latent_forces(p, scored=p.windows.others) for p in predictors)
    found = map(law_of, torque_series(forces, predictors[0].base.robot))
    gaps = {gap.site for gap in predictors[0].arm.gaps}
    return tuple(law for law in found if law.holds and law.site not in gaps)


def law_effect(law: Law) -> MeasuredTorque:
    """Return a law as the effect that a robot file carries; a constant is one knot of time."""
    variable = 'time' if law.variable == CONSTANT else law.variable
    return MeasuredTorque(law.site, (variable, *(
        tuple(float(f'{x:.{TABLE_DIGITS}g}') for x in column)
        for column in (law.knots, law.values))))


def _finding(series: LatentSeries, step: float) -> Finding:
    validations = tuple(cross_validate(series))
    return Finding(series, validations, law_of(series, validations), line_of(series, step))
