"""
Calibrate the discrepancy, what a good model lacks, on clean arms of another simulator.

`python benchmarks/discrepancy.py --runs 6` takes clean MuJoCo arms (calibration seeds from 700;
score on others) and some amplitudes of the discrepancy. It prints the root mean square of the
whitened innovations per channel with the parts re-estimated (1: as large as stated), and the
temper that their colour asks for: the long-run variance of the scores of the parts over the white
one. Last come mean and standard deviation, over joints and arms and over gauges and arms, of the
logarithm of the scale of slow errors: the larger of the latter is `posterior.SLOW_ERROR_SPREAD`.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import _truths  # noqa: F401
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.gauss_newton import fit_set
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
import numpy as np
from truth.records import draw_case, make_record

# First seed, and blocks of a record whose sums give the long-run variance.
FIRST_SEED, BLOCKS = 700, 48
DISCREPANCIES = tuple(DiscrepancyModel(gauge_share=share) for share in (0.01, 0.02, 0.05))


def whitened(seed: int, discrepancy: DiscrepancyModel
             ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return untempered innovations (N, m) of a clean arm, columns (N, m, p), slow scales."""
    case = replace(draw_case(None, seed), simulator='mujoco')
    truth = make_record(case)
    robot = load_robot('reference')
    base = replace(nominal_base(robot, 'assumed_modes', 3), discrepancy=discrepancy)
    record = Record('clean', truth.time, truth.command, np.hstack([truth.joint, truth.strain]),
                    case.payload_told)
    data = Data.of([record], slowest_frequency(base, record.payload), robot.sample_time)
    likelihood = Likelihood(base, data.windows, data.noise)
    fit = fit_set(likelihood, CauseSet((), data.duration), (np.zeros(0),))
    left = likelihood.centre_residual + np.tensordot(fit.deviations, likelihood.part_jacobian, 1)
    return (left.T, likelihood.part_jacobian.T * likelihood.tolerances, fit.slow_scale)


def temper(errors: np.ndarray, columns: np.ndarray) -> float:
    """Return, as the median over parts, the ratio of long-run to white variance of the scores."""
    scores = np.einsum('tm,tmp->tp', errors, columns)
    sums = np.array([part.sum(axis=0) for part in np.array_split(scores, BLOCKS)])
    white = np.einsum('tmp,tmp->p', columns, columns)
    return float(np.median(np.sum((sums - sums.mean(axis=0))**2, axis=0) / white))


def main() -> None:
    """Print one line for each discrepancy."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=2)
    runs = parser.parse_args().runs
    print('torque  gauge   rms of whitened innovations per channel       temper'
          '              ln of slow scales: joints, gauges')
    for discrepancy in DISCREPANCIES:
        arms = [whitened(FIRST_SEED + k, discrepancy) for k in range(runs)]
        rms = np.sqrt(np.mean([np.mean(errors**2, axis=0) for errors, *_ in arms], axis=0))
        found = [temper(errors, columns) for errors, columns, _ in arms]
        slow = np.log([scale for *_, scale in arms])
        spreads = ', '.join(f'{some.mean():.2f} +- {some.std():.2f}'
                            for some in (slow[:, :2], slow[:, 2:]))
        print(f'{discrepancy.torque_share[0]:6.2f} {discrepancy.gauge_share:6.2f}   '
              f'{" ".join(f"{r:6.2f}" for r in rms)}   {np.mean(found):6.2f} '
              f'({min(found):.2f} to {max(found):.2f})   {spreads}', flush=True)


if __name__ == '__main__':
    main()
