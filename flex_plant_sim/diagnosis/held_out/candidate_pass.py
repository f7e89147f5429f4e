"""One pass through candidates: all of them fitted, on one problem, and what is chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.pool import each
from flex_plant_sim.diagnosis.held_out.allowance import allowance, misfit, still_wrong
from flex_plant_sim.diagnosis.held_out.fit import (
    explore,
    Fit,
    fit_base,
    Projector,
    Promise,
    promise,
    refine,
)
from flex_plant_sim.diagnosis.held_out.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.held_out.problem import Problem
from flex_plant_sim.diagnosis.held_out.ranking import choose, rank, Ranked
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.record.sensor_noise import measurement_noise
from flex_plant_sim.diagnosis.record.windows import Record, Windows
import numpy as np

FIT_SAMPLES, PROMISE_SAMPLES = 12000, 6000
FEWEST_EXPLORED, WORTH_EXPLORING = 12, 0.1
FEWEST_REFINED, WORTH_REFINING = 3, 0.5
RIVAL, MOST_RIVALS = 0.3, 7


@dataclass(frozen=True)
class Data:
    """Windows to work on, windows locked for the figures, sensor noise; one each per record."""

    windows: tuple[Windows, ...]
    locked: tuple[Windows, ...]
    noise: tuple[Array, ...]
    allowed: Array

    @classmethod
    def of(cls, records: Sequence[Record], base: Base) -> Data:
        """Cut the records by the slowest mode of the base; of long ones, take some windows."""
        slowest = slowest_frequency(base, records[0].payload)
        pairs = [Windows.cut(r, slowest, base.robot.sample_time) for r in records]
        noise = tuple(measurement_noise(r.output) for r in records)
        scored = sum(work.starts.size * work.length for work, _ in pairs)
        every = -(-scored // FIT_SAMPLES)
        return cls(tuple(work.thinned(every) for work, _ in pairs),
                   tuple(locked for _, locked in pairs), noise, allowance(records, noise))

    @property
    def duration(self) -> float:
        """Return the end of the longest record, s."""
        return max(float(w.record.time[-1]) for w in self.windows)


@dataclass(frozen=True)
class Round:
    """One pass through the catalogue: the base's fit, all ranked fits, and what was chosen."""

    base: Fit
    ranked: tuple[Ranked, ...]
    chosen: Ranked | None


def slowest_frequency(base: Base, payload: float) -> float:
    """Return the slowest natural frequency with locked joints, stretched arm, rad/s."""
    form = base.arm(payload).form
    flexible = slice(2, 2 + 2 * base.modes)
    ratio = np.linalg.solve(form.mass_at(1.0, payload)[flexible, flexible],
                            form.stiffness_at(1.0)[flexible, flexible])
    return float(np.sqrt(np.min(np.linalg.eigvals(ratio).real)))


def one_pass(problem: Problem, fitted: Fit, trial: Sequence[Hypothesis], data: Data, jobs: int,
             progress: Callable[[float], None] = lambda share: None) -> Round:
    """Return all hypotheses of a trial ranked around a problem and its fit, and what is chosen."""
    ranked = _fit_all(problem, trial, fitted, data, jobs, progress)
    return Round(fitted, tuple(ranked), choose(ranked))


def decided(problem: Problem, found: Round, data: Data, jobs: int) -> tuple[Problem, Round]:
    """
    Return a round, and the problem it stands on, decided anew where it leaves nothing wrong.

    What its best leaves is model error then, and a predictor that judges compares the leading
    ones. While much is wrong it would not do: it takes slow errors for errors of the gauges.
    """
    if found.chosen is None:
        return problem, found
    start = misfit(found.base.residual, data.noise, data.allowed)
    if still_wrong(start, found.chosen.misfit).any():
        return problem, found
    judge = Problem(problem.base, data.windows, data.noise, judging=True)
    again = one_pass(judge, fit_base(judge), rivals(found), data, jobs)
    return (problem, found) if again.chosen is None else (judge, again)


def rivals(found: Round) -> list[Hypothesis]:
    """Return the few hypotheses that explained nearly as much as the one chosen, and that one."""
    assert found.chosen is not None
    near = [r.hypothesis for r in found.ranked
            if r.relevant and r.gain > RIVAL * found.chosen.gain]
    return list(dict.fromkeys([found.chosen.hypothesis, *near]))[:1 + MOST_RIVALS]


def _fit_all(problem: Problem, trial: Sequence[Hypothesis], fitted: Fit, data: Data, jobs: int,
             progress: Callable[[float], None]) -> list[Ranked]:
    """
    Return the hypotheses that could explain something, ranked.

    All are tried at all their starts; those that promise a share of the best get a first fit, of
    which the leading ones are carried to the end. None is left out for a local score.
    """
    projector = Projector(problem, fitted.weighting)
    some = problem.thinned(PROMISE_SAMPLES)
    judge = _Promise(some, Projector(some, fitted.weighting), data.duration)
    promises = sorted(each(judge, trial, jobs, lambda share: progress(0.4 * share)),
                      key=lambda p: -p.gain)
    worth = [p for k, p in enumerate(promises)
             if k < FEWEST_EXPLORED or p.gain > WORTH_EXPLORING * promises[0].gain]
    fits = each(_Explore(problem, projector), worth, jobs,
                lambda share: progress(0.4 + 0.3 * share))
    first = rank(_joined(fits, problem), fitted, data.noise, data.allowed)
    leading = [r.fit for k, r in enumerate(first)
               if k < FEWEST_REFINED or r.gain > WORTH_REFINING * first[0].gain]
    refined = _joined(each(_Refine(problem), [_alone(f) for f in leading], jobs,
                           lambda share: progress(0.7 + 0.3 * share)), problem)
    rest = [r.fit for r in first[len(leading):]]
    return rank([*refined, *rest], fitted, data.noise, data.allowed)


@dataclass(frozen=True)
class _Promise:
    problem: Problem
    projector: Projector
    duration: float

    def __call__(self, hypothesis: Hypothesis) -> Promise:
        return promise(self.problem, hypothesis, self.projector, self.duration)


@dataclass(frozen=True)
class _Explore:
    problem: Problem
    projector: Projector

    def __call__(self, promised: Promise) -> Fit:
        return _alone(explore(self.problem, promised, self.projector))


@dataclass(frozen=True)
class _Refine:
    problem: Problem

    def __call__(self, fit: Fit) -> Fit:
        return _alone(refine(self.problem, fit))


def _alone(fit: Fit) -> Fit:
    """Return a fit without the problem's sensitivity, to be sent between processes."""
    return replace(fit, sensitivity=np.zeros(0))


def _joined(fits: Sequence[Fit], problem: Problem) -> list[Fit]:
    """Return fits with the problem's own sensitivity, one array for all."""
    return [replace(fit, sensitivity=problem.sensitivity) for fit in fits]
