"""
Calibrate MuJoCo arms whose parts are 5 to 10 % off their robot file; print what replay gains.

`python benchmarks/calibration.py --runs 5 --seed 100` prints, for every arm, the fit of each
channel on replay before and after, and the root mean square of (estimate - truth) / stated
deviation. Nothing is tuned on it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
import time

import _truths  # noqa: F401
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.commissioning.calibration import calibrate
from flex_plant_sim.interval import Z95
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.simulation.replay import replay
import numpy as np
from truth.configuration import Arm, Joint, Link, reference_arm
from truth.excitation import set_points
from truth.mujoco.simulation import simulate
from truth.records import COLUMNS, sample_times
from truth.sensors import amplifier_output

# Relative tolerance, in the file that is calibrated, of the parts that are off.
TOLERANCE = 0.1
WIDE = ('stiffness', 'link_mass', 'drive_inertia', 'drive_gain', 'drive_damping', 'elbow_mass',
        'strain_gain')


@dataclass(frozen=True)
class Truth:
    """An arm, and by name ln of the ratio of its parts to the reference robot's."""

    arm: Arm
    off: dict[str, float]


class Factors:
    """Draws the factor of each part, and keeps its logarithm by name."""

    def __init__(self, rng: np.random.Generator):
        self._rng = rng
        self.off: dict[str, float] = {}

    def __call__(self, name: str) -> float:
        """Return the factor of a part: 5 to 10 % more or less."""
        value = float(self._rng.choice([-1.0, 1.0]) * self._rng.uniform(0.05, 0.10))
        self.off[name] = value
        return float(np.exp(value))


def _link(link: Link, j: int, factor: Factors) -> Link:
    return replace(link, youngs_modulus=link.youngs_modulus * factor(f'stiffness_{j}'),
                   density=link.density * factor(f'link_mass_{j}'),
                   damping_ratio=link.damping_ratio * factor(f'damping_{j}'))


def _joint(joint: Joint, j: int, factor: Factors) -> Joint:
    damping = factor(f'drive_damping_{j}')
    # A velocity loop that damps more also drives harder, in the same proportion.
    return replace(joint, inertia=joint.inertia * factor(f'drive_inertia_{j}'),
                   torque_gain=joint.torque_gain * damping * factor(f'drive_gain_{j}'),
                   damping=joint.damping * damping)


def draw(rng: np.random.Generator) -> Truth:
    """Return an arm whose every part is 5 to 10 % too large or too small."""
    factor, arm = Factors(rng), reference_arm(float(rng.uniform(0.05, 0.2)))
    gauges = COLUMNS['reference'][5:]
    arm = replace(
        arm, links=(_link(arm.links[0], 1, factor), _link(arm.links[1], 2, factor)),
        joints=(_joint(arm.joints[0], 1, factor), _joint(arm.joints[1], 2, factor)),
        structure=replace(arm.structure,
                          elbow_mass=arm.structure.elbow_mass * factor('elbow_mass')),
        sensors=replace(
            arm.sensors,
            strain_gain=tuple(factor(f'strain_gain:{name}') for name in gauges),
            strain_bias=tuple((1e-5 * rng.standard_normal(len(gauges))).tolist())))
    return Truth(arm, factor.off)


def record(truth: Truth, seed: int, duration: float) -> np.ndarray:
    """Return the log of a closed loop around the arm, (N, 9), in the order of COLUMNS."""
    rng, arm = np.random.default_rng([seed, 7]), truth.arm
    time_s = sample_times(arm, round(duration / arm.sample_time))
    noise = arm.sensors.angle_noise * rng.standard_normal((len(time_s), 2))
    motion = simulate(arm, set_points(rng, time_s, arm.excitation), noise=noise)
    strain = amplifier_output(motion, arm.sensors, arm.sample_time)
    strain += arm.sensors.strain_noise * rng.standard_normal(strain.shape)
    return np.column_stack([time_s, motion.command, motion.joint, strain])


def told_robot() -> Robot:
    """Return the robot of the user's file: the reference robot with wide tolerances."""
    robot = load_robot('reference')
    wide = dict.fromkeys(WIDE, TOLERANCE)
    wide['strain_bias'] = 1e-5
    return replace(robot, tolerances=replace(robot.tolerances, **wide))


def one(seed: int, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the replay fits before and after, and the errors over the stated deviations."""
    truth, robot = draw(np.random.default_rng([seed, 6])), told_robot()
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'record.csv'
        np.savetxt(path, record(truth, seed, duration), delimiter=',', fmt='%.9g',
                   header=','.join(COLUMNS['reference']), comments='')
        log = read_log(path, robot)
    payload, begin = truth.arm.payload.mass, time.perf_counter()
    found = calibrate([log], robot, payload)
    took = time.perf_counter() - begin
    fits = [replay(log, item, payload=payload).fit_percent for item in (robot, found.robot)]
    scores = []
    for part in found.parts:
        if part.name in truth.off:
            error = part.mean - truth.off[part.name]
            scores.append(error / part.deviation)
            print(f'  {part.name:<22} true {100 * truth.off[part.name]:+6.2f} %  '
                  f'found {100 * part.mean:+6.2f} ± {100 * part.deviation:.2f} %  '
                  f'z {scores[-1]:+.1f}')
    print(f'seed {seed}: before {fits[0].round(1)}, after {fits[1].round(1)}, {took:.1f} s, '
          f'rms z {np.sqrt(np.mean(np.square(scores))):.2f}', flush=True)
    return fits[0], fits[1], np.array(scores)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=3)
    parser.add_argument('--seed', type=int, default=100)
    parser.add_argument('--duration', type=float, default=40.0, help='s')
    options = parser.parse_args()
    found = [one(options.seed + k, options.duration) for k in range(options.runs)]
    before, after = (np.array([item[k] for item in found]) for k in (0, 1))
    scores = np.concatenate([item[2] for item in found])
    print(f'joints, worst of {options.runs}: before {before[:, :2].min():.1f} %, after '
          f'{after[:, :2].min():.1f} %; gauges: {before[:, 2:].min():.1f} %, '
          f'{after[:, 2:].min():.1f} %')
    print(f'rms z {np.sqrt(np.mean(scores**2)):.2f}, within 1.96 std '
          f'{100 * np.mean(np.abs(scores) < Z95):.0f} %')


if __name__ == '__main__':
    main()
