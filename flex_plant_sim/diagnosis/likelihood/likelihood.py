"""The likelihood of records: whitened prediction errors, linear in the parts of the arm."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import channel_products
from flex_plant_sim.diagnosis.likelihood.prior import deviated, FAR_OFF, part_priors, PartPrior
from flex_plant_sim.diagnosis.pool import all_of
from flex_plant_sim.diagnosis.prediction.predictor import Base, Predictor
from flex_plant_sim.diagnosis.record.windows import Indices, Windows
from flex_plant_sim.effects.base import Effect
import numpy as np

# Of a tolerance, for differences: parts are near linear within theirs.
STEP = 0.2


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

    def __init__(self, base: Base, windows: Sequence[Windows], noise: Sequence[Array],
                 around: Sequence[Effect] = (), about: Array | None = None, jobs: int = 1):
        self.base, self.around, self.jobs = base, tuple(around), jobs
        self.parts: tuple[PartPrior, ...] = part_priors(base.robot, windows[0].record.payload)
        self.tolerances = np.array([
            part.tolerance * (FAR_OFF if part.name == base.discrepancy.far else 1.0)
            for part in self.parts])
        self.about = np.zeros(len(self.parts)) if about is None else about
        self.predictors = self._following(self.around, zip(windows, noise))
        # Samples that each stands for, and which they are, where only some windows are asked.
        self.weight = 1.0
        self.kept: slice | Indices = slice(None)
        # Whether errors are judged in one covariance or in each arm's own.
        self.alike = True

    def _following(self, effects: Sequence[Effect], records: Iterable[tuple[Windows, Array]]
                   ) -> list[Predictor]:
        """Return predictors along the trajectories that effects give, about the deviations."""
        robot, sensors = deviated(self.base.robot, self.parts, self.about)
        return [Predictor(self.base, windows, noise, True, (*effects, *sensors), robot)
                for windows, noise in records]

    def at(self, effects: Sequence[Effect], deviations: Array, keep: bool = False) -> Array:
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
        robot, sensors = deviated(self.base.robot, self.parts, deviations)
        found = [_channels(p.whitened((*effects, *sensors), robot, keep, self.alike))
                 for p in self.predictors]
        return np.sqrt(self.weight) * np.concatenate(found, axis=-1)

    def residual(self, effects: Sequence[Effect]) -> Array:
        """Return what is linear in the deviations for none of them, with effects on, (B, m, N)."""
        return self.at(effects, self.about) - self.moved

    @cached_property
    def moved(self) -> Array:
        """Return what the deviations around which it is linear do, by the columns, (m, N)."""
        return np.tensordot(self.about, self.columns, 1)

    @cached_property
    def present(self) -> Array:
        """Return the residual with the effects around which it is linearised, (m, N)."""
        return self.residual(self.around)[0]

    @cached_property
    def columns(self) -> Array:
        """Return d white / d deviations, (p, m, N), by differences."""
        here = self.at(self.around, self.about)[0]

        def column(k: int) -> Array:
            step = STEP * self.parts[k].tolerance
            moved = self.about.copy()
            moved[k] += step
            return np.asarray((self.at(self.around, moved, keep=True)[0] - here) / step)

        return np.array(all_of(column, range(len(self.parts)), self.jobs))

    @cached_property
    def products(self) -> Array:
        """Return the columns' products, (m, p, p)."""
        return channel_products(self.columns, self.columns)

    @cached_property
    def surprise(self) -> Array:
        """Return minus the log-likelihood that whitening alone costs each channel, nats, (m,)."""
        found = [np.log(np.diagonal(p.whitener, axis1=-2, axis2=-1)).sum(axis=(0, 1))
                 for p in self.predictors]
        return -self.weight * np.sum(found, axis=0)

    @cached_property
    def smooth(self) -> Likelihood:
        """Return what each arm's own filter errs: no likelihood, but without its side valleys."""
        return self._copied('present', 'columns', 'moved', 'products', 'smooth', alike=False)

    def at_rest(self, effects: Sequence[Effect]) -> bool:
        """Tell whether effects have coordinates that the trajectory does not move."""
        now = self.predictors[0].arm.form.names
        return any(name not in now for name in self.predictors[0].arm_with(effects).form.names)

    def along(self, effects: Sequence[Effect]) -> Likelihood:
        """Return the likelihood with the trajectory that effects give, its columns the same."""
        predictors = self._following(effects, ((p.windows, p.noise) for p in self.predictors))
        return self._copied('present', 'smooth', around=tuple(effects), predictors=predictors)

    def _copied(self, *less: str, **changed: object) -> Likelihood:
        other = object.__new__(Likelihood)
        other.__dict__.update({k: v for k, v in self.__dict__.items() if k not in less}, **changed)
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
        kept = np.arange(self.present.shape[-1]).reshape(sum(sizes), -1)[chosen].ravel()
        return self._copied(
            'products', 'surprise', 'smooth',
            predictors=[p.thinned(every) for p in self.predictors], kept=kept,
            weight=self.weight * weight, present=np.sqrt(weight) * self.present[:, kept],
            columns=np.sqrt(weight) * self.columns[..., kept],
            moved=np.sqrt(weight) * self.moved[:, kept])


def _channels(errors: Array) -> Array:
    """Return errors (B, W, length, m) channel by channel, (B, m, N)."""
    return np.moveaxis(errors.reshape(len(errors), -1, errors.shape[-1]), -1, 1)
