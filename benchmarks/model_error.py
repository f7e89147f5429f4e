"""
Calibrate the model error of rpe on arms of other simulators: the amplitude of the mode `rough`.

`python benchmarks/model_error.py --runs 5` runs one filter of parts with a fixed model error over
clean arms of two other simulators (finite elements and a MuJoCo chain, parts drawn from their
tolerances), and prints for each amplitude the root mean square of error over stated deviation, the
coverage of the 95 % interval, root mean square and worst of the errors, and the interval's half
width. The amplitude whose root mean square is nearest 1 is taken. Seeds from 1000 on calibrate;
`--seed 5000` scores, and prints the whole estimator too, with the share of the forces of motion
that it ends with. With nothing after `--amplitudes` it prints the whole estimator alone.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import _truths  # noqa: F401
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.excitation import Excitation
from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.filter_step import FilterStep
from flex_payload_estimator.estimators.rpe.modes import Mode
from flex_payload_estimator.estimators.rpe.restarts import PASSES, relinearised, restarted_at
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_payload_estimator.estimators.rpe.start import StartBank
from flex_payload_estimator.estimators.rpe.time_update import CORIOLIS
from flex_payload_estimator.estimators.rpe.window_pass import FIRST_PASS_S
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
import numpy as np
from truth.records import draw_case, make_record, Record

TRUTHS = ('finite_elements', 'mujoco')
TIMES_S = (1.0, 3.0, 6.0, 10.0)
AMPLITUDES = (0.02, 0.05, 0.10, 0.15, 0.20, 0.30)
WHOLE = 'whole estimator'


class FixedMode:
    """
    A filter of parts with a fixed model error, that begins again where it was linearised.

    Parameters
    ----------
    stepper : FilterStep
    amplitude : float
        Model error of gauges and drives, as a share of what they carry.
    measured : Array
        First sample, (m,).

    """

    def __init__(self, stepper: FilterStep, amplitude: float, measured: Array):
        self.stepper, self.motion = stepper, Excitation(stepper)
        self.mode = Mode('fixed', True, amplitude, amplitude)
        self.filters = [f for f in StartBank(stepper).bank(measured) if f.mode.free_parts]
        self.motion.begin(measured)
        self.past: list[tuple[Sample, Loads, float]] = []

    @property
    def best(self) -> Filter:
        """Return the likeliest of the start, or what began again."""
        return max(self.filters, key=lambda f: f.log_likelihood)

    def update(self, sample: Sample) -> None:
        """Advance one sample and learn from it."""
        loads, moved = self.motion.loads, self.stepper.step_time * self.motion.excited
        self.past.append((sample, loads, moved))
        for f in self.filters:
            self._learn(f, sample, loads, moved)
        self.motion.update(sample.measured, self.best, sample)
        best = self.best
        if best.age >= FIRST_PASS_S and best.passes < PASSES:
            self.filters = [self._again(best)]
        elif best.passes == PASSES and best.age >= 2.0 * max(best.age_linearised, FIRST_PASS_S):
            self.filters = [relinearised(best, self.stepper)]

    def _learn(self, f: Filter, sample: Sample, loads: Loads, moved: float) -> None:
        self.stepper.step(f, sample, loads)
        f.log_likelihood, f.age = f.log_likelihood + f.log_density, f.age + moved

    def _again(self, best: Filter) -> Filter:
        """Do at once what `ModeCompetition` does while samples come."""
        (first, loads, _), *rest = self.past
        base = best.copy()
        base.mode = self.mode
        new = restarted_at(base, first, loads, None, self.stepper)
        for moment in rest:
            self._learn(new, *moment)
        return new


def rows_of(record: Record) -> list[tuple[float, Array, Array]]:
    """Return time, outputs and the command applied up to it, for each sample."""
    outputs = np.column_stack([record.joint, record.strain])
    before = np.vstack([np.zeros((1, 2)), record.command[:-1]])
    return list(zip(record.time.tolist(), outputs, before))


def fixed(record: Record, amplitude: float, stepper: FilterStep) -> list[tuple[float, float]]:
    """Return payload and variance, kg and kg^2, at TIMES_S."""
    stepper.effects.drive_input.reset()
    (_, first, _), *rows = rows_of(record)
    runner, found = FixedMode(stepper, amplitude, first), []
    for time, output, command in rows:
        applied = stepper.effects.drive_input(command, time - stepper.step_time)
        runner.update(Sample(time, output, applied))
        if np.isclose(time, TIMES_S).any():
            found.append(stepper.published(runner.best))
    return found


def whole(record: Record, estimator: RecursivePredictionError) -> list[tuple[float, float]]:
    """Return payload and variance of the whole estimator, kg and kg^2, at TIMES_S."""
    estimator.reset()
    answers = [estimator.update(*row) for row in rows_of(record)]
    return [(a.mass, a.variance) for a in answers if np.isclose(a.time, TIMES_S).any()]


def report(name: str, scores: Sequence[Array], errors: Sequence[Array]) -> None:
    """Print a line: scores and relative errors are (runs, times)."""
    z, off = np.array(scores), 100.0 * np.array(errors)
    band = Z95 * off / z
    columns = ''.join(
        f' |{np.sqrt(np.mean(z[:, k]**2)):6.2f}{100 * np.mean(np.abs(z[:, k]) < Z95):6.0f} %'
        f'{np.sqrt(np.mean(off[:, k]**2)):6.2f}{np.abs(off[:, k]).max():6.2f}'
        f'{band[:, k].mean():6.2f}' for k in range(len(TIMES_S)))
    print(f'{name:16s}{len(z):4d}{columns}', flush=True)


def study(truth: str, seeds: range, amplitudes: Sequence[float], modes: int, score: bool
          ) -> dict[str, tuple[list[Array], list[Array]]]:
    """Return scores and relative errors of each filter on clean arms of one simulator."""
    estimator = RecursivePredictionError(load_robot('reference'), 'assumed_modes', modes)
    found: dict[str, tuple[list[Array], list[Array]]] = {}
    for seed in seeds:
        case = draw_case(None, seed, duration_s=TIMES_S[-1] + 0.05)
        record = make_record(replace(case, simulator=truth))
        answers = {f'{100 * a:g} %': fixed(record, a, estimator.stepper) for a in amplitudes}
        if score:
            answers[WHOLE] = whole(record, estimator)
            f = estimator.incumbent
            print(f'seed {seed}: share of the forces of motion {f.beta[CORIOLIS]:.3f} +- '
                  f'{f.beta_cov[CORIOLIS, CORIOLIS]**0.5:.3f}, mode {f.mode.name}')
        for name, answer in answers.items():
            mass, variance = np.array(answer).T
            error = mass - case.payload_true
            scores, errors = found.setdefault(name, ([], []))
            scores.append(error / np.sqrt(variance))
            errors.append(error / case.payload_true)
    return found


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=5, help='of each simulator')
    parser.add_argument('--seed', type=int, default=1000, help='first; 5000 scores')
    parser.add_argument('--modes', type=int, default=3)
    parser.add_argument('--amplitudes', type=float, nargs='*', default=AMPLITUDES)
    options = parser.parse_args()
    print(f'{"model error":16s}runs' + ''.join(
        f' |{"rms z":>6s}{"in 95 %":>8s}{"RMSE":>6s}{"worst":>6s}{"+- %":>6s}' for _ in TIMES_S))
    print(f'{"at":20s}' + ''.join(f' |{t:5g} s{"":25s}' for t in TIMES_S))
    together: dict[str, tuple[list[Array], list[Array]]] = {}
    for truth in TRUTHS:
        print(truth)
        found = study(truth, range(options.seed, options.seed + options.runs),
                      options.amplitudes, options.modes, options.seed >= 5000)
        for name, (scores, errors) in found.items():
            report(name, scores, errors)
            both = together.setdefault(name, ([], []))
            both[0].extend(scores)
            both[1].extend(errors)
    print('both')
    for name, (scores, errors) in together.items():
        report(name, scores, errors)


if __name__ == '__main__':
    main()
