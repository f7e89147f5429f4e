"""
The node that controls the arm.

In: joint_states, strain, payload/inertia, reference. Out: command and diagnostics.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
import math
from typing import Any

from flex_payload_estimator.control.arm_watch import ArmWatch
from flex_payload_estimator.control.safeguards import CommandLimiter
from flex_payload_estimator.control.trajectory import ReferenceTrajectory
from flex_payload_estimator.model.linear_robot import left_out
from flex_payload_estimator.nodes.node_setup import (
    announced_controller,
    check_square,
    set_points_of,
)
from flex_payload_estimator.nodes.payload_arrivals import PayloadArrivals
from flex_payload_estimator.nodes.reference import Reference
from flex_payload_estimator.nodes.sample_node import SampleNode, StampedSample
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.gate import angle_ranges, COMMAND_MARGIN, Limits
from flex_plant_sim.simulation.nominal import model_words
from flex_plant_sim.simulation.plant_setup import robot_of
from geometry_msgs.msg import InertiaStamped
from msg_config.contract import COMMAND_TIMEOUT
from msg_config.contract_node import DIAGNOSTICS_INTERVAL
from msg_config.errors import InputError
from msg_config.messages import (
    checked_stamp,
    joint_state,
    payload_mass,
    seconds,
)
from msg_config.time_stamp import NANOSECONDS
from msg_config.wire import MessageWriter
import numpy as np
from rclpy.duration import Duration
from trajectory_msgs.msg import JointTrajectory

# Interval of the watchdog, s: it looks twice in the time that drives wait.
WATCH_INTERVAL = 0.5 * COMMAND_TIMEOUT
# Share of the largest payload by which an estimate may lie outside without a word: one near a
# bound errs to either side.
CLIPPED = 0.1
# Parameters of the square set-points.
SQUARE = ('reference_amplitude', 'reference_period')


class LQGControllerNode(SampleNode):
    """
    Answers every sample with the command of the same stamp.

    With `adapt` it waits for payload/inertia of the sample's stamp (topic payload, a std_msgs/
    Float64MultiArray, has no stamp). Where the next sample comes first, the estimator is late or
    gone, and the last payload serves until payloads are in time again. Set-points are a square
    wave until `reference` comes.

    A sample that cannot be used leaves the command as it is, as does one whose command is not
    finite, after which the controller begins again. From the second in a row on the command
    is zero, as it is where no sample comes for the watchdog's time. Samples that
    come later are used again; after the watchdog's time the predictor begins anew. Where samples
    come at another rate than told, the command is zero as long as they do. Where an angle
    or a strain contradicts the others (`ArmWatch`), the command is zero until ~/reset: no sample
    tells where the arm is. No stop keeps to command_slew.
    """

    # Less than an estimator's, because a late command does harm: a twentieth of a second at 1 kHz.
    WAITING = 0.05

    def __init__(self, **options: Any):
        self.limiter, self.reference = CommandLimiter(), Reference()
        self._asked: Array | None = None
        self._sent_at: int | None = None
        super().__init__('lqg_controller', **options)
        # What was sent is applied, from the start on, where no effort says otherwise.
        self.acting.forget(self.limiter.sent)
        self._command = self.publisher('command')
        self._writer = MessageWriter(
            joint_state(0, self._efforts.names, effort=self.limiter.sent), 'header', 'effort')
        self._unusable, self._lost = 0, 0
        self._answered, self._stopped = self.wall_time(), False
        self.subscribe('reference', self._on_reference)
        self.every(WATCH_INTERVAL, self._watch)
        self._waiting: StampedSample | None = None
        self.payloads, self._wild = PayloadArrivals(), ''
        self.subscribe('payload/inertia', self._on_inertia)
        self.listen()
        self.every(DIAGNOSTICS_INTERVAL, self.report, always=True)
        self.bring_up()

    def cease(self) -> None:
        """Leave the arm with a command of zero."""
        self.restart()
        stopped, last = self.limiter.stop(), self._last()
        if last is not None:
            self._send(stopped, last)
            self._command.wait_for_all_acked(Duration(seconds=COMMAND_TIMEOUT))

    def build(self, values: dict[str, Any]) -> Any:
        """Return the robot and the controller that the parameters describe."""
        robot = robot_of(values)
        check_square(values, robot)
        return robot, announced_controller(values)

    def install(self, built: Any) -> None:
        """Take over the robot and controller that `build` returned."""
        robot, self.controller = built
        words = model_words(robot.name, self.values['model'], self.values['modes'], coriolis=False)
        self.get_logger().info(f'designed for {words}{left_out(robot)}')
        self.take_robot(robot)
        self.watch = ArmWatch(robot, self.controller, self.values['command_limit'])
        if self.watch.unwatched:
            self.get_logger().info(self.watch.unwatched)
        self.reference.default(set_points_of(self.values))
        self.on_live(self.values)

    def on_live(self, changed: dict[str, Any]) -> None:
        """Apply changed limits and square set-points at once, as the watchdog's time is."""
        values = {**self.values, **changed}
        if any(name in changed and changed[name] != self.values[name] for name in SQUARE):
            if self.reference.given:
                raise InputError('reference_amplitude, reference_period: the set-points come from '
                                 'topic reference')
            check_square(values, self.robot)
            self.reference.default(set_points_of(values))
        self.controller.limit_commands(values['command_limit'])
        self.gate.limits = replace(self.gate.limits, command=np.minimum(
            Limits.of(self.robot).command,
            COMMAND_MARGIN * max(values['command_limit'], self.values['command_limit'])))
        self.limiter.limit, self.limiter.slew = values['command_limit'], values['command_slew']
        if values['command_limit'] != self.watch.limit:
            self.watch = self.watch.with_limit(values['command_limit'])

    def restart(self) -> None:
        """Go back to the start; what was last asked of and sent to the arm stays, at rest."""
        self.controller.reset()
        if self._asked is not None:
            self.reference.hold(self._asked)
        self.acting.forget(self.limiter.sent)
        self._unusable, self._lost, self._waiting = 0, 0, None
        self.payloads.restart()
        self._wild = ''
        self.watch.restart()

    def start_over(self) -> None:
        """Be as at the start, which alone ends a stop for a sensor's fault."""
        super().start_over()
        self.watch.reset()

    def take(self, sample: StampedSample) -> Any:
        """Return the command that answers a sample, or None while it waits for the payload."""
        if not self.values['adapt']:
            return self._control(sample, math.nan)
        if self._waiting is not None and self._waiting.stamp != sample.stamp:
            # Answer it late rather than never: the predictor must not miss a step.
            waiting, self._waiting = self._waiting, None
            self._control(waiting, self.payloads.overtaken())
        if sample.stamp not in self.payloads.early and not self.payloads.late:
            self._waiting = sample
            return None
        self._waiting = None
        return self._control(sample, self.payloads.take(sample.stamp, self.wall_time()))

    def _on_inertia(self, message: InertiaStamped) -> None:
        """Answer the sample that waits for this payload, or keep the payload until it comes."""
        stamp, mass = checked_stamp(message, 'payload/inertia'), payload_mass(message)
        self.payloads.last = mass
        self._note_range(mass)
        if self._waiting is not None and stamp == self._waiting.stamp:
            sample, self._waiting = self._waiting, None
            self.payloads.count(True, self.wall_time())
            self.remember(self._control(sample, mass))
        elif self.order.last is None or stamp > self.order.last:
            self.payloads.keep(stamp, mass)
        else:
            self.payloads.count(stamp == self.order.last, self.wall_time())

    def _note_range(self, mass: float) -> None:
        """Say once that a payload is beyond what is believed, and in diagnostics while it is."""
        payload_max = self.controller.payload_max
        believable = -CLIPPED * payload_max <= mass <= (1.0 + CLIPPED) * payload_max
        wild = self.values['adapt'] and not believable
        text = (f'payload/inertia: inertia.m: expected 0 to {payload_max:.4g} kg (payload_max), '
                f'got {mass:.4g}: the nearest serves') if wild else ''
        if wild and not self._wild:
            self.get_logger().warning(text)
        self._wild = text

    def _control(self, sample: StampedSample, mass: float) -> Any:
        """Publish and return the command that answers a sample at a payload, kg."""
        self._begin_again_if_lost(sample)
        slowness = self.slowness()
        if slowness:
            # The predictor takes a step a sample: one that misses steps would shake the arm.
            self.controller.reset()
        before = self.limiter.sent
        self._begin_reference(sample.time)
        self._asked = self.reference.set_points(sample.time)
        found = self.computed(sample.time, partial(
            self.controller.command, sample.time, sample.output, sample.command, mass,
            self._asked), np.ndarray.tolist)
        if self.controller.doubted:
            self.reject(
                'joint_states', f'joint_states, strain: at {sample.time:.12g} s too far from the '
                'prediction', 'outlier')
        self._lost = self._lost + 1 if found is None else 0
        wanted = before if found is None or self._unusable else found
        stops = self._faulty(sample, before) or slowness or max(self._unusable, self._lost) > 1
        answer = self._send(self.limiter.stop() if stops else self.limiter(
            wanted, self.robot.sample_time), sample.stamp)
        self._answered, self._stopped = self.wall_time(), False
        return answer

    def lose(self, time: float) -> None:
        """Say that the command at a time, s, is not finite, and reset the controller."""
        self.reject('command', f'the command at {time:.9g} s is not finite: the controller begins '
                               'again', 'not finite')
        self.controller.reset()

    def _faulty(self, sample: StampedSample, before: Array) -> bool:
        """Return whether a sensor drives the arm the wrong way; `before` was sent last, (2,)."""
        span = self.values['watchdog']
        if span and not self.watch.fault:
            self.watch(sample.time, sample.output, sample.velocity.tolist(), sample.command,
                       before, span)
            if self.watch.fault:
                self.get_logger().error(self._stop_text())
        return bool(span and self.watch.fault)

    def _stop_text(self) -> str:
        return f'{self.watch.fault}. The command is zero until ~/reset; watchdog 0 turns this off'

    def _begin_again_if_lost(self, sample: StampedSample) -> None:
        """Count unusable samples; reset the predictor after the watchdog's time of them."""
        if not all(map(math.isfinite, sample.output.tolist())):
            self._unusable += 1
            return
        if self._unusable * self.robot.sample_time > self.values['watchdog'] > 0.0:
            self.get_logger().warning(f'{self._unusable} samples said nothing: the predictor '
                                      'begins again')
            self.controller.reset()
        self._unusable = 0

    def _send(self, sent: Array, stamp: int) -> bytes:
        """Publish a command that the limiter let through."""
        self.acting.send(stamp, sent)
        self._sent_at = stamp
        message = self._writer(*divmod(stamp, NANOSECONDS), *self._efforts.outside(sent).tolist())
        self.answer(message)
        return message

    def answer(self, answer: Any) -> None:
        """Publish the command of a repeated sample again."""
        self._command.publish(answer)

    def _watch(self) -> None:
        """Send zero where no sample has come for the watchdog's time."""
        watchdog, last = self.values['watchdog'], self._last()
        age = self.wall_time() - self._answered
        if last is None or not watchdog or age < watchdog or not self.limiter.sent.any():
            return
        if not self._stopped:
            self._stopped = True
            self.get_logger().warning(f'no {self._missing()} for {age:.3g} s: the command is zero')
        # It carries the stamp of the last answer, so that a plant in lock-step, which waits for
        # the next one, passes it over. A sample that is repeated gets no older command any more.
        self.remember(self._send(self.limiter.stop(), last))

    def _last(self) -> int | None:
        """Return the stamp that a command without a sample carries, ns; None before the first."""
        return self._sent_at if self.order.last is None else self.order.last

    def _missing(self) -> str:
        """Return what a command waits for."""
        return 'sample' if self._waiting is None or self.silence() else 'payload/inertia'

    def _on_reference(self, message: JointTrajectory) -> None:
        """Replace the set-points, from the present ones on."""
        # Where no sample comes its time has gone on, nobody knows how far.
        last = None if self.silence() else self.order.last
        self.reference.take(partial(self._read, message), None if last is None else seconds(last))

    def _read(self, message: JointTrajectory, before: Array, now: float | None,
              ) -> ReferenceTrajectory:
        found = ReferenceTrajectory.of(message, self._joints, before, now,
                                       self.values['reference_shape'])
        low, high = angle_ranges(self.robot).T
        found.check_within(low, high, len(message.points))
        return found

    def _begin_reference(self, time: float) -> None:
        """Begin a reference that waited for a sample, whose time, s, it is judged by."""
        try:
            self.reference.begin(time)
        except InputError as error:
            self.reject('reference', str(error))

    def trouble(self) -> tuple[bool, ...]:
        """Return flags whose change is reported at once, with that of a late payload."""
        return (*super().trouble(), self.payloads.missing(self.wall_time()),
                bool(self.watch.fault), bool(self._wild))

    def report(self) -> None:
        """Publish the diagnostics."""
        status = self.status('command', *self._state(), {
            'time s': seconds(self.order.last or 0), 'command 1': float(self.limiter.sent[0]),
            'command 2': float(self.limiter.sent[1]), **self._watched()})
        self.publish_diagnostics([status, self.sample_status()])

    def _watched(self) -> dict[str, object]:
        """Return what the watches see: errors of gauges, and which velocities are used."""
        found: dict[str, object] = {
            f'velocity {k + 1} used': used for k, used in enumerate(self.watch.proved)}
        return {**found, **{f'{name} error': error
                            for name, error in self.watch.gauge_errors.items()}}

    def _state(self) -> tuple[str, str]:
        """Return level and text of the diagnostics on the commands."""
        if self.order.last is None:
            return 'stale', 'no sample yet'
        age = self.wall_time() - self._answered
        if self.values['watchdog'] and age > self.values['watchdog']:
            return 'error', f'no {self._missing()} for {age:.3g} s: the command is zero'
        if self.values['watchdog'] and self.watch.fault:
            return 'error', self._stop_text()
        slowness = self.slowness()
        if slowness:
            return 'error', f'{slowness}: the command is zero'
        if self.payloads.missing(self.wall_time()):
            return 'warn', 'payload/inertia is late or missing: the last payload serves'
        if self._unusable > 1:
            return 'error', f'{self._unusable} samples said nothing: the command is zero'
        if self._lost > 1:
            return 'error', f'{self._lost} samples gave no finite command: the command is zero'
        if self._wild:
            return 'warn', self._wild
        return 'ok', 'ok'
