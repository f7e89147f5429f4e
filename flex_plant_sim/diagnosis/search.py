"""The search for causes: is anything wrong, what explains it, what else, what is left."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
import signal
from typing import Any, TypeVar

from flex_plant_sim.arm_model import Array
from flex_plant_sim.diagnosis.allowance import allowance, misfit, MODEL_SHARE
from flex_plant_sim.diagnosis.fit import (
    explore,
    Fit,
    fit_base,
    Projector,
    Promise,
    promise,
    refine,
    settle,
)
from flex_plant_sim.diagnosis.hypothesis import hypotheses, Hypothesis
from flex_plant_sim.diagnosis.noise import measurement_noise
from flex_plant_sim.diagnosis.noise_level import likeliest_level
from flex_plant_sim.diagnosis.predictor import Base
from flex_plant_sim.diagnosis.problem import Problem
from flex_plant_sim.diagnosis.ranking import choose, clear_of_null, rank, Ranked
from flex_plant_sim.diagnosis.windows import Record, Windows
import numpy as np

ROUNDS = 6
LEFT = 0.5
WRONG = 1.0
FIT_SAMPLES, PROMISE_SAMPLES = 12000, 6000
FEWEST_EXPLORED, WORTH_EXPLORING = 12, 0.1
FEWEST_REFINED, WORTH_REFINING = 3, 0.5

Progress = Callable[[str, float], None]
Found = TypeVar('Found')


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

    It runs in `jobs` processes, tells `progress` a step's name and its share done, and leaves the
    identifiers in `exclude` out of the catalogue.
    """
    rounds: list[Round] = []
    accepted: list[Ranked] = []
    raised = False
    problem, fitted = settle(nominal, data.windows, data.noise)
    before = after = misfit(fitted.residual, data.noise, data.allowed)
    while still_wrong(before, after).any() and len(rounds) < ROUNDS:
        known = {r.chosen.hypothesis for r in rounds if r.chosen is not None}
        trial = [h for h in hypotheses(nominal.robot, exclude) if h not in known
                 and not any(h.effect is type(e) for e in nominal.effects)]
        told = partial(progress, f'round {len(rounds) + 1}')
        around, found = _round(problem, fitted, trial, data, jobs, told, raised)
        raised = around.base.level != nominal.level
        rounds.append(found)
        if found.chosen is None:
            break
        refitted = _refitted(around, found.chosen, found.base, data)
        grown = [*accepted, refitted]
        if accepted:
            if not (refitted.share_explained > LEFT or clear_of_null(refitted)):
                continue
            grown = _still_needed(around.base, nominal, grown, data)
            if _more_wrong(around.base, nominal, grown, found.base, data):
                continue
        accepted = grown
        problem, fitted = settle(_extended(around.base, nominal, grown), data.windows, data.noise)
        after = misfit(fitted.residual, data.noise, data.allowed)
    return Search(nominal, _estimated(problem, fitted), tuple(rounds), tuple(accepted), before,
                  after, problem)


def _round(problem: Problem, fitted: Fit, trial: Sequence[Hypothesis], data: Data, jobs: int,
           progress: Callable[[float], None], raised: bool) -> tuple[Problem, Round]:
    """
    Return one pass through the catalogue, and the problem it was decided on.

    The process noise of a good model tells causes apart best. Where no cause explains most of
    what is wrong with it, it is re-estimated; so it is at once where it was before (`raised`).
    """
    found = None if raised else _pass(problem, fitted, trial, data, jobs, progress)
    if found is not None and found.chosen is not None and found.chosen.share_left < LEFT:
        return problem, found
    level = likeliest_level(problem.base, data.windows, data.noise)
    if found is not None and level == problem.base.level:
        return problem, found
    noisier, refitted = settle(replace(problem.base, level=level), data.windows, data.noise)
    again = _pass(noisier, refitted, trial, data, jobs, progress)
    if found is not None and again.chosen is None:
        return problem, found
    return noisier, again


def _pass(problem: Problem, fitted: Fit, trial: Sequence[Hypothesis], data: Data, jobs: int,
          progress: Callable[[float], None]) -> Round:
    ranked = _fit_all(problem, trial, fitted, data, jobs, progress)
    return Round(fitted, tuple(ranked), choose(ranked))


def _estimated(problem: Problem, fitted: Fit) -> Base:
    """Return the base with its parameters where the fit has them, if they moved at all."""
    if not problem.base.deviations:
        return problem.base
    kept = [value if item.settles else 0.0
            for item, value in zip(problem.nuisances, fitted.nuisance)]
    return replace(problem.base, deviations=tuple(map(float, kept)))


def _more_wrong(base: Base, nominal: Base, grown: Sequence[Ranked], before: Fit,
                data: Data) -> bool:
    """Tell whether effects leave more wrong, at the base's process noise, than its fit before."""
    extended = replace(_extended(base, nominal, grown), level=base.level)
    _, after = settle(extended, data.windows, data.noise)
    # Misfits below an allowance count alike.
    left = [np.maximum(misfit(fit.residual, data.noise, data.allowed), WRONG)
            for fit in (before, after)]
    return bool(np.sum(np.log(left[1])) > np.sum(np.log(left[0])))


def still_wrong(before: Array, after: Array) -> Array:
    """
    Return which channels miss more than an allowance and a hundredth of what was missed, (m,).

    A well-named cause is itself modelled to about one percent.
    """
    return np.asarray(after > WRONG + MODEL_SHARE * np.where(after < before, before, 0.0))


def _extended(base: Base, nominal: Base, accepted: Sequence[Ranked]) -> Base:
    """Return the base with the nominal level and effects, and those accepted as fitted."""
    return replace(base, level=nominal.level, effects=(*nominal.effects, *(
        r.hypothesis.at(r.fit.values) for r in accepted)))


def _refitted(problem: Problem, ranked: Ranked, base: Fit, data: Data) -> Ranked:
    """Return the fit again, base parameters linearised with the effect on."""
    effect = ranked.hypothesis.at(ranked.fit.values)
    around = Problem(problem.base, data.windows, data.noise, around=(effect,))
    fit = refine(around, ranked.fit)
    return rank([fit], base, data.noise, data.allowed)[0]


def _still_needed(base: Base, nominal: Base, accepted: Sequence[Ranked],
                  data: Data) -> list[Ranked]:
    """Return the accepted effects that the others do not make superfluous, refitted jointly."""
    kept = list(accepted)
    for ranked in accepted:
        others = [r for r in kept if r is not ranked]
        without = replace(_extended(base, nominal, others), level=base.level)
        problem = Problem(without, data.windows, data.noise)
        fitted = fit_base(problem)
        again = _refitted(problem, ranked, fitted, data)
        place = kept.index(ranked)
        kept[place:place + 1] = [again] if again.relevant else []
    return kept


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
    promises = sorted(_each(judge, trial, jobs, lambda share: progress(0.4 * share)),
                      key=lambda p: -p.gain)
    worth = [p for k, p in enumerate(promises)
             if k < FEWEST_EXPLORED or p.gain > WORTH_EXPLORING * promises[0].gain]
    fits = _each(_Explore(problem, projector), worth, jobs,
                 lambda share: progress(0.4 + 0.3 * share))
    first = rank(_joined(fits, problem), fitted, data.noise, data.allowed)
    leading = [r.fit for k, r in enumerate(first)
               if k < FEWEST_REFINED or r.gain > WORTH_REFINING * first[0].gain]
    refined = _joined(_each(_Refine(problem), [_alone(f) for f in leading], jobs,
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


def _each(task: Callable[[Any], Found], items: Sequence[Any], jobs: int,
          progress: Callable[[float], None]) -> list[Found]:
    """Return what the task finds where it succeeds, in the order of the items."""
    found: list[Found] = []
    with ExitStack() as stack:
        if jobs <= 1:
            results: Iterable[Found | None] = map(partial(_attempt, task), items)
        else:
            with _interrupts_held():
                pool = stack.enter_context(get_context('fork').Pool(
                    jobs, initializer=_remember, initargs=(task,)))
            results = pool.imap(_run, items)
        for done, result in enumerate(results, start=1):
            progress(done / len(items))
            found += [result] if result is not None else []
    return found


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while workers start, who never get it: one in a fork would be lost."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _attempt(task: Callable[[Any], Found], item: Any) -> Found | None:
    """Return what the task finds, or None where the hypothesis makes no finite prediction."""
    try:
        return task(item)
    except np.linalg.LinAlgError:
        return None


# The pool's own copy of the task: set once in each worker process, so that the problem is
# inherited and not sent with every hypothesis.
_worker: list[Callable[[Any], Any]] = []


def _remember(task: Callable[[Any], Any]) -> None:
    _worker[:] = [task]


def _run(item: Any) -> Any:
    return _attempt(_worker[0], item)
