"""One covariance for all hypotheses: what a filter of one's own must not decide."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.prediction import recursion
from flex_plant_sim.diagnosis.prediction.scheduled_matrices import ScheduledMatrices
from flex_plant_sim.diagnosis.prediction.sensor_map import shifted
from flex_plant_sim.diagnosis.prediction.whitening import (
    output_error,
    WhiteningFilter,
)
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
import numpy as np
import pytest
from truth.records import draw_case, make_record

SAMPLES, STATES, OUTPUTS = 40, 3, 2
ROWS = np.arange(SAMPLES)[:, None]


class Arm:
    """A linear arm with a gain, drawn at random."""

    def __init__(self, seed: int, gain: float) -> None:
        rng = np.random.default_rng(seed)
        self.f = 0.9 * np.linalg.qr(rng.standard_normal((STATES, STATES)))[0]
        self.c = rng.standard_normal((OUTPUTS, STATES))
        self.k = gain * rng.standard_normal((STATES, OUTPUTS))

    @property
    def matrices(self) -> ScheduledMatrices:
        """Return the predictor's matrices, the same at every sample."""
        return ScheduledMatrices(
            np.zeros((SAMPLES, 2), dtype=int), np.full((SAMPLES, 2), 0.5),
            np.vstack([(self.f - self.k @ self.c).T, self.k.T])[None])

    def errors(self, outputs: np.ndarray) -> np.ndarray:
        """Return what its predictor errs on outputs (S, m) from zero on."""
        state, found = np.zeros(STATES), []
        for y in outputs:
            found.append(y - self.c @ state)
            state = self.f @ state + self.k @ found[-1]
        return np.array(found)

    def covariance(self) -> np.ndarray:
        """Return that of its outputs where its predictor errs by white unit noise, (Sm, Sm)."""
        response = np.zeros((SAMPLES, OUTPUTS, SAMPLES, OUTPUTS))
        for k in range(SAMPLES):
            for j in range(OUTPUTS):
                state = self.k[:, j]
                response[k, j, k, j] = 1.0
                for later in range(k + 1, SAMPLES):
                    response[later, :, k, j] = self.c @ state
                    state = self.f @ state
        dense = response.reshape(SAMPLES * OUTPUTS, -1)
        return dense @ dense.T


def test_what_a_record_is_on_average_hangs_on_no_gain() -> None:
    outputs = np.random.default_rng(1).standard_normal((SAMPLES, OUTPUTS))
    for gain in (0.0, 0.1, 0.5):
        arm = Arm(2, gain)
        errors = arm.errors(outputs)[:, None, None]
        # From zero and without inputs an arm does nothing on average.
        assert output_error(arm.matrices, arm.c, errors, ROWS)[:, 0, 0] == pytest.approx(outputs)


@pytest.mark.parametrize('loops', [COMPILED, False])
def test_without_corrections_an_arm_does_the_same(loops: bool, monkeypatch: pytest.MonkeyPatch
                                                  ) -> None:
    # From where the filter is after some samples: its errors taken back, or none corrected.
    monkeypatch.setattr(recursion, 'COMPILED', loops)
    arm, warm_up = Arm(5, 0.3), 10
    outputs = np.random.default_rng(6).standard_normal((SAMPLES, OUTPUTS))
    errors = arm.errors(outputs)[warm_up:, None, None]
    expected = output_error(arm.matrices, arm.c, errors, ROWS[warm_up:])
    states = recursion.propagate(arm.matrices, outputs[:, None], np.zeros((1, STATES)), ROWS, None,
                                 arm.c, warm_up)
    found = outputs[:, None, None] - states @ arm.c.T
    assert found[warm_up:] == pytest.approx(expected)


def test_it_is_whitened_by_the_covariance_of_the_nominal_arm() -> None:
    nominal, left = Arm(3, 0.2), np.random.default_rng(4).standard_normal((SAMPLES, OUTPUTS))
    whitening = WhiteningFilter(nominal.matrices, nominal.c)
    white = whitening.whitened(left[:, None, None], ROWS)[:, 0, 0]
    dense = np.linalg.solve(np.linalg.cholesky(nominal.covariance()), left.ravel())
    assert white.ravel() == pytest.approx(dense)


def test_what_is_read_late_is_advanced_and_put_back() -> None:
    left, late = np.arange(12.0).reshape(4, 3), np.array([2, 0, 1])
    ahead, back = shifted(left, late), shifted(left, -late)
    assert ahead[:, 1] == pytest.approx(left[:, 1]) and back[:, 1] == pytest.approx(left[:, 1])
    assert ahead[:, 0] == pytest.approx([6.0, 9.0, 9.0, 9.0])
    assert back[:, 0] == pytest.approx([0.0, 0.0, 0.0, 3.0])
    assert back[:, 2] == pytest.approx([2.0, 2.0, 5.0, 8.0])


def test_an_inertia_that_only_calms_the_filter_is_not_paid_for() -> None:
    # The filter of an arm with twice the inertia is moved less by noise, so it errs less by
    # a sample although it is wrong: 16 nats, and every clean arm of this make had one.
    robot = load_robot('quanser_2dsfl')
    case = replace(draw_case(None, 1030, 'quanser_2dsfl'), duration_s=22.0)
    made, base = make_record(case), nominal_base(robot, 'assumed_modes', 3, True)
    record = Record('clean', made.time - made.time[0], made.command,
                    np.column_stack([made.joint, made.strain]), case.payload_told)
    data = Data.of([record], slowest_frequency(base, record.payload), robot.sample_time)
    hub = next(h for h in all_hypotheses(robot) if h.label == 'hub_inertia:joint_1')
    nothing = RefinedFit.refine(CandidateSet((), (np.zeros(0),)), base, data).fit
    found = RefinedFit.refine(CandidateSet((hub,), (np.array([0.06]),)), base, data).fit
    assert found.values == pytest.approx([0.0], abs=0.01)
    assert found.log_evidence < nothing.log_evidence + 1.0
