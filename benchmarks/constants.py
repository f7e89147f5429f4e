"""
Halve and double the chosen constants of rpe, one at a time, and say what that does to the answer.

`python benchmarks/constants.py [--records N] [--names TRIAL_S ...]` runs the estimator over N
records of 10 s of each of five kinds: of its own model; of MuJoCo arms with parts drawn; of such
arms that hide an effect; of such arms whose payload changes at once; and of its own model with a
disturbed log (outliers, a burst of noise, a gap, a rest). It is told the payload's range alone.
For each constant, halved and doubled, it prints the relative change of the root mean square error
at 3 s and 10 s, how many 95 % bands hold the payload then, how many records have a false change
and how many miss theirs, and in how many records all answers are the same, bit for bit. `*` marks
a difference from the base, on the same records, that chance makes in fewer than one of twenty
such tests (signed ranks of the logarithms of the errors; exact McNemar of bands and changes),
`**` one that stands when all tests are counted (Holm). Of N tests that find nothing, N / 20 have
one star. Nothing is tuned on it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import sys
from types import ModuleType
from typing import Any

from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.interval import Z95
from hidden_changes import TOO_EARLY_S
from mixed_logs import KINDS, Log, logs, MODES, TIMES_S
import numpy as np
from scipy.stats import binomtest, wilcoxon

# The constants by module of the package: those of the sampling grid, of rounding, of what is
# measured (the modes' amplitudes) or of a table's resolution are not among them.
PACKAGE = 'flex_payload_estimator.estimators.rpe'
CONSTANTS = {
    'likelihood': ('MEMORY_S', 'MEMORY_SAMPLES', 'LARGEST_READING', 'PRIOR_READINGS',
                   'NOISE_RATIO', 'POOR_FIT', 'FIRST_SAMPLES', 'FALSE_ALARM_S'),
    'misfit': ('SUSPECT_FACTOR',),
    'score': ('CORRELATION_S', 'PRIOR_S', 'BENDING_SHARE'),
    'transitions': ('CHANGE_FACTOR', 'MODES_OPEN_S', 'FREER_MODE_S', 'TRIAL_S', 'AGAIN_RATIO'),
    'competition': ('WALK_S', 'RANGE_DEVIATIONS', 'WINDOW_S', 'CONSTANT_S', 'SAME_CHANGE_S'),
    'trial': ('SETTLING_S',),
    'start': ('SAME_LINEARISATION', 'SAME_SHARE', 'GIVE_UP_NATS', 'RECENT_S'),
    'restarts': ('RESTART_PAYLOAD_STD', 'RESTART_STATE_STD', 'RESTART_DEVIATIONS', 'PASSES'),
    'window_pass': ('SAMPLES_PER_STEP', 'FIRST_PASS_S'),
    'outliers': ('RELOCATED_SAMPLES', 'LOST_STATE_NATS'),
    'filter_step': ('PERSISTENT_ERROR', 'PAYLOAD_CELLS'),
    'estimator': ('STAMP_SHARE', 'REST_DRIFT', 'LONGEST_GAP_S'),
    'events': ('DEVIATIONS', 'SHARE'),
    'excitation': ('EXCITED_STD', 'EXCITED_S'),
    'first_sample': ('LEAP',),
    'prior': ('SHARE_STD', 'BIAS_STD', 'FARTHEST'),
    'far_part': ('FAR_ODDS',),
    'sensors': ('LOAD_MEMORY_S', 'START_BEND', 'START_ANGLE', 'START_SPEED'),
    'schedule': ('SOFT_SHARE',)}
FACTORS = (0.5, 2.0)
FIRST_SEED = 31000
# A test with less than this probability has a star; an error that changes by less than this, a
# share of itself, counts as the same.
RARE, ALIKE = 0.05, 1e-3


@dataclass(frozen=True)
class Answer:
    """
    What the estimator says of a record.

    Attributes
    ----------
    track : Array
        Payload and variance after each sample, (N, 2).
    statuses : tuple of str
        The status then.
    error, deviation : Array
        Error and stated standard deviation over the payload, at TIMES_S.
    false, missed : bool
        Whether a change was told that is none, and whether the true one was not.

    """

    track: Array
    statuses: tuple[str, ...]
    error: Array
    deviation: Array
    false: bool
    missed: bool

    @property
    def inside(self) -> Array:
        """Return whether the 95 % band holds the payload, at TIMES_S."""
        return np.asarray(np.abs(self.error) < Z95 * self.deviation)


def answers(records: Sequence[Log]) -> list[Answer]:
    """Return what a new estimator says of each record."""
    estimator, found = RecursivePredictionError(load_robot('reference'), 'assumed_modes',
                                                MODES), []
    for record in records:
        estimator.reset()
        told = [estimator.update(*row) for row in record.rows]
        every = np.array([(a.mass, a.variance) for a in told])
        time = np.array([row[0] for row in record.rows])
        late = every[[int(np.argmin(np.abs(time - t))) for t in TIMES_S]]
        first = np.inf if record.at is None else record.at - TOO_EARLY_S
        true = [event.time >= first for event in estimator.events]
        found.append(Answer(every, tuple(a.status for a in told), late[:, 0] / record.mass - 1.0,
                            np.sqrt(late[:, 1]) / record.mass, not all(true),
                            record.at is not None and not any(true)))
    return found


def modules() -> dict[str, ModuleType]:
    """Return the modules of rpe that are loaded, by name."""
    return {name: module for name, module in list(sys.modules.items())
            if name.startswith(PACKAGE) and module is not None}


def compiled_with(name: str, holders: Sequence[ModuleType]) -> list[Any]:
    """Return the compiled functions that a constant is part of, also by way of others."""
    every: dict[int, Any] = {}
    for module in modules().values():
        every |= {id(f): f for f in vars(module).values() if hasattr(f, 'py_func')}
    spaces, reached = [vars(module) for module in holders], dict[int, Any]()
    while True:
        more = {key: f for key, f in every.items() if key not in reached and any(
            called == name and any(f.py_func.__globals__ is space for space in spaces)
            or id(f.py_func.__globals__.get(called)) in reached
            for called in f.py_func.__code__.co_names)}
        if not more:
            return list(reached.values())
        reached |= more


@contextmanager
def patched(module: str, name: str, value: float) -> Iterator[None]:
    """
    Give a constant another value, in each module that has it by its name.

    What is compiled with it is compiled anew, beside the cache on disk. What is kept between
    estimators is forgotten, before and after.
    """
    loaded = modules()
    former = getattr(loaded[f'{PACKAGE}.{module}'], name)
    holders = [m for m in loaded.values() if vars(m).get(name) is former]
    changed: list[tuple[ModuleType, str, Any]] = [(m, name, former) for m in holders]
    fresh = {}
    if COMPILED:
        from numba import njit
        fresh = {id(f): njit(f.py_func) for f in compiled_with(name, holders)}
    changed += [(m, key, f) for m in loaded.values() for key, f in vars(m).items()
                if id(f) in fresh]
    try:
        for holder, key, old in changed:
            setattr(holder, key, fresh.get(id(old), value))
        forget()
        yield
    finally:
        for holder, key, old in changed:
            setattr(holder, key, old)
        forget()


def forget() -> None:
    """Clear what the functions of rpe keep."""
    for module in modules().values():
        for kept in vars(module).values():
            if hasattr(kept, 'cache_clear'):
                kept.cache_clear()


def changed_value(value: float, factor: float) -> float:
    """Return the value times a factor; an integer stays one and at least 1."""
    return max(1, round(value * factor)) if isinstance(value, int) else value * factor


def mcnemar(before: Array, after: Array) -> float:
    """Return the exact probability that chance makes two lists of yes and no differ so."""
    more, less = int(np.sum(after > before)), int(np.sum(before > after))
    return float(binomtest(more, more + less).pvalue) if more + less else 1.0


def signed_ranks(before: Array, after: Array) -> float:
    """Return the probability that chance makes paired errors differ so."""
    ratio = np.log(np.maximum(np.abs(after), 1e-12) / np.maximum(np.abs(before), 1e-12))
    ratio = ratio[np.abs(ratio) > ALIKE]
    return float(wilcoxon(ratio).pvalue) if ratio.size else 1.0


@dataclass(frozen=True)
class Variant:
    """A constant's value, what it does (a line), and the probabilities of its tests."""

    name: str
    text: str
    chances: tuple[float, ...]
    same: bool


def summary(found: Sequence[Answer]) -> tuple[Array, ...]:
    """Return errors, bands (records, times), false and missed changes, (records,)."""
    return (np.array([a.error for a in found]), np.array([a.inside for a in found]),
            np.array([a.false for a in found]), np.array([a.missed for a in found]))


def compare(name: str, value: float, base: Sequence[Answer], found: Sequence[Answer]) -> Variant:
    """Return how a variant differs from the base."""
    error_0, inside_0, false_0, missed_0 = summary(base)
    error, inside, false, missed = summary(found)
    same = sum(np.array_equal(a.track, b.track) and (a.statuses, a.false, a.missed) == (
        b.statuses, b.false, b.missed) for a, b in zip(base, found))
    change = 100.0 * (np.sqrt(np.mean(error**2, axis=0) / np.mean(error_0**2, axis=0)) - 1.0)
    chances = (*(signed_ranks(error_0[:, k], error[:, k]) for k in range(len(TIMES_S))),
               *(mcnemar(inside_0[:, k], inside[:, k]) for k in range(len(TIMES_S))),
               mcnemar(false_0, false), mcnemar(missed_0, missed))
    cells = ' '.join(f'{c:+8.1f}' for c in change) + ''.join(
        f'{count:5d}' for count in (*inside.sum(axis=0), false.sum(), missed.sum(), same))
    return Variant(name, f'{name:20s}{value:10.4g} {cells}', chances, same == len(base))


def standing(variants: Sequence[Variant]) -> set[int]:
    """Return which variants differ when all tests are counted (Holm 1979)."""
    every = sorted((chance, place) for place, variant in enumerate(variants)
                   for chance in variant.chances)
    kept = set()
    for rank, (chance, place) in enumerate(every):
        if chance > RARE / (len(every) - rank):
            break
        kept.add(place)
    return kept


def study(records: Sequence[Log], names: Sequence[str]) -> list[Variant]:
    """Return, and print as they come, the variants of the named constants."""
    base = answers(records)
    error, inside, false, missed = summary(base)
    rmse = 100.0 * np.sqrt(np.mean(error**2, axis=0))
    print(f'{"base, RMSE in %":30s} ' + ' '.join(f'{r:8.2f}' for r in rmse) + ''.join(
        f'{count:5d}' for count in (*inside.sum(axis=0), false.sum(), missed.sum(), len(base))),
        flush=True)
    variants = []
    for module, constants in CONSTANTS.items():
        for name in constants:
            if f'{module}.{name}' not in names and name not in names:
                continue
            value = getattr(sys.modules[f'{PACKAGE}.{module}'], name)
            print(f'{module}.{name} = {value:g}')
            for factor in FACTORS:
                tried = changed_value(value, factor)
                with patched(module, name, tried):
                    variants.append(compare(name, tried, base, answers(records)))
                star = ' *' if min(variants[-1].chances) < RARE else ''
                print(f'{variants[-1].text}{star}', flush=True)
    return variants


def main() -> None:
    """Run and print."""
    every = [name for constants in CONSTANTS.values() for name in constants]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--records', type=int, default=3, help='of each kind')
    parser.add_argument('--seed', type=int, default=FIRST_SEED, help='first')
    parser.add_argument('--kinds', choices=KINDS, nargs='*', default=KINDS)
    parser.add_argument('--truth', choices=('mujoco', 'finite_elements'), default='mujoco')
    parser.add_argument('--names', choices=every, nargs='*', default=every)
    options = parser.parse_args()
    print(f'{"":30s} {"RMSE, change in %":>17s}{"in 95 %":>10s}{"false":>5s} miss same\n'
          f'{"constant":20s}{"value":>10s} ' + ' '.join(f'{t:6g} s' for t in TIMES_S)
          + ''.join(f'{t:3g} s' for t in TIMES_S))
    variants = study(logs(options.records, options.seed, options.kinds, options.truth),
                     options.names)
    stand = standing(variants)
    tests = [chance for variant in variants for chance in variant.chances]
    print(f'tests {len(tests)}, with a star {sum(c < RARE for c in tests)}; ** '
          + (', '.join(variants[k].text[:30] for k in sorted(stand)) or 'none'))
    idle = [name for name in dict.fromkeys(v.name for v in variants)
            if all(v.same for v in variants if v.name == name)]
    print('nothing changes, bit for bit: ' + (', '.join(idle) or 'none'))


if __name__ == '__main__':
    main()
