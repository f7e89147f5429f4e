"""The likelihood of records: whitened prediction errors, linear in the parts of the arm."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.evidence import channel_products
from flex_plant_sim.diagnosis.likelihood.prior import deviated, FAR_OFF, part_priors, PartPrior
from flex_plant_sim.diagnosis.prediction.predictor import Base, Predictor
from flex_plant_sim.diagnosis.record.windows import Indices, Windows
from flex_plant_sim.effects.base import Effect
import numpy as np

# Of a tolerance, for differences: parts are near linear within theirs.
STEP = 0.05


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
    far : float
        About where the part is that is not as its file says, see Amplitude; 0 if not known.
    about : Array, optional
        Deviations of the parts around which it is linearised, see `near`, (p,); zero by default.
    differences : Array, optional
        See `differences`, where they are known.

    """

    def __init__(self, base: Base, windows: Sequence[Windows], noise: Sequence[Array],
                 around: Sequence[Effect] = (), far: float = 0.0,
                 about: Array | None = None, differences: Array | None = None):
        self.base, self.around, self.far = base, tuple(around), far
        self.parts: tuple[PartPrior, ...] = part_priors(base.robot, windows[0].record.payload)
        self.tolerances = np.array([
            part.tolerance * (FAR_OFF if part.name == base.discrepancy.far else 1.0)
            for part in self.parts])
        self.about = self.near(np.zeros(len(self.parts)) if about is None else about)
        robot, sensors = deviated(base.robot, self.parts, self.about)
        self.predictors = [Predictor(base, w, s, True, (*self.around, *sensors), robot)
                           for w, s in zip(windows, noise)]
        if differences is not None:
            self.__dict__['differences'] = differences
        # Samples that each stands for, and which they are, where only some windows are asked.
        self.weight = 1.0
        self.kept: slice | Indices = slice(None)
        # Whether errors are judged in one covariance or in each arm's own.
        self.alike = True

    def errors(self, effects: Sequence[Effect], deviations: Array, keep: bool = False) -> Array:
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
        """Return the errors that parts as in the file would leave, linearly, (B, m, N)."""
        return self.errors(effects, self.about) - self.moved

    @cached_property
    def present(self) -> Array:
        """Return the residual with the effects around which it is linearised, (m, N)."""
        return self.residual(self.around)[0]

    @cached_property
    def moved(self) -> Array:
        """Return what the parts change linearly from the file to `about`, (m, N)."""
        return np.tensordot(self.about, self.columns, 1)

    def near(self, deviations: Array) -> Array:
        """Return deviations to linearise about: parts in units act in proportion anyway, (p,)."""
        return np.where([part.unit == '' for part in self.parts], deviations, 0.0)

    @cached_property
    def columns(self) -> Array:
        """Return d white / d deviations, (p, m, N), by differences."""
        return self.differences[0 if self.alike else 1]

    @cached_property
    def differences(self) -> Array:
        """Return the columns alike and as each arm's own filter errs, (2, p, m, N)."""
        now = self._seen(self.about, False)
        found, steps = np.empty((2, len(self.parts), *now.shape[1:])), STEP * self.tolerances
        if self.far:
            steps[self.far_part] = self.far
        for k, step in enumerate(steps):
            there = self.about.copy()
            there[k] += step
            found[:, k] = (self._seen(there, True) - now) / step
        return found

    def _seen(self, deviations: Array, keep: bool) -> Array:
        robot, sensors = deviated(self.base.robot, self.parts, deviations)
        found = [[_channels(errors)[0] for errors in p.seen((*self.around, *sensors), robot, keep)]
                 for p in self.predictors]
        return np.sqrt(self.weight) * np.concatenate(found, axis=-1)

    @property
    def far_part(self) -> int:
        """Return the place of the part that is not as its file says."""
        return [part.name for part in self.parts].index(self.base.discrepancy.far)

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
        return self._copied('present', 'moved', 'columns', 'products', 'smooth', alike=False)

    def _copied(self, *less: str, **changed: object) -> Likelihood:
        other = object.__new__(Likelihood)
        other.__dict__.update({k: v for k, v in self.__dict__.items() if k not in less}, **changed)
        return other

    @property
    def times(self) -> Array:
        """Return when each sample was taken, in its own record, s, (N,)."""
        return np.concatenate([p.record.time[p.windows.indices[:, p.windows.warm_up:]].ravel()
                               for p in self.predictors])

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
            'moved', 'differences', 'products', 'surprise', 'smooth',
            predictors=[p.thinned(every) for p in self.predictors], kept=kept,
            weight=self.weight * weight, present=np.sqrt(weight) * self.present[:, kept],
            columns=np.sqrt(weight) * self.columns[..., kept])


def _channels(errors: Array) -> Array:
    """Return errors (B, W, length, m) channel by channel, (B, m, N)."""
    return np.moveaxis(errors.reshape(len(errors), -1, errors.shape[-1]), -1, 1)
