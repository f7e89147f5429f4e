"""
The likelihood of records: whitened residuals, linearised in the deviations of the arm's parts.

It runs the predictors of all records. Fits of causes take residuals and Jacobians from it and
reduce them to `SufficientStatistics`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property

from flex_plant_sim.arm.parts import FAR_PART_FACTOR
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.likelihood.constancy import window_products
from flex_plant_sim.diagnosis.likelihood.evidence import channel_products
from flex_plant_sim.diagnosis.likelihood.prior import (
    part_priors,
    PartPrior,
    sensors_with_deviations,
    with_deviations,
)
from flex_plant_sim.diagnosis.pool import all_of
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.windows import evenly, Indices, Windows
from flex_plant_sim.effects.base import Effect
import numpy as np

# Step of the finite differences in a part, as a share of its tolerance, within which the residual
# is nearly linear.
DIFFERENCE_STEP = 0.2


class Likelihood:
    """
    Whitened residuals of records, e(effects, deviations) = r(effects) + J deviations, (m, N).

    r is exact in the effects; J, the Jacobian in the parts' deviations, is taken once, at the
    centre. Channels are kept apart, as their error scales are estimated with the causes, see
    `SufficientStatistics`.

    Parameters
    ----------
    base : BaseModel
    windows : sequence of Windows
        One per record.
    noise : sequence of Array
        Standard deviations of the sensor noise of each record, (m,).
    centre_effects : sequence of Effect
        Effects of the centre. Smooth forces are evaluated along the trajectory they give.
    centre_deviations : Array, optional
        Deviations of the parts at the centre, (p,); zero by default.
    jobs : int
        Processes that take the Jacobian.

    Attributes
    ----------
    tolerances : Array
        Standard deviations of the parts' deviations a priori, (p,).
    weight : float
        Samples that each sample stands for, where only some windows are used.
    kept_samples : slice or Indices
        Those samples among all.
    shared_covariance : bool
        Whether all hypotheses are whitened by one covariance, see `Predictor.whitened_residual`.

    """

    def __init__(self, base: BaseModel, windows: Sequence[Windows], noise: Sequence[Array],
                 centre_effects: Sequence[Effect] = (), centre_deviations: Array | None = None,
                 jobs: int = 1):
        self.base, self.centre_effects, self.jobs = base, tuple(centre_effects), jobs
        self.parts: tuple[PartPrior, ...] = part_priors(base.robot, windows[0].record.payload)
        self.tolerances = np.array([
            part.tolerance * (FAR_PART_FACTOR if part.name == base.discrepancy.far_part else 1.0)
            for part in self.parts])
        self.centre_deviations = (
            np.zeros(len(self.parts)) if centre_deviations is None else centre_deviations)
        self.predictors = self._predictors_along(self.centre_effects, zip(windows, noise))
        self.weight = 1.0
        self.kept_samples: slice | Indices = slice(None)
        self.shared_covariance = True

    def _predictors_along(self, effects: Sequence[Effect],
                          records: Iterable[tuple[Windows, Array]]) -> list[Predictor]:
        """Return predictors with trajectories of the effects and the centre's deviations."""
        robot, sensors = self._centre
        return [Predictor(self.base, windows, noise, True, (*effects, *sensors), robot)
                for windows, noise in records]

    def whitened_residual(self, effects: Sequence[Effect], deviations: Array) -> Array:
        """
        Return the exact whitened residual e of all windows, (B, m, N).

        Parameters
        ----------
        effects : sequence of Effect
            In addition to the base's, in place of the centre's.
        deviations : Array
            Of the parts, (p,).

        """
        at_centre = deviations is self.centre_deviations
        robot, sensors = self._centre if at_centre else self._deviating(deviations)
        return self._whitened_residual((*effects, *sensors), robot)

    def _deviating(self, deviations: Array) -> tuple[Robot, tuple[Effect, ...]]:
        return with_deviations(self.base.robot, self.parts, deviations)

    @cached_property
    def _centre(self) -> tuple[Robot, tuple[Effect, ...]]:
        """Return the centre's robot, and the sensors' effects there."""
        return self._deviating(self.centre_deviations)

    def _whitened_residual(self, effects: Sequence[Effect], robot: Robot) -> Array:
        """Return e of a robot, its sensors' effects included."""
        found = [_by_channel(p.whitened_residual(effects, robot, self.shared_covariance))
                 for p in self.predictors]
        return np.sqrt(self.weight) * np.concatenate(found, axis=-1)

    def residual(self, effects: Sequence[Effect]) -> Array:
        """Return r(effects), extrapolated by J from the centre to no deviations, (B, m, N)."""
        return self.whitened_residual(effects, self.centre_deviations) - self.centre_shift

    @cached_property
    def centre_shift(self) -> Array:
        """Return J times the centre's deviations, (m, N)."""
        return np.tensordot(self.centre_deviations, self.part_jacobian, 1)

    @cached_property
    def centre_residual(self) -> Array:
        """Return r at the centre's effects, (m, N)."""
        return self.residual(self.centre_effects)[0]

    @cached_property
    def part_jacobian(self) -> Array:
        """Return J, the derivatives of e in the deviations, (p, m, N), by differences."""
        here = self.whitened_residual(self.centre_effects, self.centre_deviations)[0]
        robot, sensors = self._centre

        def derivative(k: int) -> Array:
            part, step = self.parts[k], DIFFERENCE_STEP * self.parts[k].tolerance
            # What is further from its file by a step is what is there, and a step from it.
            moved, seen = robot, sensors
            if part.effect is None:
                moved = part.change(robot, step)
            else:
                deviations = self.centre_deviations.copy()
                deviations[k] += step
                seen = sensors_with_deviations(self.parts, deviations)
            there = self._whitened_residual((*self.centre_effects, *seen), moved)[0]
            return np.asarray((there - here) / step)

        # Where all parts are known exactly there is none, and the shape is still of three axes.
        found = np.array(all_of(derivative, range(len(self.parts)), self.jobs))
        return found.reshape(len(self.parts), *here.shape)

    @cached_property
    def part_products(self) -> Array:
        """Return J J' of each channel, (m, p, p)."""
        return channel_products(self.part_jacobian, self.part_jacobian)

    @cached_property
    def part_products_by_window(self) -> Array:
        """Return J J' of each channel in each window, (m, W, p, p)."""
        windows = sum(p.windows.starts.size for p in self.predictors)
        return window_products(self.part_jacobian, windows)

    @cached_property
    def channel_log_determinants(self) -> Array:
        """Return half the log-determinant of the covariance, by channel, nats, (m,)."""
        found = [np.log(np.diagonal(p.whitener, axis1=-2, axis2=-1)).sum(axis=(0, 1))
                 for p in self.predictors]
        return -self.weight * np.sum(found, axis=0)

    @cached_property
    def with_own_filters(self) -> Likelihood:
        """Return the same with each arm's own filter: smoother in the effects, no likelihood."""
        return self._copied('centre_residual', 'part_jacobian', 'centre_shift', 'part_products',
                            'part_products_by_window', 'with_own_filters',
                            shared_covariance=False)

    def changes_shapes(self, effects: Sequence[Effect]) -> bool:
        """Tell whether an arm with effects bends in other shapes than the trajectory's."""
        return self.predictors[0].changes_shapes(effects)

    def has_new_coordinates(self, effects: Sequence[Effect]) -> bool:
        """Tell whether effects have coordinates that the centre's trajectory lacks."""
        now = self.predictors[0].arm.form.names
        return any(name not in now for name in self.predictors[0].arm_with(effects).form.names)

    def along_trajectory_of(self, effects: Sequence[Effect], deviations: Array | None = None
                            ) -> Likelihood:
        """
        Return the same likelihood along the trajectory of other effects, with the same J.

        The trajectory's parts deviate as the centre's, or as stated, (p,).
        """
        centre = self._copied(
            'centre_residual', 'centre_shift', 'with_own_filters', '_centre',
            centre_effects=tuple(effects),
            centre_deviations=self.centre_deviations if deviations is None else deviations)
        return centre._copied(predictors=centre._predictors_along(
            effects, ((p.windows, p.noise) for p in self.predictors)))

    @property
    def light(self) -> Likelihood:
        """Return the same without what can be computed again."""
        return self._copied('centre_residual', 'centre_shift', 'part_jacobian', 'part_products',
                            'part_products_by_window', 'with_own_filters')

    def with_commands_moved(self, rows: int) -> Likelihood:
        """Return the same likelihood with commands that act rows earlier, with the same J."""
        predictors = self._predictors_along(self.centre_effects, (
            (p.windows.with_commands_moved(rows), p.noise) for p in self.predictors))
        return self._copied('centre_residual', 'with_own_filters', predictors=predictors)

    def _copied(self, *dropped: str, **changed: object) -> Likelihood:
        """Return a copy without some cached properties and with some attributes changed."""
        other = object.__new__(Likelihood)
        other.__dict__.update(
            {k: v for k, v in self.__dict__.items() if k not in dropped}, **changed)
        return other

    @property
    def times(self) -> Array:
        """Return the time of each sample in its own record, s, (N,)."""
        return np.concatenate([p.record.time[p.windows.indices[:, p.windows.warm_up:]].ravel()
                               for p in self.predictors])

    @property
    def period(self) -> float:
        """Return the period of the slowest mode, which is that of the warm-up, s."""
        return self.predictors[0].windows.warm_up * self.base.robot.sample_time

    @property
    def duration(self) -> float:
        """Return the end of the longest record, s."""
        return max(float(p.record.time[-1]) for p in self.predictors)

    def thinned(self, samples: int, busiest: bool = False) -> Likelihood:
        """Return the likelihood of even or of busiest windows, about so many samples in all."""
        sizes = [p.windows.starts.size for p in self.predictors]
        every = -(-sum(sizes) * self.predictors[0].windows.length // samples)
        if every <= 1:
            return self
        of_each = [p.windows.busiest(every) if busiest else evenly(p.windows.starts.size, every)
                   for p in self.predictors]
        chosen = np.concatenate([first + of_record for first, of_record in zip(
            np.cumsum([0, *sizes]), of_each)])
        weight = sum(sizes) / chosen.size
        kept = np.arange(self.centre_residual.shape[-1]).reshape(sum(sizes), -1)[chosen].ravel()
        return self._copied(
            'part_products', 'part_products_by_window', 'channel_log_determinants',
            'with_own_filters',
            predictors=[p.at(some) for p, some in zip(self.predictors, of_each)],
            kept_samples=kept,
            weight=self.weight * weight,
            centre_residual=np.sqrt(weight) * self.centre_residual[:, kept],
            part_jacobian=np.sqrt(weight) * self.part_jacobian[..., kept],
            centre_shift=np.sqrt(weight) * self.centre_shift[:, kept])


def _by_channel(errors: Array) -> Array:
    """Return errors (B, W, length, m) by channel, (B, m, N)."""
    return np.moveaxis(errors.reshape(len(errors), -1, errors.shape[-1]), -1, 1)
