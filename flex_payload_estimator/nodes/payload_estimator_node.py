"""
The node that estimates the payload.

In: joint_states, strain, and command, by which it predicts ahead. Out: payload,
payload_stamped, payload/inertia, innovation, arm_markers and diagnostics with the model's health.
"""

from __future__ import annotations

from functools import partial
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from flex_payload_estimator.estimators.base import Estimate
from flex_payload_estimator.estimators.factory import described
from flex_payload_estimator.nodes.measured_shape import MeasuredShape
from flex_payload_estimator.nodes.model_health import HealthReport, ModelHealth
from flex_payload_estimator.nodes.node_setup import announced_estimator
from flex_payload_estimator.nodes.sample_node import SampleNode, StampedSample
from flex_plant_sim.inputs.gate import refuse_command
from flex_plant_sim.nodes.arm_markers import arm_markers
from flex_plant_sim.simulation.plant_setup import robot_of
from msg_config.contract_node import DIAGNOSTICS_INTERVAL, MARKER_INTERVAL
from msg_config.errors import InputError
from msg_config.messages import checked_stamp, joint_state, nanoseconds, seconds
from msg_config.ros import Audience, PayloadPublisher
from msg_config.time_stamp import NANOSECONDS
from msg_config.wire import MessageWriter
import numpy as np
from sensor_msgs.msg import JointState

# Level and text of the diagnostics for each status of the estimate.
MESSAGES = {
    'ok': ('ok', 'ok'),
    'not_excited': ('ok', 'the arm does not move enough to tell the payload'),
    'model_suspect': ('warn', 'no known model explains what is measured'),
    'restarted': ('error', 'the estimate was not finite; the last good one is kept'),
    'input_rejected': ('warn', 'a measurement was refused; the estimate is that without it')}
# Statuses that say nothing against the estimate.
CONFIDENT = ('ok', 'not_excited')
# Statuses whose estimate has no innovation of its own.
NO_INNOVATION = ('input_rejected', 'restarted')


class PayloadEstimatorNode(SampleNode):
    """
    Answers every sample with payload, payload_stamped, payload/inertia and innovation.

    All are of the sample's stamp.

    Diagnostics come once a second of wall time and at every change of status.
    """

    def __init__(self, **options: Any):
        super().__init__('payload_estimator', **options)
        self._payload = PayloadPublisher(self, self.values['frame_prefix'])
        self._innovation = self.publisher('innovation')
        self._markers, self._next_marker = self.publisher('arm_markers'), 0
        self._heard_innovation, self._seen = Audience(self._innovation), Audience(self._markers)
        empty = np.zeros(len(self.channels))
        self._writer = MessageWriter(joint_state(0, self.channels, empty, effort=empty),
                                     'header', 'position', 'effort')
        self._estimate: Estimate | None = None
        self._events = 0
        self._prepared: int | None = None
        self.subscribe('command', self._on_command, names=lambda: self._efforts)
        self.listen()
        self.every(DIAGNOSTICS_INTERVAL, self.report, always=True)
        self.bring_up()

    def build(self, values: dict[str, Any]) -> Any:
        """Return the robot and the estimator that the parameters describe."""
        return robot_of(values), announced_estimator(values)

    def install(self, built: Any) -> None:
        """Take over the robot and estimator that `build` returned."""
        robot, self.estimator = built
        name = self.values['estimator']
        self.get_logger().info(f'{name} with ' + described(
            name, robot, self.values['model'], self.values['modes']))
        self.shape = MeasuredShape.of(robot)
        self.take_robot(robot)
        self.health = ModelHealth(self.channels, robot.sample_time)

    def restart(self) -> None:
        """Go back to the start: forget estimate and health."""
        self.estimator.reset()
        self.health.reset()
        self._prepared = None
        self.acting.forget()
        self._estimate, self._events = None, 0

    def take(self, sample: StampedSample) -> Any:
        """Answer a new sample; the payload goes out first, because the controller waits for it."""
        estimate = self._estimate_of(sample)
        if estimate is None:
            return None
        if self.unknown_commands and estimate.status in CONFIDENT:
            estimate = estimate._replace(status='model_suspect')
        payload = self._payload.serialised(sample.stamp, estimate.mass, estimate.variance,
                                           estimate.p)
        self._payload.publish(payload)
        innovation = self._answer_innovation(sample.stamp, estimate)
        self.computed(sample.time, self.estimator.conclude, _numbers)
        self._watch(estimate)
        self._publish_markers(sample, estimate)
        return payload, innovation

    def _publish_markers(self, sample: StampedSample, estimate: Estimate) -> None:
        """Publish the arm as it is measured, if there is a subscriber."""
        if not self._seen or not np.isfinite(sample.output).all() \
                or 0 <= self._next_marker - sample.stamp < nanoseconds(MARKER_INTERVAL):
            return
        self._next_marker = sample.stamp + nanoseconds(MARKER_INTERVAL)
        self._markers.publish(arm_markers(
            sample.stamp, self.shape.lines(sample.output), estimate.mass, 'measured',
            self.values['frame_prefix']))

    def _estimate_of(self, sample: StampedSample) -> Estimate | None:
        """Return the estimate, or the last good one where the new one is not finite."""
        estimate = self.computed(sample.time, partial(
            self.estimator.update, sample.time, sample.output, sample.command), _numbers)
        return estimate or (
            self._estimate and self._estimate._replace(time=sample.time, status='restarted'))

    def lose(self, time: float) -> None:
        """Say that the estimate at a time, s, is not finite, and reset the estimator."""
        self.reject('payload', f'the estimate at {time:.9g} s is not finite: the estimator '
                               'begins again')
        self.estimator.reset()

    def _on_command(self, message: JointState) -> None:
        """Predict before the next sample comes, with the command that is applied until then."""
        stamp = checked_stamp(message, 'command')
        command = self._efforts.pick(message.name, message.effort, 'command: effort')
        if not self.gate.takes(command):
            refusal = refuse_command(command, self.gate.limits.command)
            raise InputError(f'command: effort: {refusal.text}')
        self.acting.send(stamp, command)
        if self._prepared != stamp == self.order.last:
            self._prepared = stamp
            self.computed(seconds(stamp), partial(self.estimator.prepare, command), _numbers)

    def answer(self, answer: tuple[Any, ...]) -> None:
        """Publish payload and innovation of a repeated sample again."""
        payload, innovation = answer
        self._payload.publish(payload)
        if innovation is not None:
            self._innovation.publish(innovation)

    def _answer_innovation(self, stamp: int, estimate: Estimate) -> bytes | None:
        """Publish the innovation, if there is one and a subscriber; return the message."""
        if estimate.status in NO_INNOVATION or not self._heard_innovation:
            return None
        numbers = (*estimate.innovation.tolist(), *estimate.innovation_std.tolist())
        if not all(map(math.isfinite, numbers)):
            return None
        innovation = self._writer(*divmod(stamp, NANOSECONDS), *numbers)
        self._innovation.publish(innovation)
        return innovation

    def _watch(self, estimate: Estimate) -> None:
        """Pass the innovation on to the model's health; report a new status or payload change."""
        before, self._estimate = self._estimate, estimate
        if estimate.status not in NO_INNOVATION:
            self.health.add(estimate.innovation, estimate.innovation_std)
        changed = before is None or before.status != estimate.status
        found, self._events = self._events, len(self.estimator.events)
        if changed or self._events > found:
            self.report()

    def report(self) -> None:
        """Publish the diagnostics."""
        self.publish_diagnostics([
            self._estimator_status(), self._change_status(), self.sample_status(),
            self._model_status(self.health.report())])

    def _change_status(self) -> DiagnosticStatus:
        changes = self.estimator.events
        if not changes:
            return self.status('payload change', 'ok', 'none', {})
        last = changes[-1]
        text = (f'the payload went from {last.before:.4g} to {last.after:.4g} kg at '
                f'{last.time:.6g} s, found at {last.found:.6g} s')
        return self.status('payload change', 'ok', text, {
            'count': len(changes), 'time s': float(last.time), 'found s': float(last.found),
            'before kg': float(last.before), 'after kg': float(last.after)})

    def _estimator_status(self) -> DiagnosticStatus:
        if self._estimate is None:
            return self.status('estimate', 'stale', 'no sample yet', {})
        estimate, silence = self._estimate, self.silence()
        level, text = MESSAGES.get(estimate.status, ('ok', estimate.status))
        if silence:
            level, text = 'stale', self._stale_text(silence)
        elif self.unknown_commands:
            text = self._counts.bursts or (
                f'the commands between samples are not known: {self.slowness()}')
        return self.status('estimate', level, text, {
            'status': estimate.status, 'time s': float(estimate.time),
            'mass kg': float(estimate.mass),
            'standard deviation kg': float(np.sqrt(max(estimate.variance, 0.0)))})

    def _stale_text(self, silence: str) -> str:
        return f'no sample for {self.wall_time() - self._sample_at:.3g} s: {silence}'

    def _model_status(self, report: HealthReport) -> DiagnosticStatus:
        """Return the model's health: normalised innovation squared and whiteness."""
        values: dict[str, object] = {
            'window samples': report.samples, 'diagnosis worth running': report.diagnose}
        for channel in report.channels:
            values[f'{channel.name} nis'] = channel.nis
            values[f'{channel.name} whiteness'] = channel.whiteness
            values[f'{channel.name} shape'] = channel.shape
        suspect, text = any(channel.suspect for channel in report.channels), report.text
        # Innovations are compared with what the estimator expects, which a misfit has widened.
        if not suspect and self._estimate and self._estimate.status == 'model_suspect':
            suspect, text = True, ('the innovations are as large as the estimator expects, but '
                                   f'{MESSAGES["model_suspect"][1]}')
        silence = self._estimate and self.silence()
        if silence:
            return self.status('model', 'stale', self._stale_text(silence), values)
        return self.status('model', 'warn' if suspect else 'ok', text, values)


def _numbers(estimate: Estimate) -> tuple[float, float, float]:
    """Return what must be finite in an estimate."""
    return estimate.mass, estimate.variance, estimate.p
