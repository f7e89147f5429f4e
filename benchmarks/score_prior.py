"""
Calibrate for how long rpe takes its stated variance for right: score.PRIOR_S.

`python benchmarks/score_prior.py [--robot R] [--runs N] [--seed S] [--names NAME...]` runs rpe
over clean arms of MuJoCo, or of another truth, or over arms that hide one of the named effects.
It prints for each prior the shares of the samples in motion with `model_suspect`, and with `ok`
beyond three deviations, and the mean factor of the stated deviation over that without the score.
The smallest prior is taken with which clean arms are suspect no more often than without the score
(the last row). Seeds 642500 and 646500 calibrate.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import _truths  # noqa: F401
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.likelihood import reduced_chi_square, SCORE
from flex_payload_estimator.estimators.rpe.misfit import SUSPECT_FACTOR
from flex_payload_estimator.estimators.rpe.modes import ROUGH
from flex_payload_estimator.estimators.rpe.prior import tolerances_off
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from hidden_effects import SEEDS
from model_error import rows_of
import numpy as np
from truth.configuration import ROBOTS
from truth.effects import CATALOGUE
from truth.records import draw_case, make_record, TruthCase

PRIORS_S = (0.25, 0.5, 1.0, 2.0, np.inf)


def terms_of(estimator: RecursivePredictionError, case: TruthCase) -> Array:
    """
    Return what D is made of, of each sample in motion, (samples, 7).

    The score's ratio without a prior, 0 where it does not count; time learnt, s; chi-square and
    parts, each at least 1; D; variance and error, relative to the payload.
    """
    estimator.reset()
    terms, prior = [], estimator.stepper.prior
    for row in rows_of(make_record(case)):
        found, f = estimator.update(*row), estimator.incumbent
        if found.status == 'not_excited':
            continue
        off, sums = 1.0, f.statistics[SCORE]
        if f.mode.free_parts:
            off = max(1.0, tolerances_off(f.beta, f.beta_cov, prior.mean, prior.weights))
        counts = f.mode.name == ROUGH.name and f.passes > 0 and sums[3] > 0.0
        terms.append((sums[2] / sums[3] if counts else 0.0, f.age,
                      max(1.0, reduced_chi_square(f.statistics)), off,
                      estimator._competition.variance_factor(f),
                      found.variance / case.payload_true**2 if f.mode.free_parts else np.inf,
                      found.mass / case.payload_true - 1.0))
    return np.array(terms)


def shares(terms: Array, prior_s: float) -> tuple[float, float, float]:
    """Return the shares of suspect samples and of wrong ones with `ok`, and the mean factor."""
    ratio, age, square, off, factor, variance, error = terms.T
    score = np.ones(age.size) if np.isinf(prior_s) \
        else np.where(ratio > 0.0, (prior_s + age * ratio) / (prior_s + age), 1.0)
    new = np.maximum(square, score) * off
    suspect = new > SUSPECT_FACTOR
    wrong = ~suspect & (error**2 > 9.0 * variance * new / factor)
    return suspect.mean(), wrong.mean(), np.sqrt(new / (square * off)).mean()


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--robot', choices=ROBOTS, default='reference')
    parser.add_argument('--truth', choices=SEEDS, default='mujoco')
    parser.add_argument('--runs', type=int, default=10)
    parser.add_argument('--seed', type=int, default=642500, help='first')
    parser.add_argument('--names', choices=CATALOGUE, nargs='*', default=(), metavar='NAME')
    options = parser.parse_args()
    estimator = RecursivePredictionError(load_robot(options.robot), 'assumed_modes', 3)
    names, found = options.names or [None], []
    for k in range(options.runs):
        case = draw_case(names[k % len(names)], options.seed + k, options.robot,
                         duration_s=10.05)
        found.append(terms_of(estimator, replace(case, simulator=options.truth)))
    print('| prior, s | suspect, % | `ok` and beyond, % | deviation over that without |')
    print('| --- | --- | --- | --- |')
    for prior in PRIORS_S:
        suspect, wrong, wider = np.mean([shares(terms, prior) for terms in found], axis=0)
        print(f'| {prior:g} | {100 * suspect:.2f} | {100 * wrong:.2f} | {wider:.3f} |')


if __name__ == '__main__':
    main()
