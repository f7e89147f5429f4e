"""Builds estimator, controller and set-points from the checked parameters of the nodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from flex_payload_estimator.control.lqg import controlled, LQGController, LQGSettings
from flex_payload_estimator.control.set_points import SetPoints, square
from flex_payload_estimator.estimators.base import PayloadEstimator
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.estimators.rpe.compiled_step import step_packed
from flex_payload_estimator.estimators.sf1.settings import SF1Settings
from flex_payload_estimator.kalman.predictor import predicted
from flex_payload_estimator.model.linear_robot import linear_robot
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.compiled import say_if_compiling
from flex_plant_sim.simulation.plant_setup import robot_of
from msg_config.errors import InputError


def estimator_of(values: Mapping[str, Any]) -> PayloadEstimator:
    """
    Return the estimator that checked parameters of payload_estimator describe.

    Raises
    ------
    InputError
        A parameter does not fit; the message names it, what was expected and what came.

    """
    name = values['estimator']
    changes = _sf1_changes(values) if name.startswith('sf1') else {}
    if values['payload_max']:
        changes['payload_max'] = values['payload_max']
    return make_estimator(name, robot_of(values), values['model'], values['modes'], **changes)


def _sf1_changes(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of an SF1 estimator that parameters give."""
    sf1 = SF1Settings(values['alpha_0'], values['alpha_1'], values['p_0'],
                      values['payload_initial'], values['payload_variance_initial'])
    changes = {'r_1': values['r_1'], 'r_2': values['r_2'], 'terms': values['n_prime'],
               'sf1': sf1}
    if values['estimator'] == 'sf1':
        changes['regression'] = values['regression']
    return changes


def controller_of(values: Mapping[str, Any]) -> LQGController:
    """
    Return the controller that checked parameters of lqg_controller describe.

    Raises
    ------
    InputError
        A parameter does not fit; the message names it, what was expected and what came.

    """
    robot = robot_of(values)
    settings = LQGSettings(
        adapt=values['adapt'], mass_0=values['payload_initial'],
        payload_max=values['payload_max'] or None, q_2=values['q_2'],
        r_1=values['r_1'], r_2=values['r_2'], terms=values['n_prime'],
        integrator=values['integrator'], command_limit=values['command_limit'])
    return LQGController(linear_robot(robot), values['model'], values['modes'], settings)


def announced_estimator(values: Mapping[str, Any]) -> PayloadEstimator:
    """Return the estimator; say on stderr before if it is about to be compiled."""
    say_if_compiling(step_packed if values['estimator'] == 'rpe' else predicted)
    return estimator_of(values)


def announced_controller(values: Mapping[str, Any]) -> LQGController:
    """Return the controller; say on stderr before if it is about to be compiled."""
    say_if_compiling(controlled)
    return controller_of(values)


def check_square(values: Mapping[str, Any], robot: Robot) -> None:
    """
    Check that both joints can reach the square set-points that lqg_controller's parameters give.

    Raises
    ------
    InputError
        The set-points lie beyond the angle limits of the robot file.

    """
    amplitude = float(values['reference_amplitude'])
    reach = min(min(-low, high) for low, high in robot.angle_limits)
    if amplitude > reach:
        raise InputError(f'reference_amplitude: expected at most {reach:g} rad, as the angle '
                         f'limits of {robot.source} allow, got {amplitude:g}')


def set_points_of(values: Mapping[str, Any]) -> SetPoints:
    """Return the square set-points that checked parameters of lqg_controller describe."""
    return square(values['reference_amplitude'], values['reference_period'])
