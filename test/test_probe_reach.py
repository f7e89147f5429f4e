"""Fits start as far from null as what hides in an experiment may be."""

from __future__ import annotations

from bank.sizes import read_limits
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, Hypothesis
import numpy as np
import pytest

# A fit from a third of a size gets there; what is four detection limits large is to be named.
LIMITS, SHARE = 4.0, 1.0 / 3.0


def reach_and_room(hypothesis: Hypothesis) -> tuple[float, float]:
    """Return how far from null the first size is probed, and how far it may be."""
    first = int(np.argmax(hypothesis.is_size))
    p = hypothesis.parameters[first]
    reach = max(abs(deviation[first]) for deviation in hypothesis.probe_deviations())
    return reach, max(p.null - p.low, p.high - p.null)


@pytest.mark.parametrize('robot', ['reference', 'quanser_2dsfl'])
def test_probes_reach_what_is_to_be_named(robot: str) -> None:
    limits = read_limits()[robot].value
    known = [h for h in all_hypotheses(load_robot(robot))
             if h.label in limits and not h.effect.linear]
    assert len({h.label for h in known}) > 30
    for hypothesis in known:
        reach, room = reach_and_room(hypothesis)
        assert reach >= SHARE * min(LIMITS * limits[hypothesis.label], room), hypothesis.label
