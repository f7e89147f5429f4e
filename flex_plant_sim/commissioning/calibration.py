"""
Calibrates the parts of an arm from logs with a known payload.

The parts are those of the diagnosis, with the Gaussian priors of their tolerances; the estimate is
its fit of the set without causes (docs/evidence.md), on the whole of the logs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.arm.parts import within_file_limits
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.likelihood.prior import part_priors, PartPrior, with_deviations
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data, MOVE_MORE, unmoved
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.report.extended_file import merged_readings, specs
from flex_plant_sim.diagnosis.verdict.results import PartEstimate
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
from flex_plant_sim.logs.log import Log
from msg_config.errors import InputError
import numpy as np

# Model and modes per link: the defaults of all tools.
MODEL, MODES = 'assumed_modes', 3
# Deviations below this, in tolerances, are left at the robot file's number: half a minute tells
# the best-known part of the reference arm to more.
NOTABLE = 0.1


@dataclass(frozen=True)
class Calibration:
    """
    The result of a calibration.

    Attributes
    ----------
    robot : Robot
        Robot with the calibrated parts; gauge scales and zeros, joint 2's zero and the Coriolis
        forces are among its effects.
    parts : tuple of PartEstimate
        What the logs tell of each part; `robot` has those that are `notable`.

    """

    robot: Robot
    parts: tuple[PartEstimate, ...]


def _estimates(parts: Sequence[PartPrior], fit: Fit) -> tuple[PartEstimate, ...]:
    return tuple(
        PartEstimate(part.name, part.unit, part.tolerance, float(value), float(deviation))
        for part, value, deviation in zip(
            parts, fit.deviations, np.sqrt(np.diagonal(fit.covariance))))


def calibrate(logs: Sequence[Log], robot: Robot, payload: float,
              begin: Callable[[], None] = lambda: None) -> Calibration:
    """
    Return the most probable parts, given logs in which the payload is known.

    Parameters
    ----------
    logs : sequence of Log
        Logs with the same sample time.
    robot : Robot
        Its numbers and tolerances are the prior.
    payload : float
        Payload in all logs, kg.
    begin : callable
        Called before the fit, which takes long, once no log is refused.

    Raises
    ------
    InputError
        A log is too short, hardly anything moves in the logs, channels look exchanged, inverted,
        not logged or in another unit, or an effect of the robot file says that the payload is
        another one.

    """
    known = _with_known_payload(robot, payload)
    base = nominal_base(replace(known, sample_time=logs[0].sample_time), MODEL, MODES)
    records = [Record.of(log, payload) for log in logs]
    data = _whole(records, base)
    still = unmoved(records, data)
    if still:
        raise InputError(f'{", ".join(log.source for log in logs)}: not calibrated: '
                         f'{" and ".join(still)} hardly moved. {MOVE_MORE}')
    _refuse_misread(logs)
    begin()
    fit = RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data).fit
    parts = part_priors(base.robot, payload)
    estimates = _estimates(parts, fit)
    values = np.array([part.mean if notable(part) else 0.0 for part in estimates])
    found, sensors = with_deviations(base.robot, parts, values)
    found = replace(within_file_limits(found), payload_mass=robot.payload_mass,
                    tolerances=robot.tolerances, sample_time=robot.sample_time,
                    effects=specs(merged_readings((*base.effects, *sensors))))
    return Calibration(found, estimates)


def _with_known_payload(robot: Robot, payload: float) -> Robot:
    """Return the robot with a payload that is not asked."""
    if any(spec.name == 'payload_mass' for spec in robot.effects):
        raise InputError(f'{robot.source}: effects: expected no payload_mass, which would change '
                         'the payload that was weighed')
    known = replace(robot.tolerances, payload=0.0, payload_inertia_kg_m2=0.0)
    return replace(robot, payload_mass=payload, tolerances=known)


def _refuse_misread(logs: Sequence[Log]) -> None:
    for log in logs:
        if log.misread:
            raise InputError(f'{log.source}: not calibrated, as it may not be what it was read as '
                             f'({"; ".join(log.misread)}): mend `inputs:` of the robot file, or '
                             'the log')


def notable(part: PartEstimate) -> bool:
    """Return whether a part is far enough from the robot file's number to replace it."""
    return abs(part.mean) >= NOTABLE * part.prior


def _whole(records: Sequence[Record], base: BaseModel) -> Data:
    """Return the records with nothing locked: nothing is judged by it."""
    data = Data.of(records, slowest_frequency(base, records[0].payload), base.robot.sample_time)
    return Data((*data.windows, *data.locked), (), 2 * data.noise)
