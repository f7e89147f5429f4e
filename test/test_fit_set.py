"""Sets fitted to simulated records: what a cause is worth, and what windows tell of errors."""

from __future__ import annotations

from flex_plant_sim.diagnosis.causes.gauss_newton import fit_set
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, CauseSet
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.effects import catalogue
import numpy as np
import pytest
from simulated_records import effects, REFERENCE, simulated


def test_a_cause_is_fitted_with_the_evidence_that_its_prior_leaves() -> None:
    hidden = effects('actuator_gain:joint_2:factor=1.2')
    nature = catalogue()['coriolis_centripetal']('arm', (1.0,))
    record = simulated((nature, *hidden), 30.0)
    base = BaseModel(REFERENCE, effects=(nature,))
    data = Data.of([record], 10.0, REFERENCE.sample_time)
    likelihood = Likelihood(base, data.windows, data.noise)
    gain, = (h for h in all_hypotheses(REFERENCE) if h.label == 'actuator_gain:joint_2')
    causes = CauseSet((gain,), data.duration)
    found = fit_set(likelihood, causes, (np.array([1.1]),))
    nothing = fit_set(likelihood, CauseSet((), data.duration), (np.zeros(0),))
    sure = 1.96 * np.sqrt(found.covariance[0, 0])
    assert abs(found.values[0] - 1.2) < max(sure, 0.01)
    assert found.log_evidence > nothing.log_evidence + 20.0


def test_some_windows_tell_the_slow_errors_of_all() -> None:
    record = simulated((), 60.0)
    data = Data.of([record], 10.0, REFERENCE.sample_time)
    likelihood = Likelihood(BaseModel(REFERENCE), data.windows, data.noise)
    nothing = CauseSet((), data.duration)
    count = likelihood.centre_residual.shape[1]
    some = likelihood.thinned(round(0.28 * count))
    assert some.weight > 3.0
    whole, part = (fit_set(of, nothing, (np.zeros(0),)) for of in (likelihood, some))
    # 64 means of each of four gauges tell their size to a tenth; unweighted, it was 1.8 times.
    found, expected = (np.sqrt(np.mean(fit.slow_scale[2:]**2)) for fit in (part, whole))
    assert found == pytest.approx(expected, rel=0.2)
    assert part.slow_means.tolist() == whole.slow_means.tolist()
