"""The likelihood of records: whitened prediction errors, linear in the parts of the arm."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import Marginal
from flex_plant_sim.diagnosis.likelihood.prior import deviated, part_priors, PartPrior
from flex_plant_sim.diagnosis.prediction.noise import Steady
from flex_plant_sim.diagnosis.prediction.predictor import Base, Predictor
from flex_plant_sim.diagnosis.record.windows import Windows
from flex_plant_sim.effects.base import Effect
import numpy as np

# Of a tolerance, for differences: parts are near linear within theirs.
STEP = 0.2
# So many samples count as one. On clean arms of another simulator the colour that is left asks for
# less than one (benchmarks/discrepancy.py: 0.3 with gauges 1 % off, 0.15 with 2 %); effects other
# than the catalogue's ask for more. To be calibrated on the bank.
TEMPER = 4.0


class Likelihood:
    """
    Records under a base model with any effects, linearised in the deviations of the parts.

    Parameters
    ----------
    base : Base
    windows : sequence of Windows
        One per record.
    noise : sequence of Array
        Sensor noise per record, (m,).
    around : sequence of Effect
        On while sensitivities are taken; smooth forces follow the trajectory that they give.
    deviations : Array, optional
        Of the parts where they are linearised, (p,); zero by default.
    scale : Array, optional
        By how much errors exceed what the filter states, (m,); one by default.

    """

    def __init__(self, base: Base, windows: Sequence[Windows], noise: Sequence[Array],
                 around: Sequence[Effect] = (), deviations: Array | None = None,
                 scale: Array | None = None):
        self.base, self.windows, self.noise = base, tuple(windows), tuple(noise)
        self.around = tuple(around)
        self.parts: tuple[PartPrior, ...] = part_priors(base.robot, windows[0].record.payload)
        self.tolerances = np.array([part.tolerance for part in self.parts])
        self.deviations = np.zeros(len(self.parts)) if deviations is None else deviations
        self.scale = np.ones(noise[0].size) if scale is None else scale
        robot, sensors = deviated(base.robot, self.parts, self.deviations)
        self.predictors = [Predictor(base, w, s, True, (*self.around, *sensors), robot)
                           for w, s in zip(windows, noise)]

    def residual(self, effects: Sequence[Effect], deviations: Array | None = None,
                 steady: Sequence[Steady] | None = None) -> Array:
        """
        Return whitened, tempered prediction errors of all windows, (B, M).

        Parameters
        ----------
        effects : sequence of Effect
            All that are on beside the base's, in place of `around`.
        deviations : Array, optional
            Of the parts, in place of those linearised at, (p,).
        steady : sequence of Steady, optional
            Filters in place of the arm's own, one a record.

        """
        values = self.deviations if deviations is None else deviations
        robot, sensors = deviated(self.base.robot, self.parts, values)
        found = [p.whitened((*effects, *sensors), robot, None if steady is None else steady[k])
                 for k, p in enumerate(self.predictors)]
        weight = 1.0 / (self.scale * np.sqrt(TEMPER))
        return np.concatenate([(errors * weight).reshape(len(errors), -1) for errors in found],
                              axis=1)

    @cached_property
    def present(self) -> Array:
        """Return the residual with the effects around which it is linearised, (M,)."""
        return self.residual(self.around)[0]

    @cached_property
    def columns(self) -> Array:
        """Return d white / d deviations, (M, p), by differences."""
        steady = [p.steady for p in self.predictors]
        found = np.empty((self.present.size, len(self.parts)))
        for k, step in enumerate(STEP * self.tolerances):
            moved = self.deviations.copy()
            moved[k] += step
            white = self.residual(self.around, moved, steady)[0]
            found[:, k] = (white - self.present) / step
        return found

    @cached_property
    def parts_marginal(self) -> Marginal:
        """Return the marginal over the parts."""
        return Marginal(self.columns, self.tolerances)

    def undeviated(self, white: Array) -> Array:
        """Return residuals (…, M) as if all deviations were zero, by the linear model."""
        return white - self.columns @ self.deviations

    def thinned(self, samples: int) -> Likelihood:
        """Return the likelihood of evenly chosen windows, so few that about `samples` count."""
        sizes = [p.windows.starts.size for p in self.predictors]
        length = self.predictors[0].windows.length
        every = -(-sum(sizes) * length // samples)
        if every == 1:
            return self
        kept = np.concatenate([first + np.arange(0, size, every) for first, size in zip(
            np.cumsum([0, *sizes]), sizes)])
        rows = np.arange(self.present.size).reshape(sum(sizes), -1)[kept].ravel()
        other = object.__new__(Likelihood)
        own = {k: v for k, v in self.__dict__.items() if k != 'parts_marginal'}
        # Each window stands for several.
        weight = np.sqrt(sum(sizes) / kept.size)
        other.__dict__.update(own | {
            'predictors': [p.thinned(every) for p in self.predictors],
            'scale': self.scale / weight, 'present': self.present[rows] * weight,
            'columns': self.columns[rows] * weight})
        return other

    def surprise(self) -> float:
        """Return minus the log-likelihood that whitening alone costs, tempered, nats."""
        diagonals = [np.diagonal(p.whitener, axis1=-2, axis2=-1) for p in self.predictors]
        samples = self.present.size / self.scale.size
        size = samples * np.sum(np.log(self.scale)) - sum(np.sum(np.log(d)) for d in diagonals)
        return float(size) / TEMPER

    def scale_of(self, residual: Array) -> Array:
        """
        Return by how much residuals (M,) exceed what the filter states, (m,), at least one.

        The likelihood is greatest with errors as large as they are; that they are smaller than
        what every model is allowed to miss tells nothing.
        """
        errors = residual.reshape(-1, self.scale.size) * self.scale * np.sqrt(TEMPER)
        return np.maximum(np.sqrt(np.mean(errors**2, axis=0)), 1.0)
