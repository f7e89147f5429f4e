"""
The node plant_sim, which takes the place of the real arm.

It receives commands, steps the simulator and publishes the sensor readings.
"""

from __future__ import annotations

import math
import time
from typing import Any

from flex_plant_sim.inputs.gate import Limits, refuse_command
from flex_plant_sim.nodes.arm_markers import arm_markers
from flex_plant_sim.simulation.arm_shape import ArmShape
from flex_plant_sim.simulation.nominal import has_coriolis, model_words
from flex_plant_sim.simulation.plant_setup import simulator_of
from msg_config.contract import COMMAND_TIMEOUT
from msg_config.contract_node import ContractNode, DIAGNOSTICS_INTERVAL, MARKER_INTERVAL
from msg_config.errors import InputError
from msg_config.input_mapping import JOINTS
from msg_config.messages import (
    check_finite,
    checked_stamp,
    clock_message,
    joint_state,
    nanoseconds,
    seconds,
)
from msg_config.recent_counts import RecentCounts
from msg_config.ros import Audience
from msg_config.time_stamp import NANOSECONDS
from msg_config.wire import MessageWriter
import numpy as np
from sensor_msgs.msg import JointState

# Lock-step: time, s, after which a sample without a command counts as lost and is sent again.
RESEND_INTERVAL = 0.1
# Real time: number of steps behind the wall clock from which the missing samples are skipped.
MAX_STEPS_BEHIND = 100
# What numbers that are not finite, or too large, may raise in the libraries on their way.
LOST_NUMBERS = (ArithmeticError, np.linalg.LinAlgError)
# Fields of joint_states and strain whose numbers change.
NUMBER_FIELDS = ('header', 'position', 'velocity', 'effort')


class PlantSim(ContractNode):
    """
    Steps the simulator and publishes joint_states, strain, /clock and arm_markers.

    In lock-step, a sample is published, and the command with the same stamp triggers the next
    step. If no command comes, the sample is sent again, so that a lost message or a late node does
    not stop the loop. In real time, the wall clock triggers the samples; if a command is late, the
    one before is held; a slow computer skips steps. Both are reported.
    """

    def __init__(self, **options: Any):
        super().__init__('plant_sim', **options)
        gauges = self.simulator.arm.robot.gauge_names
        self._lockstep = self.values['mode'] == 'lockstep'
        self._joint_states = self.publisher('joint_states')
        self._strain = self.publisher('strain')
        self._markers = self.publisher('arm_markers')
        self._seen = Audience(self._markers)
        self._tells_time = self._lockstep and self.values['publish_clock']
        self._clock_out = self.publisher('/clock') if self._tells_time else None
        inputs = self.simulator.arm.robot.inputs
        self._joints, self._gauges = inputs.joint_channels(), inputs.gauge_channels(gauges)
        self._efforts = inputs.command_channels()
        self._largest = Limits.of(self.simulator.arm.robot).command.tolist()
        zeros = np.zeros(2)
        self._writers = (
            MessageWriter(joint_state(0, self._joints.names, zeros, zeros, zeros), *NUMBER_FIELDS),
            MessageWriter(joint_state(0, self._gauges.names, np.zeros(len(gauges))),
                          *NUMBER_FIELDS))
        self._paused = False
        self._at_rest()
        # In real time nothing needs the command before the tick, which then takes it.
        self.subscribe('command', self._on_command, polled=not self._lockstep,
                       names=lambda: self._efforts)
        self.offer('~/reset', self._on_reset)
        self.offer('~/pause', self._on_pause)
        self.offer('~/step', self._on_step)
        if self._lockstep:
            self.every(RESEND_INTERVAL, self._resend)
        else:
            self.every(self.simulator.arm.robot.sample_time, self._tick)
        self.every(DIAGNOSTICS_INTERVAL, self._report, always=True)
        self.bring_up()

    def begin(self) -> None:
        """Start the simulation when the node becomes active."""
        self._at_rest()
        self._sample()

    def build(self, values: dict[str, Any]) -> Any:
        """Return the simulator that the parameters describe, and the shape of its arm."""
        simulator = simulator_of(values)
        return simulator, ArmShape.of(simulator.arm)

    def install(self, built: Any) -> None:
        """Use the simulator and shape that `build` returned."""
        self.simulator, self.shape = built
        arm = self.simulator.arm
        self.get_logger().info('simulates ' + model_words(
            arm.robot.name, arm.model_name, arm.modes, has_coriolis(arm.effects)))

    def _at_rest(self) -> None:
        """Set the arm at rest: at time zero in lock-step, at the present time in real time."""
        self.simulator.reset()
        self._epoch = self._stamp = 0 if self._lockstep else time.time_ns()
        self._sent, self._permits = np.zeros(2), 0
        self._latest, self._latest_stamp = np.zeros(2), -1
        self._answered = self._diverged = False
        self._quiet = True
        self._origin, self._resend_at, self._late, self._worst = self.wall_time(), 0.0, 0, 0.0
        # Real time: samples that kept the command before, and steps that were left out.
        self.counts: RecentCounts[str] = RecentCounts()
        self._next_marker = 0.0

    def _sample(self) -> None:
        """Measure and publish."""
        sample = self.simulator.measure()
        motion = [*self._joints.outside(sample.angle).tolist(),
                  *self._joints.rate_outside(sample.velocity).tolist()]
        strain = self._gauges.outside(sample.strain).tolist()
        if not all(map(math.isfinite, (*motion, *strain))):
            self._diverge()
            return
        self._stamp = self._epoch + nanoseconds(sample.time)
        time, effort = divmod(self._stamp, NANOSECONDS), self._efforts.outside(self._sent)
        self._messages = (self._writers[0](*time, *motion, *effort.tolist()),
                          self._writers[1](*time, *strain))
        self._answered = False
        self._resend_at = self.wall_time() + RESEND_INTERVAL
        self._publish()
        self._publish_markers()

    def _diverge(self) -> None:
        """Stop, since the sample is not finite and must not be published."""
        self._paused, self._answered, self._diverged, self._permits = True, False, True, 0
        self.get_logger().error(f'the simulated arm diverged at {self._now} with command '
                                f'{self._sent.tolist()}; ~/reset starts it again')

    def _publish(self) -> None:
        if self._clock_out is not None:
            self._clock_out.publish(clock_message(self._stamp))
        self._joint_states.publish(self._messages[0])
        self._strain.publish(self._messages[1])

    def _publish_markers(self) -> None:
        now = self.simulator.time
        if now < self._next_marker or not self._seen:
            return
        self._next_marker = now + MARKER_INTERVAL
        lines = self.shape.lines(self.simulator.state)
        self._markers.publish(arm_markers(self._stamp, lines, self.simulator.mass(now),
                                          prefix=self.values['frame_prefix']))

    def _on_command(self, message: JointState) -> None:
        stamp = checked_stamp(message, 'command')
        command = self._efforts.pick(message.name, message.effort, 'command: effort')
        check_finite(command, JOINTS, 'command: effort')
        if any(abs(own) > most for own, most in zip(command.tolist(), self._largest)):
            raise InputError('command: effort: '
                             f'{refuse_command(command, np.array(self._largest)).text}')
        if stamp > self._stamp:
            raise InputError(f'command: header.stamp: expected at most {seconds(self._stamp):.12g}'
                             f' s, got {seconds(stamp):.12g} s')
        if stamp < self._stamp and self._lockstep or stamp < self._latest_stamp:
            return
        if stamp < self._stamp:
            self._late += 1
            self._worst = max(self._worst, seconds(self._stamp - stamp))
        self._latest, self._latest_stamp = command, stamp
        self._answered = stamp == self._stamp
        if self._lockstep:
            self._advance_if_allowed()

    def _advance_if_allowed(self) -> None:
        if not (self.active and self._answered) or self._paused and not self._permits:
            return
        self._permits = max(0, self._permits - 1)
        self._advance(self._latest)

    def _advance(self, command: np.ndarray) -> None:
        self._sent = command
        try:
            self.simulator.step(command)
            self._sample()
        except LOST_NUMBERS:
            self._diverge()

    def _resend(self) -> None:
        waiting = not self._answered and self.wall_time() >= self._resend_at
        if waiting and (not self._paused or self._permits):
            self._publish()

    def _tick(self) -> None:
        """Take the samples that are due by the wall clock."""
        self.take_waiting('command')
        if self._paused:
            return
        interval = self.simulator.arm.robot.sample_time
        due = int((self.wall_time() - self._origin) / interval)
        behind = due - self.simulator.samples
        if behind > MAX_STEPS_BEHIND:
            self.counts.add('skipped', self.wall_time(), behind)
            self._follow_wall_clock()
            due = self.simulator.samples + 1
        # An arm that diverges pauses inside.
        while self.simulator.samples < due and not self._paused:
            self._advance(self._held_command())

    def _held_command(self) -> np.ndarray:
        if not self._answered and self._latest_stamp >= 0:
            self.counts.add('held', self.wall_time())
        quiet = seconds(self._stamp - self._latest_stamp) > COMMAND_TIMEOUT
        if quiet != self._quiet:
            # Reported at once, not only when the next diagnostics are due.
            self._quiet = quiet
            self._report()
        return np.zeros(2) if quiet else self._latest

    def _follow_wall_clock(self) -> None:
        """Assign the present sample to the present time, after a pause or on a slow computer."""
        self._origin = self.wall_time() - self.simulator.time
        if not self._lockstep:
            self._epoch = time.time_ns() - nanoseconds(self.simulator.time)

    def _on_reset(self, _: Any, response: Any) -> Any:
        self._paused = self._paused and not self._diverged
        self.begin_again()
        self._at_rest()
        if self.active:
            self._sample()
        response.success, response.message = True, 'at rest at 0 s'
        return response

    def _on_pause(self, request: Any, response: Any) -> Any:
        self._paused, self._permits = request.data or self._diverged, 0
        if not self._paused:
            self._follow_wall_clock()
            if self._lockstep:
                self._advance_if_allowed()
        response.success = self._paused == request.data
        response.message = f'{"paused" if self._paused else "going on"} at {self._now}'
        return response

    def _on_step(self, _: Any, response: Any) -> Any:
        response.success = self.active and self._paused and not self._diverged
        if not self.active:
            response.message = 'expected an active node: activate it first'
        elif self._diverged:
            response.message = f'the arm diverged at {self._now}: call ~/reset first'
        elif not self._paused:
            response.message = 'expected a paused simulation: call ~/pause with true first'
        elif self._lockstep:
            self._permits += 1
            self._advance_if_allowed()
            response.message = f'at {self._now}' + (
                ', waiting for its command' if self._permits else '')
        else:
            self._advance(self._held_command())
            response.message = f'at {self._now}'
        return response

    def _another_clock(self) -> bool:
        """Return whether there is a publisher of /clock with a smaller gid than this node's."""
        infos = self.get_publishers_info_by_topic('/clock')
        own = [bytes(info.endpoint_gid) for info in infos
               if (info.node_name, info.node_namespace) == (
                   self.get_name(), self.get_namespace())]
        return bool(own) and any(bytes(info.endpoint_gid) < min(own) for info in infos)

    def _share_clock(self) -> None:
        """Leave /clock to one arm, and publish it again when nobody else does any more."""
        if self._clock_out is not None and self._another_clock():
            self.destroy_publisher(self._clock_out)
            self._clock_out = None
            self.get_logger().warning('/clock: another arm publishes it; this one no longer does')
        elif self._tells_time and self._clock_out is None and not self.count_publishers('/clock'):
            self._clock_out = self.publisher('/clock')
            self.get_logger().warning('/clock: nobody publishes it; this arm does again')

    @property
    def _now(self) -> str:
        return f'{self.simulator.time:.6g} s'

    def _report(self) -> None:
        """Publish the diagnostics of the commands, once /clock is shared."""
        self._share_clock()
        quiet = self._latest_stamp < 0 or (
            seconds(self._stamp - self._latest_stamp) > COMMAND_TIMEOUT)
        waiting = self.wall_time() - self._resend_at > DIAGNOSTICS_INTERVAL
        recent, words = self.counts.recent(self.wall_time()), []
        if not self._paused and (waiting if self._lockstep else quiet):
            words.append(f'no command for the sample at {self._now}')
        elif recent['held']:
            words.append(f'{recent["held"]} samples had no command in time and kept the one '
                         'before')
        if recent['skipped']:
            words.append(f'{recent["skipped"]} steps were skipped, as this computer is slower '
                         'than the wall clock')
        level, text = 'ok', 'paused' if self._paused else 'ok'
        if not self.active:
            text = 'the node is inactive'
        elif self._diverged:
            level, text = 'error', f'the arm diverged at {self._now}'
        elif words:
            level, text = 'warn', '; '.join(words)
        status = self.status('command', level, text, {
            'time s': self.simulator.time, 'held': self.counts.total['held'],
            'skipped': self.counts.total['skipped'], 'late': self._late,
            'latest by s': self._worst})
        self.publish_diagnostics([status])
