"""The likelihood of records: whitened prediction errors, linear in the parts of the arm."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import channel_products
from flex_plant_sim.diagnosis.likelihood.prior import (
    FAR_PART_FACTOR,
    part_priors,
    PartPrior,
    with_deviations,
)
from flex_plant_sim.diagnosis.pool import all_of
from flex_plant_sim.diagnosis.prediction.predictor import BaseModel, Predictor
from flex_plant_sim.diagnosis.record.windows import Indices, Windows
from flex_plant_sim.effects.base import Effect
import numpy as np

# Of a tolerance, for differences: parts are near linear within theirs.
DIFFERENCE_STEP = 0.2


class Likelihood:
    """
    Records under a base model with any effects, linearised in the deviations of the parts.

    Whitened errors are kept channel by channel, (m, N): how large those of a channel are is
    settled with the causes, see Moments.

    Parameters
    ----------
    base : Base
    windows : sequence of Windows
        One per record.
    noise : sequence of Array
        Sensor noise per record, (m,).
    around : sequence of Effect
        On while sensitivities are taken; smooth forces follow the trajectory that they give.
    about : Array, optional
        Deviations around which it is linear, (p,); none by default.
    jobs : int
        Processes that take its columns.

    """

    def __init__(self, base: BaseModel, windows: Sequence[Windows], noise: Sequence[Array],
                 centre_effects: Sequence[Effect] = (), centre_deviations: Array | None = None, jobs: int = 1):
        self.base, self.centre_effects, self.jobs = base, tuple(centre_effects), jobs
        self.parts: tuple[PartPrior, ...] = part_priors(base.robot, windows[0].record.payload)
        self.tolerances = np.array([
            part.tolerance * (FAR_PART_FACTOR if part.name == base.discrepancy.far_part else 1.0)
            for part in self.parts])
        self.centre_deviations = np.zeros(len(self.parts)) if centre_deviations is None else centre_deviations
        self.predictors = self._predictors_along(self.centre_effects, zip(windows, noise))
        # Samples that each stands for, and which they are, where only some windows are asked.
        self.weight = 1.0
        self.kept_samples: slice | Indices = slice(None)
        # Whether errors are judged in one covariance or in each arm's own.
        self.shared_covariance = True

    def _predictors_along(self, effects: Sequence[Effect], records: Iterable[tuple[Windows, Array]]
                   ) -> list[Predictor]:
        """Return predictors along the trajectories that effects give, about the deviations."""
        robot, sensors = with_deviations(self.base.robot, self.parts, self.centre_deviations)
        return [Predictor(self.base, windows, noise, True, (*effects, *sensors), robot)
                for windows, noise in records]

    def whitened_residual(self, effects: Sequence[Effect], deviations: Array, reuse_gain: bool = False) -> Array:
        """
        Return whitened prediction errors of all windows, (B, m, N).

        Parameters
        ----------
        effects : sequence of Effect
            All that are on beside the base's, in place of `around`.
        deviations : Array
            Of the parts, (p,).
        keep : bool
            Whether filters keep the gain of `around` where that can be, see Predictor.whitened.

        """
        robot, sensors = with_deviations(self.base.robot, self.parts, deviations)
        found = [_by_channel(p.whitened_residual((*effects, *sensors), robot, reuse_gain, self.shared_covariance))
                 for p in self.predictors]
        return np.sqrt(self.weight) * np.concatenate(found, axis=-1)

    def residual(self, effects: Sequence[Effect]) -> Array:
        """Return what is linear in the deviations for none of them, with effects on, (B, m, N)."""
        return self.whitened_residual(effects, self.centre_deviations) - self.centre_shift

    @cached_property
    def centre_shift(self) -> Array:
        """Return what the deviations around which it is linear do, by the columns, (m, N)."""
        return np.tensordot(self.centre_deviations, self.part_jacobian, 1)

    @cached_property
    def centre_residual(self) -> Array:
        """Return the residual with the effects around which it is linearised, (m, N)."""
        return self.residual(self.centre_effects)[0]

    @cached_property
    def part_jacobian(self) -> Array:
        """Return d white / d deviations, (p, m, N), by differences."""
        here = self.whitened_residual(self.centre_effects, self.centre_deviations)[0]

        def column(k: int) -> Array:
            step = DIFFERENCE_STEP * self.parts[k].tolerance
            centre_shift = self.centre_deviations.copy()
            centre_shift[k] += step
            return np.asarray((self.whitened_residual(self.centre_effects, centre_shift, reuse_gain=True)[0] - here) / step)

        return np.array(all_of(column, range(len(self.parts)), self.jobs))

    @cached_property
    def part_products(self) -> Array:
        """Return the columns' products, (m, p, p)."""
        return channel_products(self.part_jacobian, self.part_jacobian)

    @cached_property
    def channel_log_determinants(self) -> Array:
        """Return minus the log-likelihood that whitening alone costs each channel, nats, (m,)."""
        found = [np.log(np.diagonal(p.whitener, axis1=-2, axis2=-1)).sum(axis=(0, 1))
                 for p in self.predictors]
        return -self.weight * np.sum(found, axis=0)

    @cached_property
    def with_own_filters(self) -> Likelihood:
        """Return what each arm's own filter errs: no likelihood, but without its side valleys."""
        return self._copied('centre_residual', 'part_jacobian', 'centre_shift', 'part_products', 'with_own_filters',
                            shared_covariance=False)

    def has_new_coordinates(self, effects: Sequence[Effect]) -> bool:
        """Tell whether effects have coordinates that the trajectory does not move."""
        now = self.predictors[0].arm.form.names
        return any(name not in now for name in self.predictors[0].arm_with(effects).form.names)

    def along_trajectory_of(self, effects: Sequence[Effect]) -> Likelihood:
        """Return the likelihood with the trajectory that effects give, its columns the same."""
        predictors = self._predictors_along(effects, ((p.windows, p.noise) for p in self.predictors))
        return self._copied('centre_residual', 'with_own_filters', centre_effects=tuple(effects), predictors=predictors)

    def _copied(self, *dropped: str, **changed: object) -> Likelihood:
        other = object.__new__(Likelihood)
        other.__dict__.update({k: v for k, v in self.__dict__.items() if k not in dropped}, **changed)
        return other

    @property
    def times(self) -> Array:
        """Return when each sample was taken, in its own record, s, (N,)."""
        return np.concatenate([p.record.time[p.windows.indices[:, p.windows.warm_up:]].ravel()
                               for p in self.predictors])

    @property
    def duration(self) -> float:
        """Return the end of the longest record, s."""
        return max(float(p.record.time[-1]) for p in self.predictors)

    def thinned(self, samples: int) -> Likelihood:
        """Return the likelihood of evenly chosen windows, so few that about `samples` count."""
        sizes = [p.windows.starts.size for p in self.predictors]
        every = -(-sum(sizes) * self.predictors[0].windows.length // samples)
        if every <= 1:
            return self
        chosen = np.concatenate([first + np.arange(0, size, every) for first, size in zip(
            np.cumsum([0, *sizes]), sizes)])
        weight = sum(sizes) / chosen.size
        kept_samples = np.arange(self.centre_residual.shape[-1]).reshape(sum(sizes), -1)[chosen].ravel()
        return self._copied(
            'part_products', 'channel_log_determinants', 'with_own_filters',
            predictors=[p.thinned(every) for p in self.predictors], kept_samples=kept_samples,
            weight=self.weight * weight, centre_residual=np.sqrt(weight) * self.centre_residual[:, kept_samples],
            part_jacobian=np.sqrt(weight) * self.part_jacobian[..., kept_samples],
            centre_shift=np.sqrt(weight) * self.centre_shift[:, kept_samples])


def _by_channel(errors: Array) -> Array:
    """Return errors (B, W, length, m) channel by channel, (B, m, N)."""
    return np.moveaxis(errors.reshape(len(errors), -1, errors.shape[-1]), -1, 1)
