"""
Compare the default estimator with an augmented EKF and UKF (FilterPy) on the same data.

`python benchmarks/kalman_family.py` runs matched cases (as in accuracy.py, n = 2) and the clean
record of the independent simulator. EKF and UKF carry (x, m), know the noise levels and start at
0.1 kg; on the record they get the smallest of the estimator's levels of model error, with which
they do best there.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import json
from pathlib import Path
import time

from filterpy.kalman import ExtendedKalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.rpe.modes import Mode, MODES
from flex_payload_estimator.estimators.rpe.prior import tabulated
from flex_payload_estimator.estimators.rpe.schedule import PayloadSchedule
from flex_payload_estimator.estimators.rpe.sensors import start_spread, told_noise
from flex_payload_estimator.estimators.rpe.time_update import predict
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from matched import bound, Case, Record, record
import numpy as np

# Payload at the start of EKF and UKF, its standard deviation, and the largest payload, kg.
START_KG, SPREAD_KG, HEAVIEST_KG = 0.1, 0.1, 0.7
TIMES_S = (1.0, 3.0, 10.0)
BENCH = Path(__file__).resolve().parents[2] / 'shared' / 'data' / 'bench'
Step = Callable[[Array, Array], tuple[float, float]]


class Arm:
    """The sampled arm as a function of (x, m), from the same table for all filters."""

    def __init__(self, robot: Robot, modes: int):
        self.arm = ExtendedArm(robot, 'assumed_modes', modes)
        self.schedule: PayloadSchedule = tabulated(robot, 'assumed_modes', modes, (),
                                                   HEAVIEST_KG)
        self.told = told_noise(self.arm)
        self.output = self.arm.output_matrix / self.told[:, None]
        self.gains = np.array([drive.torque_gain for drive in robot.drives])

    def step(self, state: Array, command: Array) -> tuple[Array, Array, Array]:
        """Return (x, m) one sample later, its Jacobian, and [dx/du]."""
        n = self.arm.states
        mass = min(max(state[n], 0.0), HEAVIEST_KG)
        piece = self.schedule.cut(mass)
        beta = np.array([mass, 0.0])
        x, sens = state[:n].copy(), np.zeros((n, 2))
        predict(
            x, np.zeros((n, n)), sens, beta, piece.series,
            np.zeros((0, 1)), mass - piece.payload, command, np.zeros((0, self.arm.form.order)),
            np.zeros(2), 1)
        jacobian = np.eye(n + 1)
        jacobian[:n, n] = sens[:, 0]
        value = np.split(piece.series, 3, axis=1)[0]
        order = np.arange(len(value))
        increment = (np.cos(state[1] * order) @ value).reshape(n, -1)
        slope = -order * np.sin(state[1] * order)
        jacobian[:n, :n] += increment[:, :n]
        jacobian[:n, 1] += (slope @ value).reshape(n, -1)[:, :n + 2] \
            @ np.r_[state[:n], command]
        return np.r_[x, mass], jacobian, increment[:, n:n + 2]

    def process_noise(self, torque: float, push: Array) -> Array:
        """Return the covariance of a sample's process noise on (x, m), torque in N m."""
        n = self.arm.states
        noise = np.zeros((n + 1, n + 1))
        columns = push * torque / self.gains
        noise[:n, :n] = columns @ columns.T
        # FilterPy's UKF takes a Cholesky factor of P, which rounding must not make indefinite.
        noise[np.arange(n + 1), np.arange(n + 1)] += 1e-18
        return noise

    def noise(self, mode: Mode, strain: float) -> Array:
        """Return each channel's variance over the told one, (m,), at a strain of the gauges."""
        error = np.zeros(self.told.size)
        error[2:] = mode.gauge_error * strain
        return 1.0 + (error / self.told)**2


def ekf(arm: Arm, noise: Array, torque: float) -> Step:
    """Return an augmented extended Kalman filter as a function of output and command."""
    n = arm.arm.states
    kf = ExtendedKalmanFilter(n + 1, len(arm.told))
    kf.x, kf.P, kf.R = start(arm)[0], start(arm)[1], np.diag(noise)
    output = np.hstack([arm.output, np.zeros((len(arm.told), 1))])
    first = [True]

    def step(measured: Array, command: Array) -> tuple[float, float]:
        if not first[0]:
            after, kf.F, push = arm.step(kf.x, command)
            kf.Q = arm.process_noise(torque, push)
            kf.P = kf.F @ kf.P @ kf.F.T + kf.Q
            kf.x = after
        else:
            kf.x[:2], first[0] = measured[:2] * arm.told[:2], False
        kf.update(measured, lambda x: output, lambda x: output @ x)
        kf.P = 0.5 * (kf.P + kf.P.T)
        return float(kf.x[n]), float(kf.P[n, n])

    return step


def ukf(arm: Arm, noise: Array, torque: float) -> Step:
    """Return an augmented unscented Kalman filter as a function of output and command."""
    n = arm.arm.states
    points = MerweScaledSigmaPoints(n + 1, alpha=1e-2, beta=2.0, kappa=2.0 - n)
    output = np.hstack([arm.output, np.zeros((len(arm.told), 1))])
    kf = UnscentedKalmanFilter(
        n + 1, len(arm.told), arm.arm.step_time, lambda x: output @ x,
        lambda x, dt, command: arm.step(x, command)[0], points)
    kf.x, kf.P, kf.R = start(arm)[0], start(arm)[1], np.diag(noise)
    first = [True]

    def step(measured: Array, command: Array) -> tuple[float, float]:
        if not first[0]:
            kf.Q = arm.process_noise(torque, arm.step(kf.x, command)[2])
            kf.predict(command=command)
        else:
            kf.x[:2], first[0] = measured[:2] * arm.told[:2], False
            kf.sigmas_f = points.sigma_points(kf.x, kf.P)
        kf.update(measured)
        kf.P = 0.5 * (kf.P + kf.P.T)
        return float(kf.x[n]), float(kf.P[n, n])

    return step


def start(arm: Arm) -> tuple[Array, Array]:
    """Return state and covariance before the first sample."""
    n = arm.arm.states
    x, spread = np.zeros(n + 1), np.r_[start_spread(arm.arm), SPREAD_KG]
    x[n] = START_KG
    return x, np.diag(spread**2)


def default(robot: Robot, modes: int, torque: float) -> Step:
    """Return the default estimator as a function of output and command."""
    estimator = make_estimator('rpe', robot, 'assumed_modes', modes,
                               torque_noise=(torque, torque), payload_max=HEAVIEST_KG)
    told, clock = told_noise(ExtendedArm(robot, 'assumed_modes', modes)), [0.0]

    def step(measured: Array, command: Array) -> tuple[float, float]:
        estimate = estimator.update(clock[0], measured * told, command)
        clock[0] += robot.sample_time
        return estimate.mass, estimate.variance

    return step


def answers(step: Step, outputs: Array, commands: Array) -> tuple[Array, Array, Array]:
    """Return payloads, variances and processor seconds per step; NaN after a breakdown."""
    found = np.full((3, len(outputs)), np.nan)
    command = np.zeros(2)
    for k, measured in enumerate(outputs):
        begin = time.process_time()
        try:
            found[:2, k] = step(measured, command)
        except np.linalg.LinAlgError:
            break
        found[2, k] = time.process_time() - begin
        command = commands[k]
    return found[0], found[1], found[2]


def matched_study(runs: int, modes: int) -> None:
    """Print errors over the bound and times of the three on matched cases."""
    truth = ExtendedArm(load_robot('reference'), 'assumed_modes', modes)
    errors: dict[str, list[Array]] = {}
    times: dict[str, list[Array]] = {}
    scaled: dict[str, list[Array]] = {}
    at = [round(t / 0.01) for t in TIMES_S]
    for seed in range(runs):
        case = Case.draw(200_000 + seed, 0.05 * (seed % 2))
        data, robot = record(truth, case, TIMES_S[-1]), case.robot()
        limit = bound(truth, case, data)[at]
        for name, found in beside(robot, data, modes, case.torque).items():
            error = found[0][at] - case.mass
            errors.setdefault(name, []).append(np.abs(error) / limit)
            scaled.setdefault(name, []).append(np.abs(error) / np.sqrt(found[1][at]))
            times.setdefault(name, []).append(found[2])
    print(f'matched model, n = {modes}, {runs} runs: error over the Cramer-Rao bound')
    print(f'{"":6s}' + ''.join(f'{f"RMS at {t:g} s":>14s}' for t in TIMES_S)
          + f'{"median at 10 s":>16s}{"in 95 %":>9s}{"broke down":>12s}{"us a step":>11s}')
    for name, values in errors.items():
        ratio = np.array(values)
        rms = np.sqrt(np.nanmean(ratio**2, axis=0))
        step_us = 1e6 * np.nanmedian(np.concatenate(times[name]))
        covered = 100 * np.mean(np.array(scaled[name]) < Z95)
        print(f'{name:6s}' + ''.join(f'{value:14.2f}' for value in rms)
              + f'{np.nanmedian(ratio[:, -1]):16.2f}{covered:8.1f}%'
              f'{int(np.isnan(ratio[:, -1]).sum()):12d}{step_us:11.0f}')


def beside(robot: Robot, data: Record, modes: int, torque: float
           ) -> dict[str, tuple[Array, Array, Array]]:
    """Return the answers of the three on one record."""
    arm = Arm(robot, modes)
    noise, outputs = arm.noise(MODES[0], 0.0), data.outputs / arm.told
    steps = {'rpe': default(robot, modes, torque), 'EKF': ekf(arm, noise, torque),
             'UKF': ukf(arm, noise, torque)}
    return {name: answers(step, outputs, data.commands) for name, step in steps.items()}


def record_study(modes: int) -> None:
    """Print the errors of the three on the independent simulator's clean record."""
    if not BENCH.is_dir():
        print('the bench records are absent: expected ../shared/data/bench')
        return
    truths = json.loads((BENCH / 'truth.json').read_text())
    name = next(key for key, truth in truths.items() if truth['name'] == 'nothing')
    rows = np.loadtxt(BENCH / f'{name}.csv', delimiter=',', skiprows=1, max_rows=1001)
    robot, mass = load_robot('reference'), truths[name]['payload_true']
    arm = Arm(robot, modes)
    # The model error of `rough`, where the gauges see what they do on average.
    noise = arm.noise(MODES[1], float(np.sqrt(np.mean(rows[:, 5:9]**2))))
    print(f'clean record of the independent simulator, n = {modes}: error ± std, %')
    for label, step in (('rpe', default(robot, modes, 0.0)), ('EKF', ekf(arm, noise, 0.0)),
                        ('UKF', ukf(arm, noise, 0.0))):
        found = answers(step, rows[:, 3:9] / arm.told, rows[:, 1:3])
        texts = [f'{100 * (found[0][k] / mass - 1):7.2f} ±{100 * found[1][k]**0.5 / mass:5.2f}'
                 for k in (round(t / 0.01) for t in TIMES_S)]
        print(f'{label:6s}' + ''.join(f'{text:>18s}' for text in texts)
              + f'{1e6 * np.nanmedian(found[2]):10.0f} us a step')


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=20)
    parser.add_argument('--modes', type=int, default=2)
    options = parser.parse_args()
    matched_study(options.runs, options.modes)
    record_study(3)


if __name__ == '__main__':
    main()
