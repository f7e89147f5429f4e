"""
Halve and double the chosen constants of the diagnosis, one at a time, and say what that changes.

`python benchmarks/diagnosis_constants.py [--names MAX_RUNS ...] [--cases TEXT ...]` runs
flex_diagnose on a few records of the bank of hidden effects, on seeds that never score. For each
constant, halved and doubled, it prints a cell a record: `=` where the answer is the same, else
what is not: `v` the verdict, `n` the names, `p` a probability by more than 0.02 (with the largest
change), `s` a size by more than a tenth of its 95 % interval. Last stand the run time over the
base's, and how many records have the same answer. Detection limits are left out, a third of the
time. Nothing is tuned on it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import math
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
import time
from unittest.mock import patch

import _truths  # noqa: F401
from bank.cases import all_cases, BankCase, FIRST_SEED
from bank.records import write_record
from bank.sizes import read_limits, sized_truth
from flex_payload_estimator.tools.diagnose import options, read_logs, run
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.verdict import verdict
from flex_plant_sim.diagnosis.verdict.results import Diagnosis

PACKAGE = 'flex_plant_sim.diagnosis'
# The constants by module: those that are derived, measured or read off a record, the resolution of
# tables and pictures, and budgets of time are not among them. Beside each stands the neutral value
# from which it is measured.
CONSTANTS: dict[str, dict[str, float]] = {
    'causes.fit': {'NOTABLE_EXCESS': 1.0},
    'causes.search_state': {'MAX_DEFICIT': 0.0},
    'causes.gauss_newton': {'MIN_STEP_GAIN': 0.0},
    'causes.neighbours': {'MAX_COARSE_DEFICIT': 0.0, 'MIN_ALTERNATIVE_SHARE': 0.0},
    'causes.refined_fit': {'LINEARISATION_ERROR': 0.0, 'PARTS_LEVEL': 0.0,
                           'GAIN_UNCERTAINTY': 0.0},
    'causes.free_run_ranking': {'MAX_RUNS': 0},
    'prediction.law': {'RIDGE_WEIGHT': 0.0, 'MIN_EXPLAINED_SHARE': 0.0},
    'prediction.latent_series': {'REST_SPEED_SHARE': 0.0}}
FACTORS = (0.5, 2.0)
# Calibration cases of different kinds that take little time, by their keys.
CASES = ('clean/nothing/finite_elements/reference/1000',
         'one/coulomb_friction/finite_elements/x4/reference/1107',
         'one/payload_change/mujoco/x1/reference/1133',
         'missing/coulomb_friction/finite_elements/x4/reference/1031',
         'missing/torque_ripple/mujoco/x4/reference/1001')
# Changes that count: of a probability, and of a size as a share of its interval.
PROBABILITY, SHARE = 0.02, 0.1


@dataclass(frozen=True)
class Answer:
    """A diagnosis, and the time that it took, s."""

    diagnosis: Diagnosis
    seconds: float

    @property
    def sizes(self) -> dict[str, tuple[float, float]]:
        """Return each value of each cause and the length of its interval, by name."""
        return {f'{cause.name}:{cause.site}:{p.name}': (p.value, p.high - p.low)
                for cause in self.diagnosis.causes for p in cause.parameters}


def calibration_cases(texts: Sequence[str]) -> list[BankCase]:
    """Return the calibration cases whose key contains one of the texts."""
    drawn = list(all_cases('calibration', 10))
    assert all(case.seed < FIRST_SEED['scoring'] for case in drawn)
    return [case for text in texts for case in drawn if text in case.key]


def answer(case: BankCase, folder: Path) -> Answer:
    """Return what flex_diagnose says of a case; its record is made once."""
    path, limits = folder / f'{case.seed}.csv', read_limits()[case.robot]
    truth, _ = sized_truth(case, limits)
    if not path.exists():
        write_record(case, truth, path)
    arguments = options().parse_args([
        str(path), '--robot', case.robot, '--payload', f'{truth.payload_told:.9g}', '--jobs', '1',
        *case.options])
    robot = load_robot(arguments.robot)
    logs = read_logs(arguments.log, robot, arguments.model, arguments.modes,
                     not arguments.no_coriolis)
    started = time.process_time()
    found = run(logs, robot, arguments, lambda label, share: None)
    return Answer(found.diagnosis, time.process_time() - started)


@contextmanager
def patched(module: str, name: str, value: float) -> Iterator[None]:
    """Give a constant another value, in each module that has it by its name."""
    loaded = [m for key, m in list(sys.modules.items()) if key.startswith('flex_')]
    former = getattr(sys.modules[f'{PACKAGE}.{module}'], name)
    holders = [m for m in loaded if vars(m).get(name) is former]
    try:
        for holder in holders:
            setattr(holder, name, value)
        yield
    finally:
        for holder in holders:
            setattr(holder, name, former)


def changed_value(value: float, neutral: float, factor: float) -> float:
    """Return the value with its difference from the neutral one times a factor."""
    changed = neutral + factor * (value - neutral)
    return round(changed) if isinstance(value, int) else changed


def difference(before: Answer, after: Answer) -> str:
    """Return in letters what is not the same, see above."""
    old, new = before.diagnosis, after.diagnosis
    change = max((abs(float(p) - old.effects.get(name, 0.0)) for name, p in new.effects.items()),
                 default=0.0)
    moved = [abs(value - before.sizes[name][0]) > SHARE * before.sizes[name][1]
             for name, (value, _) in after.sizes.items() if name in before.sizes]
    told = ('v' * (old.verdict != new.verdict) + 'n' * (_names(old) != _names(new))
            + f'p{change:.2f}' * bool(change > PROBABILITY) + 's' * any(moved))
    return told or '='


def _names(diagnosis: Diagnosis) -> set[tuple[str, str]]:
    return {(cause.name, cause.site) for cause in diagnosis.causes}


def study(cases: Sequence[BankCase], names: Sequence[str], folder: Path) -> None:
    """Print the base and each variant of the named constants as they come."""
    # The first time is one of compiling.
    answer(cases[0], folder)
    base = [answer(case, folder) for case in cases]
    for case, told in zip(cases, base):
        print(f'{case.key}: {told.seconds:.0f} s, {told.diagnosis.verdict}, '
              + ', '.join(f'{c.name}:{c.site} {c.probability:.2f}'
                          for c in told.diagnosis.causes), flush=True)
    for module, constants in CONSTANTS.items():
        for name, neutral in constants.items():
            if name not in names:
                continue
            value = getattr(sys.modules[f'{PACKAGE}.{module}'], name)
            for factor in FACTORS:
                tried = changed_value(value, neutral, factor)
                with patched(module, name, tried):
                    found = [answer(case, folder) for case in cases]
                cells = [difference(*pair) for pair in zip(base, found)]
                spent = math.fsum(a.seconds for a in found) / math.fsum(a.seconds for a in base)
                print(f'{name:26s}{tried:9.4g} ' + ' '.join(f'{cell:>8s}' for cell in cells)
                      + f'{spent:7.2f} {cells.count("=")}', flush=True)


def main() -> None:
    """Run and print."""
    every = [name for constants in CONSTANTS.values() for name in constants]
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--names', choices=every, nargs='*', default=every)
    parser.add_argument('--cases', nargs='*', default=CASES, help='texts in the keys of cases')
    chosen = parser.parse_args()
    no_limits = patch.object(verdict, 'detection_limits', return_value={})
    with TemporaryDirectory() as folder, no_limits:
        study(calibration_cases(chosen.cases), chosen.names, Path(folder))


if __name__ == '__main__':
    main()
