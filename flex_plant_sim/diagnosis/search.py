"""The search for causes: is anything wrong, what explains it, what else, what is left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from multiprocessing import get_context

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.allowance import allowance, misfit
from flex_plant_sim.diagnosis.fit import Fit, fit_base, fit_hypothesis, refit
from flex_plant_sim.diagnosis.hypothesis import hypotheses, Hypothesis
from flex_plant_sim.diagnosis.noise import measurement_noise
from flex_plant_sim.diagnosis.predictor import Base
from flex_plant_sim.diagnosis.problem import Problem
from flex_plant_sim.diagnosis.ranking import choose, rank, Ranked
from flex_plant_sim.diagnosis.windows import Record, Windows
import numpy as np

ROUNDS = 4
WRONG = 1.0

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Data:
    """Windows to work on, windows locked for the figures, sensor noise; one each per record."""

    windows: tuple[Windows, ...]
    locked: tuple[Windows, ...]
    noise: tuple[Array, ...]
    allowed: Array

    @classmethod
    def of(cls, records: Sequence[Record], base: Base) -> Data:
        """Cut the records by the slowest mode of the base."""
        slowest = slowest_frequency(base, records[0].payload)
        pairs = [Windows.cut(r, slowest, base.robot.sample_time) for r in records]
        noise = tuple(measurement_noise(r.output) for r in records)
        return cls(tuple(p[0] for p in pairs), tuple(p[1] for p in pairs), noise,
                   allowance(records, noise))

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


@dataclass(frozen=True)
class Search:
    """
    The search's whole course.

    Attributes
    ----------
    nominal, extended : Base
    rounds : tuple of Round
    accepted : tuple of Ranked
        Refitted around themselves.
    before, after : Array
        Misfit of the nominal and of the extended base in allowances per channel, (m,).
    final : Problem
        Around the extended base.

    """

    nominal: Base
    extended: Base
    rounds: tuple[Round, ...]
    accepted: tuple[Ranked, ...]
    before: Array
    after: Array
    final: Problem


def slowest_frequency(base: Base, payload: float) -> float:
    """Return the slowest natural frequency with locked joints, stretched arm, rad/s."""
    form = base.arm(payload).form
    flexible = slice(2, 2 + 2 * base.modes)
    ratio = np.linalg.solve(form.mass_at(1.0, payload)[flexible, flexible],
                            form.stiffness_at(1.0)[flexible, flexible])
    return float(np.sqrt(np.min(np.linalg.eigvals(ratio).real)))


def search(data: Data, nominal: Base, jobs: int, progress: Progress,
           exclude: Sequence[str] = ()) -> Search:
    """
    Return the course of a search: add the cause that helps most until nothing wrong is left.

    Parameters
    ----------
    data : Data
    nominal : Base
    jobs : int
        Processes.
    progress : Callable
        Told a step's name and its share done.
    exclude : sequence of str
        Identifiers to leave out of the catalogue.

    """
    base, rounds, accepted = nominal, [], []
    problem = Problem(base, data.windows, data.noise)
    fitted = fit_base(problem)
    before = after = misfit(fitted.residual, data.noise, data.allowed)
    while after.max() > WRONG and len(rounds) < ROUNDS:
        known = {r.hypothesis for r in accepted}
        trial = [h for h in hypotheses(base.robot, exclude) if h not in known
                 and not any(h.effect is type(e) for e in nominal.effects)]
        step = f'round {len(rounds) + 1}'
        fits = _fit_all(problem, trial, fitted, data.duration, jobs,
                        lambda share, step=step: progress(step, share))
        ranked = rank(fits, fitted, data.noise, data.allowed)
        chosen = choose(ranked)
        rounds.append(Round(fitted, tuple(ranked), chosen))
        if chosen is None:
            break
        accepted.append(_refitted(problem, chosen, fitted, data))
        base = extend(nominal, accepted)
        problem = Problem(base, data.windows, data.noise)
        fitted = fit_base(problem)
        after = misfit(fitted.residual, data.noise, data.allowed)
    if len(accepted) > 1:
        accepted = _still_needed(nominal, accepted, data)
        base = extend(nominal, accepted)
        problem = Problem(base, data.windows, data.noise)
        after = misfit(fit_base(problem).residual, data.noise, data.allowed)
    return Search(nominal, base, tuple(rounds), tuple(accepted), before, after, problem)


def extend(nominal: Base, accepted: Sequence[Ranked]) -> Base:
    """Return the base with the accepted effects at their fitted values."""
    return replace(nominal, effects=(*nominal.effects, *(
        r.hypothesis.at(r.fit.values) for r in accepted)))


def _refitted(problem: Problem, ranked: Ranked, base: Fit, data: Data) -> Ranked:
    """Return the fit again, base parameters linearised with the effect on."""
    effect = ranked.hypothesis.at(ranked.fit.values)
    around = Problem(problem.base, data.windows, data.noise, around=(effect,))
    fit = refit(around, ranked.fit)
    return rank([fit], base, data.noise, data.allowed)[0]


def _still_needed(nominal: Base, accepted: Sequence[Ranked], data: Data) -> list[Ranked]:
    """Return the accepted effects that the others do not make superfluous, refitted jointly."""
    kept = list(accepted)
    for ranked in accepted:
        others = [r for r in kept if r is not ranked]
        problem = Problem(extend(nominal, others), data.windows, data.noise)
        fitted = fit_base(problem)
        again = _refitted(problem, ranked, fitted, data)
        place = kept.index(ranked)
        kept[place:place + 1] = [again] if again.relevant else []
    return kept


def _fit_all(problem: Problem, trial: Sequence[Hypothesis], fitted: Fit, duration: float,
             jobs: int, progress: Callable[[float], None]) -> list[Fit]:
    """Return the fits that succeed, in the order of the hypotheses."""
    task = _Task(problem, fitted, duration)
    fits, done = [], 0
    if jobs <= 1:
        results = map(task, trial)
        pool = None
    else:
        pool = get_context('fork').Pool(jobs, initializer=_remember, initargs=(task,))
        results = pool.imap(_run, trial)
    try:
        for fit in results:
            done += 1
            progress(done / len(trial))
            fits += [fit] if fit is not None else []
    finally:
        if pool is not None:
            pool.terminate()
    return fits


@dataclass(frozen=True)
class _Task:
    problem: Problem
    fitted: Fit
    duration: float

    def __call__(self, hypothesis: Hypothesis) -> Fit | None:
        try:
            fit = fit_hypothesis(self.problem, hypothesis, self.fitted.weighting, self.duration)
        except (np.linalg.LinAlgError, FloatingPointError):
            return None
        return fit if np.all(np.isfinite(fit.residual)) else None


_worker: list[_Task] = []


def _remember(task: _Task) -> None:
    _worker[:] = [task]


def _run(hypothesis: Hypothesis) -> Fit | None:
    return _worker[0](hypothesis)
