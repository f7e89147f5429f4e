"""
Weigh payloads while a loop moves the arm by steps so large that its links bend far.

`python benchmarks/bending.py --seed 719020 --runs 6` closes the LQG loop around the finite
elements of `test/truth`, their parts drawn from the robot's tolerances, with set-points of
+-step on both joints. Prints, for each payload and step, the root mean square of the errors of
rpe, its mean standard deviation, kg, the runs inside the 95 % interval, and the BENDING_SHARE of
estimators/rpe/score.py with which that deviation would be the error: steps of 0.2 and 0.3 rad of
0.1 kg, seeds 719010 to 719015, set it (those of 0.3 kg are `model_suspect`, and widened for it).
"""

from __future__ import annotations

import argparse
import math

import _truths  # noqa: F401
from flex_payload_estimator.control.lqg import LQGController, LQGSettings
from flex_payload_estimator.control.set_points import square
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.likelihood import SCORE
from flex_payload_estimator.estimators.rpe.score import bending_error, BENDING_SHARE
from flex_plant_sim.arm.parts import drawn
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.interval import Z95
import numpy as np
from sampled_arm import Elements, elements_of

PAYLOADS, STEPS = (0.1, 0.3), (0.05, 0.1, 0.2, 0.3)
MODEL, MODES, ESTIMATED_MODES = 'assumed_modes', 2, 3
# Of the steps, s.
HOLD_S = 4.0


def weighed(payload: float, step: float, seed: int, until: float) -> tuple[float, float, float]:
    """Return error and standard deviation at the end, kg, and the mean square of bending."""
    nominal = load_robot('reference')
    plant = Elements(elements_of(drawn(nominal, np.random.default_rng([seed, 3])), payload),
                     nominal, seed)
    controller = LQGController(nominal, MODEL, MODES, LQGSettings(
        integrator=False, command_limit=math.inf))
    estimator = make_estimator('rpe', nominal, MODEL, ESTIMATED_MODES)
    assert isinstance(estimator, RecursivePredictionError)
    target, sent = square(amplitude=step, period=2.0 * HOLD_S), np.zeros(2)
    for k in range(round(until / nominal.sample_time)):
        time, output = k * nominal.sample_time, plant.measure()
        found = estimator.update(time, output, sent)
        sent = controller.command(time, output, sent, found.mass, target(time))
        plant.step(sent)
    sums = estimator.incumbent.statistics[SCORE]
    return found.mass - payload, found.variance**0.5, bending_error(sums) / BENDING_SHARE


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--runs', type=int, default=6)
    parser.add_argument('--seed', type=int, default=0, help='first')
    parser.add_argument('--until', type=float, default=16.0, help='s')
    given = parser.parse_args()
    moved = load_robot('reference').moved_mass
    print(' payload   step   RMSE    std  inside   share')
    for payload in PAYLOADS:
        for step in STEPS:
            error, std, bent = np.array([
                weighed(payload, step, seed, given.until)
                for seed in range(given.seed, given.seed + given.runs)]).T
            rms, scale = np.sqrt(np.mean(error**2)), bent * (moved + payload)
            others = np.mean(std**2 - (BENDING_SHARE * scale)**2)
            needed = np.sqrt(max(rms**2 - others, 0.0) / np.mean(scale**2))
            print(f'{payload:8.1f} {step:6.2f} {rms:6.4f} {std.mean():6.4f} '
                  f'{np.sum(np.abs(error) < Z95 * std):3d} of {given.runs}   '
                  f'{needed:.3f}', flush=True)


if __name__ == '__main__':
    main()
