"""
Count how often the law of a hidden torque is drawn over the right variable.

`python benchmarks/latent_laws.py --runs 2` hides torques in finite-element and MuJoCo arms with
part tolerances, in the forms that nature gives them: friction over speed, ripple over angle, and
torques that no effect of the package has, put in behind the logged command (over time and over the
command). The latent forces are those of the nominal arm, so no search has a say. It prints, for
each truth and kind, how often the law was stated over the right variable, over a wrong one, and
not at all; clean arms must state none. Seeds from 8000 on; nothing is tuned on them.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import _truths  # noqa: F401
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.prediction.latent_view import latent_view, LatentView
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.sensor_noise import measurement_noise
from flex_plant_sim.diagnosis.record.windows import Record, Windows
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base
import numpy as np
from truth.records import draw_case, make_record, TruthCase

ROBOT = load_robot('reference')
FIRST_SEED, SLOWEST = 8000, 10.0
TRUTHS = ('finite_elements', 'mujoco')
NAMED = {
    'nothing': (None, (), 'none'),
    'coulomb_friction': ('coulomb_friction', (), 'speed'),
    'coulomb_friction, bristles': ('coulomb_friction', ('bristles',), 'speed'),
    'stribeck_friction': ('stribeck_friction', (), 'speed'),
    'viscous_friction': ('viscous_friction', (), 'speed'),
    'torque_ripple': ('torque_ripple', (), 'angle')}
Law = Callable[[np.ndarray, np.ndarray], np.ndarray]
# Torques as shares of the drive's gain, over time, s, and the logged command (N,).
UNNAMED: dict[str, tuple[Law, str]] = {
    'fades with time': (lambda t, u: 0.06 * np.exp(-t / 12.0), 'time'),
    'bows with the command': (lambda t, u: 0.08 * np.exp(-(u / 0.3)**2), 'command')}


def view_of(case: TruthCase, unseen: np.ndarray | None = None) -> LatentView:
    """Return the nominal arm's latent forces on a record; `unseen` (N, 2) adds to its commands."""
    truth = make_record(case)
    command = truth.command
    if unseen is not None:
        truth = make_record(case, command + unseen)
    record = Record('truth', truth.time, command, np.hstack([truth.joint, truth.strain]),
                    case.payload_told)
    windows = Windows.cut(record, SLOWEST, ROBOT.sample_time)[1]
    base = nominal_base(ROBOT, 'assumed_modes', 3)
    return latent_view([Predictor(base, windows, measurement_noise(record.output))])


def verdict_on(view: LatentView, variable: str, joint: int) -> str:
    """Return right, wrong or unstated for the joint with the hidden torque, or for both."""
    stated = {f.series.site: f.law.variable for f in view.torques if f.law.stated}
    if variable == 'none':
        return 'wrong' if stated else 'right'
    found = stated.get(f'joint_{joint}')
    return 'unstated' if found is None else 'right' if found == variable else 'wrong'


def named(simulator: str, kind: str, seed: int) -> str:
    """Return the verdict on an effect that the package knows."""
    effect, forms, variable = NAMED[kind]
    case = replace(draw_case(effect, seed), simulator=simulator, forms=forms)
    joint = int(case.effects[0][1]['joint']) if case.effects else 0
    return verdict_on(view_of(case), variable, joint)


def unnamed(simulator: str, kind: str, seed: int) -> str:
    """Return the verdict on a torque that the package does not know."""
    law, variable = UNNAMED[kind]
    case = replace(draw_case(None, seed), simulator=simulator)
    joint, command = seed % 2, make_record(case).command
    unseen = np.zeros_like(command)
    unseen[:, joint] = law(0.01 * np.arange(len(command)), command[:, joint])
    return verdict_on(view_of(case, unseen), variable, joint + 1)


def main() -> None:
    """Print a line for every truth and kind."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--runs', type=int, default=2, help='records of each kind and truth')
    seeds = range(FIRST_SEED, FIRST_SEED + parser.parse_args().runs)
    print(f'{"truth":<16}{"hidden":<28}{"right":>8}{"wrong":>8}{"unstated":>10}')
    for simulator in TRUTHS:
        for kind in (*NAMED, *UNNAMED):
            if simulator != 'mujoco' and kind in NAMED and NAMED[kind][1]:
                continue
            judge = named if kind in NAMED else unnamed
            count = Counter(judge(simulator, kind, seed) for seed in seeds)
            print(f'{simulator:<16}{kind:<28}{count["right"]:>8}{count["wrong"]:>8}'
                  f'{count["unstated"]:>10}', flush=True)


if __name__ == '__main__':
    main()
