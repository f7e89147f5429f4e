"""
Show how hardly any cause looks like commands that are logged late.

`python benchmarks/command_timing.py` hides each effect of the catalogue in an arm of finite
elements or MuJoCo in turn, clear and 2.5 times as severe. It prints by how many nats the evidence
of the arm without causes rises if commands act a row earlier: above the price of a cause, the
tool would say that they are logged late, if that also held beside the causes it finds.
"""

from __future__ import annotations

from dataclasses import replace

import _truths  # noqa: F401
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.command_timing import gain_if_moved
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
import numpy as np
from truth.effects import CATALOGUE
from truth.records import draw_case, FINITE_ELEMENTS, make_record, MUJOCO

FIRST_SEED, SEVERITIES = 9101, (1.0, 2.5)


def gain_of_a_row(name: str, seed: int, severity: float) -> float:
    """Return the gain of commands that act a row earlier, nats, where an effect is hidden."""
    case = replace(draw_case(name, seed, severity=severity, duration_s=30.0),
                   simulator=(FINITE_ELEMENTS, MUJOCO)[seed % 2])
    truth, robot = make_record(case), load_robot('reference')
    base = nominal_base(robot, 'assumed_modes', 3)
    record = Record(name, truth.time, truth.command, np.hstack([truth.joint, truth.strain]),
                    case.payload_told)
    data = Data.of([record], slowest_frequency(base, record.payload), robot.sample_time)
    nothing = RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data)
    return gain_if_moved(nothing, data, 1)


def main() -> None:
    """Print one line for each record, and the largest gain."""
    asked = [(name, severity) for severity in SEVERITIES for name in CATALOGUE]
    gains = []
    for seed, (name, severity) in enumerate(asked, start=FIRST_SEED):
        gains.append(gain_of_a_row(name, seed, severity))
        print(f'{name:<24} {severity:3.1f} {gains[-1]:8.1f}', flush=True)
    print(f'largest of {len(gains)}: {max(gains):.1f} nats')


if __name__ == '__main__':
    main()
