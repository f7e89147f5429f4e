"""
Score rpe on arms that hide an effect and on clean ones: coverage, bands and false jumps.

`python benchmarks/hidden_effects.py [--runs N] [--seed S] [--truth mujoco]` takes arms of the
truths in `test/truth`, parts drawn, in fast motion, none with a change of payload: N clean ones,
and N that hide one effect of the catalogue each, in an order drawn from the seed. The estimator is
not told of the effect. Prints a table in Markdown, with the shares of the samples in motion with
`ok`, and with `ok` and beyond three deviations; with --each also a line per record.
Finite elements from seed 8000 on are for tuning; MuJoCo from 9000 on judges.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from multiprocessing import get_context

import _truths  # noqa: F401
from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
from model_error import rows_of
import numpy as np
from truth.configuration import ROBOTS
from truth.effects import CATALOGUE
from truth.records import build_arm, draw_case, make_record, TruthCase
from truth.tolerances import GOOD, TOLD

TIMES_S = (0.5, 1.0, 2.0, 3.0, 6.0, 10.0, 20.0, 40.0)
SEEDS = {'finite_elements': 8000, 'mujoco': 9000}
# Effects left out: they hide nothing from an estimator that is told no payload, or change the
# quantity that it estimates.
LEFT_OUT = ('payload_mass', 'payload_change', 'modal_truncation', 'coriolis_centripetal')
# Effects that the equations of a truth do not have.
LACKS = {'finite_elements': ('base_sliding', 'payload_beside'), 'mujoco': ()}
CLEAN, HIDDEN = 'clean', 'hidden effect'
# Deviations beyond which an answer is wrong.
BEYOND = 3.0


@dataclass(frozen=True)
class Errors:
    """
    How far off the estimator is on one record.

    Attributes
    ----------
    name : str
        The hidden effect, or CLEAN.
    error, deviation : Array
        Error and stated standard deviation at each of the times, relative to the payload,
        (times,).

    """

    name: str
    error: Array
    deviation: Array

    @property
    def inside(self) -> Array:
        """Return whether the 95 % band holds the payload, (times,)."""
        return np.asarray(np.abs(self.error) < Z95 * self.deviation)


@dataclass(frozen=True)
class Answer(Errors):
    """
    The estimator's result on one record.

    Attributes
    ----------
    jumps : int
        Changes of the payload that the estimator found; all are false.
    mode : str
        Mode in which the estimator ended.
    fine, wrong : float
        Shares of the samples in motion with `ok`, and with `ok` and beyond three deviations.

    """

    jumps: int
    mode: str
    fine: float
    wrong: float


def estimates_of(case: TruthCase, estimator: RecursivePredictionError) -> list[Estimate] | None:
    """Return what an estimator says of a case after each sample; None of an unstable arm."""
    estimator.reset()
    try:
        rows = rows_of(make_record(case))
    except FloatingPointError:
        return None
    return [estimator.update(*row) for row in rows]


def answer(estimator: RecursivePredictionError, name: str | None, seed: int, truth: str,
           times: tuple[float, ...], robot: str = 'reference', spread: str = GOOD,
           excitation: str = 'rich') -> Answer | None:
    """Return the estimator's result on one drawn record; None where the arm is unstable."""
    case = replace(draw_case(name, seed, robot, duration_s=times[-1] + 0.05,
                             excitation=excitation), simulator=truth, spread=spread)
    found = estimates_of(case, estimator)
    if found is None:
        return None
    payload = build_arm(case).payload.mass
    at = np.array([(a.mass - payload, a.variance**0.5) for a in found
                   if np.isclose(a.time, times).any()]) / payload
    moving = [a for a in found if a.status != 'not_excited']
    fine = [abs(a.mass - payload) > BEYOND * a.variance**0.5 for a in moving
            if a.status == 'ok']
    return Answer(name or CLEAN, at[:, 0], at[:, 1], len(estimator.events),
                  estimator.incumbent.mode.name, len(fine) / len(moving), sum(fine) / len(moving))


@lru_cache(maxsize=1)
def estimator_of(modes: int, robot: str) -> RecursivePredictionError:
    """Return the estimator of this process."""
    return RecursivePredictionError(load_robot(robot), 'assumed_modes', modes)


def _answer(one: tuple[int, str | None], modes: int, truth: str, times: tuple[float, ...],
            robot: str, spread: str, excitation: str) -> Answer | None:
    return answer(estimator_of(modes, robot), one[1], one[0], truth, times, robot, spread,
                  excitation)


def effects_of(seed: int, runs: int, truth: str, among: tuple[str, ...]) -> list[str]:
    """Return the names of the effects to hide; each comes once before any comes again."""
    names, random = [name for name in among if name not in LEFT_OUT + LACKS[truth]], \
        np.random.default_rng(seed)
    return [str(name) for _ in range(runs // len(names) + 1)
            for name in random.permutation(names)][:runs]


def line(title: str, answers: list[Answer]) -> str:
    """Return a row: coverage, RMSE and median half width at each time, jumps, `ok`, modes."""
    error, deviation = (np.array([getattr(a, name) for a in answers])
                        for name in ('error', 'deviation'))
    inside, count = np.array([a.inside for a in answers]), len(answers)
    cells = [f'{100 * inside[:, k].mean():.0f} %, {100 * np.sqrt(np.mean(error[:, k]**2)):.1f}, '
             f'±{100 * Z95 * np.median(deviation[:, k]):.1f}' for k in range(error.shape[1])]
    modes = [a.mode for a in answers]
    ends = ', '.join(f'{modes.count(mode)} {mode}' for mode in sorted(set(modes)))
    jumped = sum(a.jumps > 0 for a in answers)
    fine, wrong = (100 * np.mean([getattr(a, name) for a in answers])
                   for name in ('fine', 'wrong'))
    return ' | '.join([f'| {title}', str(count), *cells, str(jumped),
                       f'{fine:.1f}, {wrong:.2f}', f'{ends} |'])


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=33, help='clean, and as many with an effect')
    parser.add_argument('--clean', type=int, help='clean ones, where there are to be fewer')
    parser.add_argument('--seed', type=int, help='first')
    parser.add_argument('--truth', choices=SEEDS, nargs='*', default=tuple(SEEDS))
    parser.add_argument('--until', type=float, default=10.0, help='s')
    parser.add_argument('--modes', type=int, default=3)
    parser.add_argument('--names', choices=CATALOGUE, nargs='*', default=tuple(CATALOGUE),
                        help='what may be hidden')
    parser.add_argument('--robot', choices=ROBOTS, default='reference')
    parser.add_argument('--told', action='store_true', help='parts off by their tolerances')
    parser.add_argument('--gentle', action='store_true',
                        help='a quarter of the strides, in twice the time')
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--each', action='store_true')
    options = parser.parse_args()
    times = tuple(time for time in TIMES_S if time <= options.until)
    print('| arms, each time: in the 95 % band, RMSE, median half width, % | records | '
          + ' | '.join(f'{time:g} s' for time in times)
          + ' | with a false jump | `ok`, `ok` and beyond, % | end in |')
    print('|' + ' --- |' * (len(times) + 5))
    clean = options.runs if options.clean is None else options.clean
    with get_context('spawn').Pool(options.jobs) as pool:
        for truth in options.truth:
            first = SEEDS[truth] if options.seed is None else options.seed
            hidden = effects_of(first, options.runs, truth, tuple(options.names))
            for title, names in ((CLEAN, [None] * clean), (HIDDEN, hidden)):
                answers = []
                for seed, found in enumerate(pool.imap(
                        partial(_answer, modes=options.modes, truth=truth, times=times,
                                robot=options.robot, spread=TOLD if options.told else GOOD,
                                excitation='gentle' if options.gentle else 'rich'),
                        list(enumerate(names, first))), first):
                    if found is None:
                        continue
                    answers.append(found)
                    if options.each:
                        print(f'<!-- {seed} {found.name} '
                              f'{np.round(100 * found.error, 1)} '
                              f'{np.round(100 * found.deviation, 1)} {found.jumps} {found.mode} '
                              f'{100 * found.fine:.0f} {100 * found.wrong:.1f} -->', flush=True)
                if answers:
                    print(line(f'{truth}, {title}', answers), flush=True)


if __name__ == '__main__':
    main()
