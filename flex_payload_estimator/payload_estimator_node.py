"""The node that estimates the payload: joint_states and strain in, payload and health out."""

from __future__ import annotations

import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.model_health import HealthReport, ModelHealth
from flex_payload_estimator.node_setup import estimator_of
from flex_payload_estimator.sample_node import Sample, SampleNode
from msg_config.contract_node import DIAGNOSTICS_INTERVAL, run
from msg_config.messages import (
    diagnostic_status,
    inertia_message,
    joint_state,
    nanoseconds,
    seconds,
)
from msg_config.ros import payload_message
import numpy as np

MESSAGES = {
    'ok': ('ok', 'ok'),
    'not_excited': ('ok', 'the arm does not move enough to tell the payload'),
    'model_suspect': ('warn', 'the innovation is larger than the model explains'),
    'input_rejected': ('warn', 'a measurement was not finite; the last good estimate is kept')}


class PayloadEstimatorNode(SampleNode):
    """
    Answers every sample with payload, payload/inertia and innovation of the same stamp.

    Diagnostics come once a second of data, at every change of status, and, where no data
    comes, once a second of wall time.
    """

    def __init__(self, **options: Any):
        super().__init__('payload_estimator', **options)
        self.estimator = self.configured(lambda: estimator_of(self.values))
        self.health = ModelHealth(self.channels, self.robot.sample_time)
        self._payload = self.publisher('payload')
        self._inertia = self.publisher('payload/inertia')
        self._innovation = self.publisher('innovation')
        self._estimate: Estimate | None = None
        self._reported, self._silent = 0, True
        self.listen('joint_states', 'strain')
        self.every(DIAGNOSTICS_INTERVAL, self._on_wall_timer)

    def restart(self) -> None:
        """Forget everything."""
        self.estimator.reset()
        self.health.reset()
        self._estimate, self._reported = None, 0

    def take(self, sample: Sample) -> tuple[Any, ...]:
        """Return the messages that answer a sample."""
        before, estimate = self._estimate, self.estimator.update(
            sample.time, sample.output, sample.command)
        self._estimate = estimate
        messages = self._messages(sample.stamp, estimate)
        self.answer(messages)
        if estimate.status != 'input_rejected':
            self.health.add(estimate.innovation, estimate.innovation_std)
        changed = before is None or before.status != estimate.status
        if changed or sample.stamp - self._reported >= nanoseconds(DIAGNOSTICS_INTERVAL):
            self._report(sample.stamp)
        return messages

    def answer(self, messages: tuple[Any, ...]) -> None:
        """Publish the payload first: somebody waits for it."""
        payload, inertia, innovation = messages
        if payload is None:
            return
        self._payload.publish(payload)
        self._inertia.publish(inertia)
        if innovation is not None:
            self._innovation.publish(innovation)

    def _messages(self, stamp: int, estimate: Estimate) -> tuple[Any, Any, Any]:
        if not np.all(np.isfinite((estimate.mass, estimate.variance, estimate.p))):
            self.reject('payload', f'the estimate at {seconds(stamp):.9g} s is not finite')
            return None, None, None
        fresh = estimate.status != 'input_rejected' and np.all(np.isfinite(
            (estimate.innovation, estimate.innovation_std)))
        innovation = joint_state(
            stamp, self.channels, estimate.innovation,
            effort=estimate.innovation_std) if fresh else None
        return (payload_message(estimate.mass, estimate.variance, estimate.p),
                inertia_message(stamp, estimate.mass), innovation)

    def _on_wall_timer(self) -> None:
        if self._silent:
            self._report(self.order.last or 0)
        self._silent = True

    def _report(self, stamp: int) -> None:
        self._reported, self._silent = stamp, False
        self.publish_diagnostics(stamp, [
            self._estimator_status(), self.sample_status(), model_status(self.health.report())])

    def _estimator_status(self) -> DiagnosticStatus:
        if self._estimate is None:
            return diagnostic_status('payload_estimator: estimate', 'stale', 'no sample yet', {})
        estimate = self._estimate
        level, text = MESSAGES.get(estimate.status, ('ok', estimate.status))
        return diagnostic_status('payload_estimator: estimate', level, text, {
            'status': estimate.status, 'time s': float(estimate.time),
            'mass kg': float(estimate.mass),
            'standard deviation kg': float(np.sqrt(max(estimate.variance, 0.0)))})


def model_status(report: HealthReport) -> DiagnosticStatus:
    """Return the model's health as a status: normalised innovation squared and whiteness."""
    values: dict[str, object] = {
        'window samples': report.samples, 'diagnosis worth running': report.diagnose}
    for channel in report.channels:
        values[f'{channel.name} nis'] = channel.nis
        values[f'{channel.name} whiteness'] = channel.whiteness
        values[f'{channel.name} shape'] = channel.shape
    suspect = any(channel.suspect for channel in report.channels)
    return diagnostic_status('payload_estimator: model', 'warn' if suspect else 'ok',
                             report.text, values)


def main() -> None:
    """Run the node until Ctrl-C."""
    sys.exit(run(PayloadEstimatorNode))


if __name__ == '__main__':
    main()
