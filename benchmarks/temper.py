"""
Calibrate the temper, samples that count as one, at which parts are known as well as stated.

Arms of both simulators and both robots, their parts drawn within tolerances, with two effects of
half a detection limit each, on seeds that never score. The true parts are known, so that their
density under the posterior of a record can be computed. Printed for each temper: chi^2 of the true
parts over their number (1: as far off as stated, 2: too sure) and the logarithm of their posterior
over their prior density, nats. Then the size and the correlation of the errors that remain when
the parts are fitted: each channel's error over the stated one, and the samples that count as one
for that alone.

    python benchmarks/temper.py --arms 3
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import _truths  # noqa: F401
from bank.cases import BankCase, CHAIN, ELEMENTS, Realisation
from bank.records import write_record
from bank.sizes import read_limits, sized_truth
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import (
    nominal_base,
    prepared,
    slowest_frequency,
)
from flex_plant_sim.logs.read import read_log
import numpy as np
from truth.configuration import ROBOTS
from truth.records import random_stream, TruthCase
from truth.tolerances import GOOD, Spread, with_tolerances

TEMPERS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
# First seed; the rounds of the calibration bank end below it.
FIRST_SEED = 1900
# Correlation below which errors count as independent.
NEGLIGIBLE = 0.02


def data_of(case: BankCase) -> tuple[Data, Robot, TruthCase]:
    """Return a case's record as the tool reads it, its robot and its truth."""
    robot = load_robot(case.robot)
    # Of well made arms: `true_parts` knows those that are off there.
    truth = replace(sized_truth(case, read_limits()[case.robot])[0], spread=GOOD)
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'record.csv'
        write_record(case, truth, path)
        log = read_log(path, robot)
    record = Record('record', log.time - log.time[0], log.command, log.output, truth.payload_told)
    base = nominal_base(robot, 'assumed_modes', 3)
    records, slower = prepared([record], base)
    data = Data.of(records, slowest_frequency(base, record.payload), slower.robot.sample_time)
    return data, slower.robot, truth


def true_parts(truth: TruthCase, robot: Robot) -> dict[str, float]:
    """Return each drawn part's deviation from its file, in the units of the prior."""
    file = ROBOTS[truth.robot](truth.payload_true)
    arm = with_tolerances(file, random_stream(truth, 'tolerances'), Spread())
    found: dict[str, float] = {}
    for j, (old, new) in enumerate(zip(file.links, arm.links), start=1):
        found |= {f'stiffness_{j}': np.log(new.youngs_modulus / old.youngs_modulus),
                  f'link_mass_{j}': np.log(new.density / old.density),
                  f'damping_{j}': np.log(new.damping_ratio / old.damping_ratio)}
    moved = np.concatenate([np.subtract(new.gauges, old.gauges)
                            for old, new in zip(file.links, arm.links)])
    gains = np.divide(arm.sensors.strain_gain, file.sensors.strain_gain) - 1.0
    for name, shift, gain in zip(robot.gauge_names, moved, gains):
        found |= {f'position_{name}': shift, f'strain_gain:{name}': gain}
    for j, (was, now) in enumerate(zip(file.joints, arm.joints), start=1):
        damping = np.log(now.damping / was.damping)
        loop = damping if robot.drives[j - 1].closed_loop else 0.0
        found |= {f'drive_inertia_{j}': np.log(now.inertia / was.inertia),
                  f'drive_damping_{j}': damping,
                  f'drive_gain_{j}': np.log(now.torque_gain / was.torque_gain) - loop}
    for name in ('elbow_mass', 'elbow_inertia'):
        found[name] = np.log(getattr(arm.structure, name) / getattr(file.structure, name))
    return found


class CleanArm:
    """A clean arm's parts, re-estimated, beside the true ones."""

    def __init__(self, case: BankCase, discrepancy: DiscrepancyModel):
        data, robot, truth = data_of(case)
        base = replace(nominal_base(robot, 'assumed_modes', 3), discrepancy=discrepancy)
        refined = RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data)
        self.likelihood, self.fit = refined.likelihood, refined.fit
        true = true_parts(truth, robot)
        self.true = np.array([true.get(p.name, 0.0) for p in self.likelihood.parts])

    def at(self, temper: float) -> tuple[float, float]:
        """Return chi^2 of the true parts over their number, and nats over their prior."""
        statistics = self.fit.statistics
        found = statistics.part_marginal(statistics.likeliest_error_scale(temper), temper)
        root = np.linalg.cholesky(found.covariance)
        away = np.linalg.solve(root, self.true - found.mean)
        prior = self.true / statistics.tolerances
        nats = 0.5 * (prior @ prior - away @ away) - float(np.sum(
            np.log(np.diagonal(root) / statistics.tolerances)))
        return float(away @ away) / away.size, nats

    def errors(self) -> tuple[np.ndarray, np.ndarray]:
        """Return each channel's error over the stated one, and its correlation in samples."""
        windows = sum(p.windows.starts.size for p in self.likelihood.predictors)
        left = self.likelihood.centre_residual + np.tensordot(
            self.fit.deviations, self.likelihood.part_jacobian, 1)
        left = left.reshape(len(left), windows, -1)
        power = np.abs(np.fft.rfft(left, 2 * left.shape[-1]))**2
        like = np.fft.irfft(power).sum(axis=1)[:, :left.shape[-1]]
        like /= like[:, :1]
        first = np.argmax(like < NEGLIGIBLE, axis=1)
        return np.sqrt(np.mean(left**2, axis=(1, 2))), np.array(
            [1.0 + 2.0 * row[1:n].sum() for row, n in zip(like, first)])


def print_group(robot: str, form: Realisation, arms: list[CleanArm]) -> None:
    """Print one robot's arms of one simulator."""
    print(f'{robot}, {form.simulator}, {len(arms)} arms')
    rows = np.mean([[arm.at(t) for t in TEMPERS] for arm in arms], axis=0)
    print('  chi^2 of a part ' + ' '.join(f'{row[0]:8.2f}' for row in rows))
    print('  nats            ' + ' '.join(f'{row[1]:8.1f}' for row in rows))
    for what, values in zip(('error over stated', 'samples as one'),
                            np.mean([arm.errors() for arm in arms], axis=0)):
        print(f'  {what:<18}' + ' '.join(f'{value:6.2f}' for value in values), flush=True)


def main() -> None:
    """Print a table for each robot and simulator."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--arms', type=int, default=3, help='of each kind (default: 3)')
    parser.add_argument('--torque', type=float, default=DiscrepancyModel().torque_share[0])
    parser.add_argument('--gauge', type=float, default=DiscrepancyModel().gauge_share)
    chosen = parser.parse_args()
    discrepancy = DiscrepancyModel(torque_share=(chosen.torque,) * 2, gauge_share=chosen.gauge)
    print('temper            ' + ' '.join(f'{t:8.0f}' for t in TEMPERS))
    seed = FIRST_SEED
    for robot in ('reference', 'quanser_2dsfl'):
        for form in (ELEMENTS, CHAIN):
            print_group(robot, form, [
                CleanArm(BankCase('clean', (), robot, seed + k, form, 0.0), discrepancy)
                for k in range(chosen.arms)])
            seed += chosen.arms


if __name__ == '__main__':
    main()
