"""Logs of arms of five kinds, of which `constants.py` weighs the payloads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import _truths  # noqa: F401
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
from hidden_effects import effects_of
from matched import GAIN, HEAVIEST, LIGHTEST, set_point
from model_error import rows_of
import numpy as np
from truth.effects import CATALOGUE
from truth.records import draw_case, make_record, TruthCase

# Modes of the model, length of a log, s, and times at which the payload is asked, s.
MODES, UNTIL_S, TIMES_S = 3, 10.05, (3.0, 10.0)
KINDS = ('matched', 'parts', 'hidden', 'change', 'disturbed')
# Of a disturbed log, s: outliers (of OUTLIER, rad, on the first angle), burst of noise as a
# multiple of that of the robot file, samples lost, set-points held at zero.
OUTLIERS_S, OUTLIER, BURST_S, BURST = (1.5, 2.7), 0.2, (3.5, 4.0), 20.0
LOST_S, REST_S = (5.0, 5.2), (5.5, 8.5)
Row = tuple[float, Array, Array]


@dataclass(frozen=True)
class Log:
    """Rows for the estimator, true payload at TIMES_S, kg, and when it changes, s, if ever."""

    kind: str
    rows: list[Row]
    mass: tuple[float, float]
    at: float | None = None


def matched_log(seed: int, disturbed: bool = False) -> Log:
    """Return a log of the estimator's own model in square moves, perhaps disturbed."""
    robot, random = load_robot('reference'), np.random.default_rng([seed, 1])
    mass = float(random.uniform(LIGHTEST, HEAVIEST))
    simulator = Simulator(ExtendedArm(robot, 'assumed_modes', MODES, mass), None,
                          Noise(robot.angle_noise, robot.strain_noise), seed)
    size, command, rows = np.array([robot.angle_noise] * 2 + [robot.strain_noise] * 4), \
        np.zeros(2), []
    for _ in range(round(UNTIL_S / robot.sample_time)):
        sample = simulator.measure()
        time, output = sample.time, sample.output.copy()
        target = set_point(time)
        if disturbed:
            output[0] += OUTLIER * bool(np.isclose(time, OUTLIERS_S).any())
            if BURST_S[0] <= time < BURST_S[1]:
                output += BURST * size * random.standard_normal(size.size)
            target *= not REST_S[0] <= time < REST_S[1]
        if not disturbed or not LOST_S[0] <= time < LOST_S[1]:
            rows.append((time, output, command))
        command = GAIN * (target - sample.angle)
        simulator.step(command)
    return Log('disturbed' if disturbed else 'matched', rows, (mass, mass))


def true_log(kind: str, case: TruthCase) -> Log:
    """Return a log of an arm of the truths; FloatingPointError where that is unstable."""
    at, mass = None, (case.payload_true, case.payload_true)
    if kind == 'change':
        at = 4.0 + 0.3 * (case.seed % 5)
        name, change = case.effects[0]
        mass = case.payload_true, float(change['mass'])
        case = replace(case, effects=((name, {**change, 'time': at, 'duration': 0.0}),))
    return Log(kind, rows_of(make_record(case)), mass, at)


def logs(count: int, seed: int, kinds: Sequence[str] = KINDS, truth: str = 'mujoco') -> list[Log]:
    """Return so many logs of each kind."""
    found = []
    for kind in kinds:
        names = {'hidden': effects_of(seed, 2 * count, truth, tuple(CATALOGUE)),
                 'change': ['payload_change'] * (2 * count)}.get(kind, [None] * (2 * count))
        of_kind: list[Log] = []
        for place, name in enumerate(names, seed):
            if len(of_kind) == count:
                break
            if kind in ('matched', 'disturbed'):
                of_kind.append(matched_log(place, kind == 'disturbed'))
                continue
            case = draw_case(name, place, 'reference', duration_s=UNTIL_S)
            try:
                of_kind.append(true_log(kind, replace(case, simulator=truth)))
            except FloatingPointError:
                continue
        found += of_kind
    return found
