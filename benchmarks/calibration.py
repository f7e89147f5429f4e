"""
Calibrate MuJoCo arms whose parts are 5 to 10 % off their robot file; say what replay gains.

`python benchmarks/calibration.py --runs 5 --seed 100` prints, for every arm, the fit of each
channel on replay before and after, and the root mean square of (estimate - truth) / stated
deviation. Seeds from 100 served to choose MODEL_TEMPER, seeds from 200 to score it.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
import time

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.commissioning.calibration import calibrate
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.tools.replay import replay
from mujoco_chain import Arm, build, run
from mujoco_effects import GAUGES
from mujoco_records import ANGLE_NOISE, COLUMNS, Loop, PERIOD_S, set_points, STRAIN_NOISE
from mujoco_scenario import logged_strain, Scenario, Sensors
import numpy as np

TOLERANCE = 0.1
WIDE = ('stiffness', 'link_mass', 'drive_inertia', 'drive_gain', 'drive_damping', 'elbow_mass',
        'strain_gain')


@dataclass(frozen=True)
class Truth:
    """An arm, and the logarithm of what its parts are over the reference robot's, by name."""

    arm: Arm
    sensors: Sensors
    off: dict[str, float]


def draw(rng: np.random.Generator) -> Truth:
    """Return an arm whose every part is 5 to 10 % too large or too small."""
    off: dict[str, float] = {}

    def factor(*names: str) -> float:
        value = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.10))
        off.update(dict.fromkeys(names, value))
        return float(np.exp(value))

    links = [replace(link, youngs_modulus=link.youngs_modulus * factor(f'stiffness_{j}'),
                     density=link.density * factor(f'link_mass_{j}'),
                     damping_ratio=link.damping_ratio * factor(f'damping_{j}'))
             for j, link in enumerate(Arm().links, start=1)]
    inertia = [value * factor(f'drive_inertia_{j}')
               for j, value in enumerate(Arm().rotor_inertia, start=1)]
    gain = [factor(f'drive_gain_{j}') for j in (1, 2)]
    damping = [factor(f'drive_damping_{j}') for j in (1, 2)]
    arm = replace(
        Arm(), links=(links[0], links[1]), rotor_inertia=(inertia[0], inertia[1]),
        gain=(gain[0], gain[1]), elbow_mass=Arm().elbow_mass * factor('elbow_mass'),
        time_constant=(_time_constant(0, inertia, damping), _time_constant(1, inertia, damping)),
        payload_mass=float(rng.uniform(0.05, 0.2)))
    scale = [factor(f'strain_gain:{name}') for name in GAUGES]
    sensors = Sensors(strain_mix=np.diag(scale), strain_bias=1e-5 * rng.standard_normal(4))
    return Truth(arm, sensors, off)


def _time_constant(j: int, inertia: list[float], damping: list[float]) -> float:
    nominal = Arm().rotor_inertia[j] / Arm().time_constant[j]
    return inertia[j] / (nominal * damping[j])


def record(truth: Truth, seed: int, duration: float) -> np.ndarray:
    """Return what a closed loop around the arm logs, (N, 9), in the order of COLUMNS."""
    rng, count = np.random.default_rng([seed, 7]), round(duration / PERIOD_S)
    chain = build(truth.arm, 20, PERIOD_S / 20)
    loop = Loop(chain, Scenario(truth.arm, truth.arm.payload_mass, sensors=truth.sensors),
                set_points(rng, count), ANGLE_NOISE * rng.standard_normal((count, 2)))
    _, strain = run(chain, loop.command, count, PERIOD_S)
    strain = logged_strain(strain, truth.sensors, PERIOD_S, PERIOD_S)
    strain += STRAIN_NOISE * rng.standard_normal(strain.shape)
    return np.column_stack([np.arange(count) * PERIOD_S, loop.commands, loop.angles, strain])


def told_robot() -> Robot:
    """Return the reference robot with wide tolerances: what the user's file says."""
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
                   header=','.join(COLUMNS), comments='')
        log = read_log(path, robot)
    payload, begin = truth.arm.payload_mass, time.perf_counter()
    found = calibrate([log], robot, payload)
    took = time.perf_counter() - begin
    fits = [replay(log, item, payload=payload).fit_percent for item in (robot, found.robot)]
    scores = []
    for item in found.items:
        if item.name in truth.off:
            error = item.deviation - truth.off[item.name]
            scores.append(error / item.std)
            print(f'  {item.name:<22} true {100 * truth.off[item.name]:+6.2f} %  '
                  f'found {100 * item.deviation:+6.2f} ± {100 * item.std:.2f} %  '
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
          f'{100 * np.mean(np.abs(scores) < 1.96):.0f} %')


if __name__ == '__main__':
    main()
