"""
Calibrate the amplitudes of latent forces on arms of another simulator (MuJoCo).

`python benchmarks/latent_amplitudes.py --runs 2` hides torques that are known (dry and viscous
friction, a bias of the drive, none) in arms whose parts are the model's, smooths them with each
pair of amplitudes, and prints the share of samples of the moving joints inside the 95 % band
of the smoothed torque, and the rms error in posterior standard deviations. Amplitudes are right
where these are 95 % and 1. Seeds from 7000 on; nothing is scored on them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import _truths  # noqa: F401
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.prediction.latent_forces import (
    latent_forces,
    LatentForces,
    LatentPrior,
)
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.sensor_noise import measurement_noise
from flex_plant_sim.diagnosis.record.windows import Record, Windows
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base
from flex_plant_sim.interval import Z95
import numpy as np
from truth.records import build_arm, draw_case, make_record, TruthCase

ROBOT = load_robot('reference')
FIRST_SEED = 7000
KINDS = (None, 'coulomb_friction', 'viscous_friction', 'actuator_bias')
# Amplitudes that are tried.
TORQUE, GAUGE = (0.01, 0.02, 0.03), (0.01, 0.05)
# Speed above which a joint moves, as a share of its rms speed; begin that is left out, s; and the
# slowest frequency that cuts the record into windows.
MOVING, START_S, SLOWEST = 0.1, 2.0, 10.0


def hidden_torque(case: TruthCase, speed: np.ndarray) -> np.ndarray:
    """Return the torque that a record hides at joint speeds (N, 2), N m."""
    return np.column_stack([
        joint.torque_gain * joint.bias - joint.viscous * speed[:, j]
        - np.where(speed[:, j] > 0.0, joint.coulomb_forward, -joint.coulomb_backward)
        for j, joint in enumerate(build_arm(case).joints)])


def predictors(runs: int) -> Iterator[tuple[TruthCase, Predictor]]:
    """Yield the case and the nominal predictor of every record."""
    for kind, seed in product(KINDS, range(FIRST_SEED, FIRST_SEED + runs)):
        case = replace(draw_case(kind, seed), simulator='mujoco', tolerances=False)
        truth = make_record(case)
        record = Record(str(kind), truth.time, truth.command,
                        np.hstack([truth.joint, truth.strain]), case.payload_told)
        windows = Windows.cut(record, SLOWEST, ROBOT.sample_time)[0]
        base = nominal_base(ROBOT, 'assumed_modes', 3)
        yield case, Predictor(base, windows, measurement_noise(record.output))


def standard_errors(case: TruthCase, found: LatentForces) -> list[np.ndarray]:
    """Return the errors of the smoothed torques in standard deviations, one array per joint."""
    error = found.torque - hidden_torque(case, found.speed)
    moving = np.abs(found.speed) > MOVING * np.sqrt(np.mean(found.speed**2, axis=0))
    moving[:round(START_S / ROBOT.sample_time)] = False
    return [(error[:, j] / found.torque_deviation[:, j])[moving[:, j]] for j in (0, 1)]


def main() -> None:
    """Print a line for every pair of amplitudes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=2, help='records of each kind')
    records = list(predictors(parser.parse_args().runs))
    print('torque gauge   within 95 %: joint 1, joint 2   rms in sigma: joint 1, joint 2')
    for torque, gauge in product(TORQUE, GAUGE):
        amplitudes = LatentPrior(torque, gauge)
        errors = [standard_errors(case, latent_forces(predictor, amplitudes))
                  for case, predictor in records]
        joints = [np.concatenate(e) for e in zip(*errors)]
        within = [100.0 * np.mean(np.abs(z) < Z95) for z in joints]
        spread = [np.sqrt(np.mean(z**2)) for z in joints]
        print(f'{torque:6.2f} {gauge:5.2f}   {within[0]:8.1f} {within[1]:8.1f}   '
              f'{spread[0]:8.2f} {spread[1]:8.2f}', flush=True)


if __name__ == '__main__':
    main()
