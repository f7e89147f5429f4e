"""A slow error of a gauge shows at rest and is no model's error, which goes with the motion."""

from __future__ import annotations

from collections.abc import Callable

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.gauss_newton import fit_set
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import log_prior_odds
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
import numpy as np
import pytest
from truth.records import make_record, TruthCase

ROBOT = load_robot('reference')
BASE = nominal_base(ROBOT, 'assumed_modes', 3)
TRUTH = make_record(TruthCase(9101))
# Gauges of the reference robot by label; both are on different links.
COLUMN = {'strain_1a': 0, 'strain_2b': 3}


def data_with(gauge: str, zero: np.ndarray) -> Data:
    """Return the record with a gauge's zero that moves, (N,)."""
    strain = TRUTH.strain.copy()
    strain[:, COLUMN[gauge]] += zero
    record = Record('', TRUTH.time, TRUTH.command, np.hstack([TRUTH.joint, strain]), 0.1)
    return Data.of([record], slowest_frequency(BASE, 0.1), ROBOT.sample_time)


def score_of_drift(gauge: str, zero: np.ndarray) -> float:
    """Return by how much a drift is likelier than nothing where a gauge's zero moves, nats."""
    data = data_with(gauge, zero)
    likelihood = Likelihood(BASE, data.windows, data.noise)
    drift, = (h for h in all_hypotheses(ROBOT) if h.label == f'strain_drift:{gauge}')
    found = fit_set(likelihood, CauseSet((drift,), data.duration), (np.zeros(1),))
    nothing = fit_set(likelihood, CauseSet((), data.duration), (np.zeros(0),))
    return found.log_evidence - nothing.log_evidence + log_prior_odds(drift.effect, ROBOT)


@pytest.mark.parametrize('gauge', COLUMN)
@pytest.mark.parametrize('shape', [
    lambda t: 3e-5 * t / t[-1], lambda t: 2.5e-5 * (1.0 - np.exp(-t / 30.0))],
    ids=['steady', 'warms up'])
def test_a_drift_that_shows_at_rest_is_told(
        gauge: str, shape: Callable[[np.ndarray], np.ndarray]) -> None:
    """It is 36 to 60 times the gauge's noise and 4 to 15 % of the rms strain."""
    assert score_of_drift(gauge, shape(TRUTH.time)) > 3.0


@pytest.mark.parametrize('gauge', COLUMN)
def test_an_arm_whose_gauges_are_right_has_no_drift(gauge: str) -> None:
    assert score_of_drift(gauge, np.zeros(TRUTH.time.size)) < -3.0


def test_an_error_that_goes_with_the_motion_is_no_drift() -> None:
    """A gauge may show 5 % too much, which no slow error does: as large as the drifts above."""
    assert score_of_drift('strain_1a', 0.05 * TRUTH.strain[:, 0]) < -3.0
