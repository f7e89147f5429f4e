"""What a sample beyond the gate was: a wrong reading or command, a push, a slip, a lost state."""

from __future__ import annotations

from dataclasses import dataclass
import math

from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.filter_step import FilterStep
from flex_payload_estimator.estimators.rpe.likelihood import false_alarm_threshold, MEMORY_S
from flex_payload_estimator.estimators.rpe.sensors import Loads
from flex_payload_estimator.estimators.rpe.zero import slip
import numpy as np

# A state that is begun again is compared after so many samples: two samples of six channels
# determine the ten numbers of a state of two modes a link, and the third compares.
RELOCATED_SAMPLES = 3
# Log-likelihood ratio, nats, from which the state was lost. A payload that is dropped looks like
# a lost state at first: 27 simulated picks and drops gained up to 30 nats, an arm set back by
# 0.3 rad 59 and more.
LOST_STATE_NATS = 48.0


@dataclass
class _Candidate:
    """
    A filter whose state, or whose zero of joint 2, was begun again at a sample.

    Attributes
    ----------
    kalman : Filter
        Its Kalman filter.
    log_ratio : float
        Log-likelihood ratio over the filter that went on, nats.
    samples : int
        Since then.

    """

    kalman: Filter
    log_ratio: float = 0.0
    samples: int = 0


class OutlierTests:
    """
    Tells what a sample beyond the gate was.

    A wrong reading is over with its sample, and the gate is enough. A wrong command, or a push,
    leaves a velocity that was not predicted; an arm that was moved by hand or set back leaves
    another state; a coupling that slips leaves another zero of joint 2's sensor. All look like
    another payload or another arm for seconds. So each is a hypothesis beside the filter
    (generalised likelihood ratio: Willsky, Automatica 12, 1976):

    * the same sample with an unknown command, taken where that brings it inside the gate and is
      likelier by the false-alarm threshold;
    * a state, or a zero of joint 2, that begins at the sample, taken where it is likelier by
      LOST_STATE_NATS over the next RELOCATED_SAMPLES; of both, the likelier.

    They happen at once: samples that go on to be beyond the gate within MEMORY_S come from
    another payload or a wrong model.

    Parameters
    ----------
    stepper : FilterStep

    """

    def __init__(self, stepper: FilterStep):
        self._stepper, self._threshold = stepper, false_alarm_threshold(stepper.step_time)
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._largest_commands, self._last_outlier = [0.0, 0.0], -math.inf
        self._candidates: list[_Candidate] = []

    def resolve(self, learnt: Filter, sample: Sample, loads: Loads
                ) -> tuple[Filter, Sample, bool]:
        """
        Return filter and sample under the likeliest hypothesis, and whether it began again.

        Parameters
        ----------
        learnt : Filter
            Has just predicted the sample and learnt from it.
        sample : Sample
            What it learnt from.
        loads : Loads
            Before the sample.

        """
        after = learnt
        for joint, command in enumerate(sample.command.tolist()):
            if abs(command) > self._largest_commands[joint]:
                self._largest_commands[joint] = abs(command)
        if sample.measured is None:
            self._candidates = []
            return after, sample, False
        if after.mode.payload_walk > 0.0:
            after = self._stepper.after_jump(learnt, sample, loads)
        if self._candidates:
            found = self._compare(after, sample, loads)
            return found or after, sample, found is not None
        if sample.time - self._last_outlier < MEMORY_S \
                or not self._stepper.is_beyond_gate(after.mean_square):
            return after, sample, False
        self._last_outlier = sample.time
        unknown = self._with_unknown_command(learnt.before_prediction(), after, sample, loads)
        if unknown is not None:
            return *unknown, False
        lost, slipped = (_Candidate(learnt.before_prediction()) for _ in range(2))
        self._stepper.relocate(lost.kalman, sample.measured)
        slip(slipped.kalman)
        # What the sample itself says of where a state or a zero begins does not count.
        self._stepper.step(slipped.kalman, sample, loads)
        self._candidates = [lost, slipped]
        return after, sample, False

    def _with_unknown_command(self, f: Filter, after: Filter, sample: Sample, loads: Loads
                              ) -> tuple[Filter, Sample] | None:
        """Return filter and sample with an unknown command, where that explains the sample."""
        other = sample._replace(command_variance=np.square(self._largest_commands))
        self._stepper.step(f, other, loads)
        if self._stepper.is_beyond_gate(f.mean_square) \
                or not f.stated_log_density > after.stated_log_density + self._threshold:
            return None
        return f, other

    def _compare(self, after: Filter, sample: Sample, loads: Loads) -> Filter | None:
        """Step the filters that were begun again; return one once it is likely enough."""
        for candidate in self._candidates:
            self._stepper.step(candidate.kalman, sample, loads)
            candidate.log_ratio += candidate.kalman.stated_log_density - after.stated_log_density
            candidate.samples += 1
        best = max(self._candidates, key=lambda candidate: candidate.log_ratio)
        if best.samples < RELOCATED_SAMPLES:
            return None
        self._candidates = []
        return best.kalman if best.log_ratio > LOST_STATE_NATS else None
