"""A link whose damping ratio is the same at all frequencies, told where it may be the cause."""

from __future__ import annotations

from dataclasses import replace

from extended_arms import stiff
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.verdict.damping_law import constant_ratio_factor, with_damping_law
from flex_plant_sim.diagnosis.verdict.results import Cause, ParameterValue
from flex_plant_sim.effects import build, parse
import numpy as np
import pytest

ROBOT = load_robot('reference')


@pytest.mark.parametrize('payload', [0.05, 0.4])
def test_the_factor_of_a_lower_link_on_a_rigid_arm_is_rayleigh_s(payload: float) -> None:
    """sqrt(3 E I / ((m_p + 33/140 m) L^3)) of a cantilever with a mass at its end."""
    lower = ROBOT.links[1]
    robot = replace(stiff(ROBOT, 1e8), payload_mass=payload)
    robot = replace(robot, links=(robot.links[0], lower))
    loaded = np.sqrt(3.0 * lower.bending_stiffness
                     / ((payload + 33.0 / 140.0 * lower.mass) * lower.length**3))
    bare = 3.516 * np.sqrt(lower.bending_stiffness / (lower.mass * lower.length**3))
    assert constant_ratio_factor(robot, 1) == pytest.approx(bare / loaded, rel=0.01)


@pytest.mark.parametrize('low, high, said', [(3.0, 6.0, True), (1.5, 4.0, False),
                                             (6.0, 9.0, False)])
def test_a_damping_says_whether_a_constant_ratio_would_look_like_it(low: float, high: float,
                                                                    said: bool) -> None:
    factor = 0.5 * (low + high)
    effect = build(parse(f'modal_damping:link_1:factor={factor}'), ROBOT)
    cause = Cause('modal_damping', 'link_1', 'It is damped.', 0.8,
                  (ParameterValue('factor', factor, low, high, ''),), (), effect)
    assert constant_ratio_factor(ROBOT, 0) == pytest.approx(5.07, rel=0.01)
    found = with_damping_law(cause, ROBOT)
    assert ('factor of about 5.1' in found) == said and found.startswith('It is damped.')
