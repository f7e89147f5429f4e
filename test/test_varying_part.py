"""A link that gets softer while a record is made: the truth is made of finite elements."""

from __future__ import annotations

from dataclasses import replace
import re

from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.information import InformationProbe
from flex_plant_sim.diagnosis.causes.posterior import Posterior
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.causes.search import SearchResult
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.varying_part import varying_part_text
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
import numpy as np
from simulated_records import REFERENCE
from truth.configuration import Arm, reference_arm
from truth.excitation import set_points
from truth.sensors import amplifier_output, sensor_noise
from truth.simulation import Motion, simulate

MASS, STRETCHES, STRETCH = 0.15, 15, 200
TIME = REFERENCE.sample_time * np.arange(STRETCHES * STRETCH, dtype=float)


def moved(change: float) -> tuple[Arm, Motion]:
    """Return an arm and its motion, while the upper link's stiffness changes by a share."""
    arm = reference_arm(MASS)
    reference = set_points(np.random.default_rng(5), TIME, arm.excitation)
    parts, state = list[Motion](), None
    for k in range(STRETCHES):
        factor = 1.0 + change * (k / (STRETCHES - 1) - 0.5)
        upper = replace(arm.links[0], youngs_modulus=factor * arm.links[0].youngs_modulus)
        # One sample more, which the next stretch begins at.
        rows = np.minimum(np.arange(STRETCH + 1) + k * STRETCH, len(TIME) - 1)
        whole = simulate(replace(arm, links=(upper, arm.links[1])), reference[rows], state=state)
        state = whole.state[-1]
        parts.append(whole)
    fine = parts[0].steps_per_sample
    return arm, replace(
        parts[0], command=np.concatenate([part.command[:-1] for part in parts]),
        joint=np.concatenate([part.joint[:-1] for part in parts]),
        fine_strain=np.concatenate([part.fine_strain[:-fine] for part in parts]),
        state=np.concatenate([part.state[:-1] for part in parts]))


def result(change: float) -> SearchResult:
    """Return the diagnosis of such a record, as if no cause had been asked for."""
    arm, motion = moved(change)
    random = np.random.default_rng(6)
    strain = amplifier_output(motion, arm.sensors, arm.sample_time)
    strain += sensor_noise(random, strain.shape, arm.sensors.strain_noise, arm.sample_time)
    joint = motion.joint + sensor_noise(random, motion.joint.shape, arm.sensors.angle_noise,
                                        arm.sample_time)
    outputs = np.column_stack([joint, strain]).astype(float)
    record = Record('warm', TIME, motion.command.astype(float), outputs, MASS)
    base = nominal_base(REFERENCE, 'assumed_modes', 3, True)
    data = Data.of([record], slowest_frequency(base, MASS), REFERENCE.sample_time)
    nothing = RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data)
    posterior = Posterior.of([nothing.fit], base, parts_vary=True)
    return SearchResult(replace(nothing, fit=posterior.best), (), InformationProbe.beside(nothing),
                        posterior, nothing)


def test_a_link_that_gets_softer_is_named_with_its_change_and_one_that_does_not_is_not() -> None:
    found = result(-0.12)
    assert found.posterior.unknown_probability > 0.99
    text = varying_part_text(found)
    change = re.fullmatch(r' Something seems to change during the record: '
                          r'stiffness 1 by (-[\d.]+) %\.', text)
    assert change, text
    # From the middle of the first fitted window to that of the last, of 70 % of the record.
    assert -9.0 < float(change[1]) < -4.0
    same = result(0.0)
    assert same.posterior.nothing_probability > 0.99 and not varying_part_text(same)
