"""Builds a payload estimator by name: `sf1_paper`, `sf1` or `rpe`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from flex_payload_estimator.estimators.base import PayloadEstimator
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.settings import RpeSettings
from flex_payload_estimator.estimators.sf1.estimator import SF1Estimator
from flex_payload_estimator.estimators.sf1.settings import (
    PAPER_SETTINGS,
    SF1EstimatorSettings,
)
from flex_payload_estimator.model.linear_robot import left_out, linear_robot
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.effects import effects_of
from flex_plant_sim.effects.structure.coriolis_centripetal import CoriolisCentripetal
from flex_plant_sim.simulation.nominal import has_coriolis, model_words, WITH_CORIOLIS
from msg_config.errors import InputError

Builder = Callable[..., PayloadEstimator]


def _sf1_paper(robot: Robot, model: str, modes: int, **changes: Any) -> PayloadEstimator:
    return SF1Estimator(linear_robot(robot), model, modes, replace(PAPER_SETTINGS, **changes))


def _sf1(robot: Robot, model: str, modes: int, **changes: Any) -> PayloadEstimator:
    return SF1Estimator(linear_robot(robot), model, modes, SF1EstimatorSettings(**changes))


def _rpe(robot: Robot, model: str, modes: int, **changes: Any) -> PayloadEstimator:
    return RecursivePredictionError(robot, model, modes, settings=RpeSettings(**changes))


BUILDERS: dict[str, Builder] = {'sf1_paper': _sf1_paper, 'sf1': _sf1, 'rpe': _rpe}


def coriolis_of(name: str, robot: Robot, model: str) -> bool | None:
    """
    Return whether an estimator's model has Coriolis forces; None where it finds that out itself.

    SF1 is linear, as in the paper. rpe decides by the measurements, unless the robot file names
    these forces.
    """
    if name != 'rpe' or model not in WITH_CORIOLIS:
        return False
    effects = effects_of(robot)
    named = any(isinstance(effect, CoriolisCentripetal) for effect in effects)
    return has_coriolis(effects) if named else None


def described(name: str, robot: Robot, model: str, modes: int) -> str:
    """Return a line on an estimator's model, and what that leaves out of the robot file."""
    words = model_words(robot.name, model, modes, coriolis_of(name, robot, model))
    return words + (left_out(robot) if name != 'rpe' else '')


def make_estimator(name: str, robot: Robot, model: str, modes: int,
                   **changes: Any) -> PayloadEstimator:
    """
    Return an estimator by name.

    Parameters
    ----------
    name : str
        'sf1_paper': as printed; 'sf1': resolvent split, normalised; 'rpe': recursive
        prediction error.
    robot : Robot
        The arm; SF1 takes of its effects those that change parameters.
    model : str
        'paper_reduced', 'paper' or 'assumed_modes'.
    modes : int
        Modes per link.
    **changes
        Settings of the estimator that differ from its defaults.

    Raises
    ------
    InputError
        The name is unknown.

    """
    if name not in BUILDERS:
        raise InputError(f'estimator: expected one of {", ".join(BUILDERS)}, got {name!r}')
    return BUILDERS[name](robot, model, modes, **changes)
