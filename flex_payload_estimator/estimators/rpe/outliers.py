"""What a sample beyond the gate was: a wrong reading, a wrong command or push, or a lost state."""

from __future__ import annotations

from dataclasses import dataclass
import math

from flex_payload_estimator.estimators.rpe.compiled_step import GATE
from flex_payload_estimator.estimators.rpe.filter import Filter, Sample
from flex_payload_estimator.estimators.rpe.filter_step import FilterStep
from flex_payload_estimator.estimators.rpe.likelihood import false_alarm_threshold, MEMORY_S
from flex_payload_estimator.estimators.rpe.sensors import Loads
import numpy as np

# A state that is begun again is compared after so many samples: two samples of six channels
# determine the ten numbers of a state of two modes a link, and the third compares.
RELOCATED_SAMPLES = 3
# Log-likelihood ratio, nats, from which the state was lost. A payload that is dropped looks like
# a lost state at first: 27 simulated picks and drops gained up to 30 nats, an arm set back by
# 0.3 rad 59 and more.
LOST_STATE_NATS = 48.0


@dataclass
class _RelocatedFilter:
    """
    A filter whose state was begun again at a sample.

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
    another state. Both look like another payload or another arm for seconds. So each is a
    hypothesis beside the filter (generalised likelihood ratio: Willsky, Automatica 12, 1976):

    * the same sample with an unknown command, taken where that brings it inside the gate and is
      likelier by the false-alarm threshold;
    * a state that begins at the sample, taken where it is likelier by LOST_STATE_NATS over the
      next RELOCATED_SAMPLES.

    Both happen at once: samples that go on to be beyond the gate within MEMORY_S come from
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
        self._relocated: _RelocatedFilter | None = None

    def resolve(self, learnt: Filter, sample: Sample, loads: Loads
                ) -> tuple[Filter, Sample, bool]:
        """
        Return filter and sample under the likeliest hypothesis, and whether the state was lost.

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
            self._relocated = None
            return after, sample, False
        if after.mode.payload_walk > 0.0:
            after = self._stepper.after_jump(learnt, sample, loads)
        if self._relocated is not None:
            found = self._compare(self._relocated, after, sample, loads)
            return found or after, sample, found is not None
        if sample.time - self._last_outlier < MEMORY_S \
                or not self._is_beyond_gate(after, sample):
            return after, sample, False
        self._last_outlier = sample.time
        unknown = self._with_unknown_command(learnt.before_prediction(), after, sample, loads)
        if unknown is not None:
            return *unknown, False
        self._relocated = _RelocatedFilter(learnt.before_prediction())
        self._stepper.relocate(self._relocated.kalman, sample.measured)
        return after, sample, False

    def _is_beyond_gate(self, f: Filter, sample: Sample) -> bool:
        assert sample.measured is not None
        return f.mean_square * sample.measured.size >= GATE

    def _with_unknown_command(self, f: Filter, after: Filter, sample: Sample, loads: Loads
                              ) -> tuple[Filter, Sample] | None:
        """Return filter and sample with an unknown command, where that explains the sample."""
        other = sample._replace(command_variance=np.square(self._largest_commands))
        self._stepper.step(f, other, loads)
        if self._is_beyond_gate(f, sample) \
                or not f.stated_log_density > after.stated_log_density + self._threshold:
            return None
        return f, other

    def _compare(self, relocated: _RelocatedFilter, after: Filter, sample: Sample, loads: Loads
                 ) -> Filter | None:
        """Step a filter whose state was begun again; return it once it is likely enough."""
        self._stepper.step(relocated.kalman, sample, loads)
        relocated.log_ratio += relocated.kalman.stated_log_density - after.stated_log_density
        relocated.samples += 1
        if relocated.samples < RELOCATED_SAMPLES:
            return None
        self._relocated = None
        return relocated.kalman if relocated.log_ratio > LOST_STATE_NATS else None
