"""What a sample beyond the gate is: a wrong reading, a wrong command or push, or a lost state."""

from __future__ import annotations

from dataclasses import dataclass
import math

from flex_payload_estimator.estimators.rpe.evidence import MEMORY_S, rare
from flex_payload_estimator.estimators.rpe.filter import FilterStep
from flex_payload_estimator.estimators.rpe.hypothesis import Filter, Sample
from flex_payload_estimator.estimators.rpe.onward import GATE
from flex_payload_estimator.estimators.rpe.sensors import Loads
import numpy as np

# Two samples of six channels tell the ten numbers of a state of two modes a link; one more judges.
JUDGED = 3
# A payload that is dropped looks like a lost state at first: 27 simulated picks and drops gained
# up to 30 nats, an arm set back by 0.3 rad 59 and more.
LOST = 48.0


@dataclass
class _Relocated:
    """A filter whose state began at a sample, what it gained since, nats, and in how many."""

    runner: Filter
    gain: float = 0.0
    samples: int = 0


class Shocks:
    """
    Tells what became of a sample that is past the gate.

    A wrong reading is over with its sample, and the gate is enough. A wrong command, or a push,
    leaves a speed that was never predicted, and an arm that was moved or set back a state: both
    look like another payload or another arm for seconds. So each is a hypothesis beside the
    filter, taken where it gains what is rare, or LOST nats (generalised likelihood ratio: Willsky,
    Automatica 12, 1976): the same sample with a command that may have been anything, where that
    fits; a state that begins at the sample, judged by the JUDGED samples after it. Both come at
    once: what is past the gate again within MEMORY_S is another payload or a wrong model.

    Parameters
    ----------
    stepper : FilterStep

    """

    def __init__(self, stepper: FilterStep):
        self._stepper, self._rare = stepper, rare(stepper.step_time)
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._largest, self._last = [0.0, 0.0], -math.inf
        self._relocated: _Relocated | None = None

    def taken(self, learnt: Filter, sample: Sample, loads: Loads
              ) -> tuple[Filter, Sample, bool]:
        """
        Return filter and sample as they are to be believed, and whether the state was lost.

        Parameters
        ----------
        learnt : Filter
            One that has just predicted the sample, and learnt from it.
        sample : Sample
            What it learnt from.
        loads : Loads
            Of late.

        """
        after = learnt
        for joint, command in enumerate(sample.command.tolist()):
            if abs(command) > self._largest[joint]:
                self._largest[joint] = abs(command)
        if sample.measured is None:
            self._relocated = None
            return after, sample, False
        if after.mode.walk > 0.0:
            after = self._stepper.jumped(learnt, sample, loads)
        if self._relocated is not None:
            found = self._judged(self._relocated, after, sample, loads)
            return found or after, sample, found is not None
        if sample.time - self._last < MEMORY_S or not self._past_gate(after, sample):
            return after, sample, False
        self._last = sample.time
        doubted = self._doubted(learnt.before(), after, sample, loads)
        if doubted is not None:
            return *doubted, False
        self._relocated = _Relocated(learnt.before())
        self._stepper.relocate(self._relocated.runner, sample.measured)
        return after, sample, False

    def _past_gate(self, f: Filter, sample: Sample) -> bool:
        assert sample.measured is not None
        return f.square * sample.measured.size >= GATE

    def _doubted(self, doubted: Filter, after: Filter, sample: Sample, loads: Loads
                 ) -> tuple[Filter, Sample] | None:
        """Return filter and sample with a free command, where that explains the sample."""
        other = sample._replace(doubt=np.square(self._largest))
        self._stepper.step(doubted, other, loads)
        if self._past_gate(doubted, sample) or not doubted.stated > after.stated + self._rare:
            return None
        return doubted, other

    def _judged(self, trial: _Relocated, after: Filter, sample: Sample, loads: Loads
                ) -> Filter | None:
        """Return the filter whose state began afresh, once it has gained enough."""
        self._stepper.step(trial.runner, sample, loads)
        trial.gain += trial.runner.stated - after.stated
        trial.samples += 1
        if trial.samples < JUDGED:
            return None
        self._relocated = None
        return trial.runner if trial.gain > LOST else None
