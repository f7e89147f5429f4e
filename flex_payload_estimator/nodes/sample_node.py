"""
The common part of estimator and controller node: samples from messages, one answer per stamp.

In: joint_states and strain, paired by stamp, gated and ordered. Out: a StampedSample for `take`,
and the status of the samples in the diagnostics.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import replace
import math
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from flex_payload_estimator.nodes.backlog import Backlog
from flex_payload_estimator.nodes.sample import mean_command, same_output, StampedSample
from flex_payload_estimator.nodes.sample_counts import SampleCounts
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.gate import Gate, refuse_command
from flex_plant_sim.inputs.plausible import unit_hint
from flex_plant_sim.inputs.stamps import Order, StampOrder, TIME_JUMP
from flex_plant_sim.inputs.synchroniser import slop_of, Synchroniser
from msg_config.acting_command import ActingCommand, NO_EFFORT, ZERO_TOLD
from msg_config.contract import load_topics
from msg_config.contract_node import ContractNode
from msg_config.errors import InputError
from msg_config.messages import checked_stamp, nanoseconds, seconds
from msg_config.ros import silent_topic
import numpy as np
from sensor_msgs.msg import JointState

# Time without a sample after which the diagnostics say why, s.
QUIET = 0.5
# Interval at which trouble is looked for, s: the longest delay of its report.
LOOK_INTERVAL = 0.1
# Time between two warnings that no sample comes, s.
SILENCE_INTERVAL = 5.0
# Velocity of the joints where joint_states has none.
NO_VELOCITY = np.full(2, np.nan)
# Topics whose messages of one stamp make a sample.
PARTS = ('joint_states', 'strain')
Found = TypeVar('Found')


class SampleNode(ContractNode):
    """
    A node that answers each sample once, and a repeated sample with the same answer again.

    A sample that the arm cannot have made is refused: it reaches `take` as NaN. Subclasses define
    `take`, `answer`, `report`, `restart` and `lose`.

    Attributes
    ----------
    WAITING : float
        Share of the queue that may stay filled before samples are passed over.
    unknown_commands : bool
        Whether samples come so seldom that joint_states lacks commands, or in bursts.
    acting : ActingCommand
        Which command acted: the effort, or the last that this node sent or received.

    """

    # An estimate may be late: by half of the queue, half a second at 1 kHz, and no more anywhere.
    WAITING = 0.5

    def __init__(self, name: str, **options: Any):
        # With a provisional interval, until the robot is known.
        self.order, self.acting = StampOrder(TIME_JUMP), ActingCommand()
        super().__init__(name, **options)
        self._answer: Any = None
        self._last_applied = np.zeros(2)
        self._sample_at, self._paired_at = self.wall_time(), -math.inf
        self._output = self._doubted = np.empty(0)
        self._trouble: tuple[bool, ...] = ()
        self._received_at: dict[str, float] = dict.fromkeys(PARTS, -math.inf)
        self._accepted_at: dict[str, float] = dict.fromkeys(PARTS, -math.inf)

    def take_robot(self, robot: Robot) -> None:
        """Take over a robot's channels, limits of its measurements, and sampling time."""
        self.robot, self.channels = robot, robot.output_names
        self._joints = robot.inputs.joint_channels()
        self._efforts = robot.inputs.command_channels()
        self._gauges = robot.inputs.gauge_channels(robot.gauge_names)
        self._say_topics(robot)
        self.gate = Gate(robot)
        self._parts = PARTS if robot.gauge_names else PARTS[:1]
        self._pairing = Synchroniser(self._parts, slop_of(robot.sample_time))
        self.hear_for(3.0 * robot.sample_time)
        room = load_topics()['strain'].subscribe.depth * robot.sample_time
        self._backlog = Backlog(min(self.WAITING * room, QUIET), robot.sample_time)
        self.order.interval = nanoseconds(robot.sample_time)
        self._counts, self.unknown_commands = SampleCounts(robot.sample_time), False

    def _say_topics(self, robot: Robot) -> None:
        """Say which topics of the robot file, all for bags, this node does not hear."""
        other = {topic: name for topic, name in robot.inputs.topics.items()
                 if topic in PARTS and self.resolve_topic_name(name)
                 != self.resolve_topic_name(topic)}
        if other:
            self.get_logger().warning(
                f'{robot.source}: inputs: topics: holds for bags alone; this node needs '
                '--ros-args ' + ' '.join(f'-r {topic}:={name}' for topic, name in other.items()))

    def listen(self) -> None:
        """Subscribe to the samples and offer ~/reset; call it when all else is ready."""
        self.subscribe('joint_states', self._on_joint_states, names=lambda: self._joints)
        self.subscribe('strain', self._on_strain, names=lambda: self._gauges)
        self.offer('~/reset', self._on_reset)
        self.every(LOOK_INTERVAL, self._report_trouble)

    @abstractmethod
    def report(self) -> None:
        """Publish the diagnostics."""

    def trouble(self) -> tuple[bool, ...]:
        """Return flags whose change is reported at once: no sample, a second publisher."""
        return (bool(self.silence()), bool(self.second_heard()), self._counts.slow)

    def _report_trouble(self) -> None:
        """Report where trouble has begun or ended."""
        trouble = self.trouble()
        if trouble != self._trouble:
            self._trouble = trouble
            self.report()

    @abstractmethod
    def take(self, sample: StampedSample) -> Any:
        """Compute, publish and return the answer to a new sample; None if it must wait."""

    @abstractmethod
    def answer(self, answer: Any) -> None:
        """Publish an answer again, to a repeated sample."""

    @abstractmethod
    def restart(self) -> None:
        """Go back to the start of the computation."""

    @abstractmethod
    def lose(self, time: float) -> None:
        """Say that what was computed at a time, s, is not finite, and begin the filter again."""

    def computed(self, time: float, compute: Callable[[], Found | None],
                 numbers: Callable[[Found], Iterable[float]]) -> Found | None:
        """Return what is computed at a time, s; None, after `lose`, where it is not finite."""
        try:
            found = compute()
            if found is None or all(map(math.isfinite, numbers(found))):
                return found
        except InputError:
            raise
        except (ArithmeticError, ValueError):
            # What a NaN may raise in the libraries on its way.
            pass
        self.lose(time)
        return None

    def _on_joint_states(self, message: JointState) -> None:
        self._received_at['joint_states'] = self.wall_time()
        stamp = checked_stamp(message, 'joint_states')
        angle = self._joints.pick(message.name, message.position, 'joint_states: position')
        self._pair_up('joint_states', stamp,
                      (angle, self.acting.until(stamp, self._effort(message)),
                       self._velocity(message)))

    def _velocity(self, message: JointState) -> Array:
        """Return the joints' velocities, rad/s, (2,); NaN without one for each name."""
        if len(message.velocity) != len(message.name):
            return NO_VELOCITY
        return self._joints.pick_rate(message.name, message.velocity, 'joint_states: velocity')

    def _effort(self, message: JointState) -> Array:
        """Return the effort in the drives' own unit, (2,); NaN where there is none."""
        if not len(message.effort):
            return NO_EFFORT
        return self._efforts.pick(message.name, message.effort, 'joint_states: effort')

    def _on_strain(self, message: JointState) -> None:
        if 'strain' not in self._parts:
            return
        self._received_at['strain'] = self.wall_time()
        stamp = checked_stamp(message, 'strain')
        self._pair_up('strain', stamp,
                      self._gauges.pick(message.name, message.position, 'strain: position'))

    def _pair_up(self, part: str, stamp: int, value: Any) -> None:
        """Pair a message with that of the other topic and take the sample they make."""
        self._accepted_at[part] = self._received_at[part]
        together = self._pairing.add(part, stamp, value)
        if together is not None:
            angle, command, velocity = together.parts['joint_states']
            output = np.concatenate([angle, together.parts.get('strain', np.empty(0))])
            passed = [own for _, own, _ in together.passed if self.gate.takes(own)]
            self._on_sample(StampedSample(
                together.stamp, output, mean_command(passed, command), velocity,
                1 + len(passed)))

    def _on_sample(self, sample: StampedSample) -> None:
        """Answer a sample, unless its stamp is out of order or the node is too slow."""
        last, waited = self.order.last, self.waited
        self._paired_at = self.wall_time()
        order = self._order_of(sample)
        if order in (Order.STALE, Order.AHEAD):
            self.reject('joint_states', 'joint_states, strain: header.stamp: expected '
                        f'{self.order.expected(order)}, got {sample.time:.12g} s',
                        f'stamp {order.value}')
            return
        self._sample_at = self._paired_at
        if order is Order.REPEATED and self._answer is not None:
            self.answer(self._answer)
            return
        self.clock_watch.sampled = self._sample_at
        if order is Order.RESTARTED:
            self._begin_afresh(last or 0, sample)
        elif order is Order.NEW and last is not None:
            if self._backlog.passes(waited, self._sample_at):
                self._pass_over(sample.stamp - last)
                return
            self._watch_interval(sample.stamp - last)
            self.unknown_commands = bool(self._counts.bursts) or (
                self._counts.slow and sample.commands < round(
                    seconds(sample.stamp - last) / self.robot.sample_time))
        self._answer = None
        self._answer = self.take(self._gated(sample))

    def _order_of(self, sample: StampedSample) -> Order:
        """
        Return the kind of a sample's stamp.

        Where other measurements come with the last stamp, its source sets none (STALE), or has
        started again (RESTARTED): then it repeats them until they are answered.
        """
        order = self.order.judge(sample.stamp, self._backlog.held_up(self.waited))
        if order is Order.REPEATED and not same_output(sample.output, self._output):
            again = same_output(sample.output, self._doubted)
            self._doubted = sample.output
            order = Order.RESTARTED if again else Order.STALE
        if order in (Order.NEW, Order.RESTARTED):
            self._output = sample.output
        return order

    def _gated(self, sample: StampedSample) -> StampedSample:
        """Return the sample, with NaN for outputs that the arm cannot have produced."""
        applied = self._plausible_command(sample)
        refusal = self.gate.judge(sample.time, sample.output, applied)
        if refusal is None:
            return sample if applied is sample.command else replace(sample, command=applied)
        self.reject('joint_states', f'joint_states, strain: {refusal.text}{unit_hint(refusal)}',
                    refusal.kind)
        self._counts.add('refused', self.wall_time())
        return replace(sample, output=np.full(len(sample.output), np.nan), command=applied)

    def _plausible_command(self, sample: StampedSample) -> Array:
        """Return the applied command, or the last plausible one where it is out of range."""
        command = sample.command
        if self.gate.takes(command):
            self._last_applied = command
            return command
        refusal = refuse_command(command, self.gate.limits.command)
        self.reject('joint_states', f'joint_states: effort: {refusal.text}',
                    'effort out of range')
        return self._last_applied if self.acting.sent is None else self.acting.sent

    def _begin_afresh(self, last: int, sample: StampedSample) -> None:
        """Start again after a leap in time, from the stamp `last`, ns, to a sample."""
        self._counts.restart()
        self.get_logger().warning(f'time went from {seconds(last):.12g} s to '
                                  f'{sample.time:.12g} s: starting afresh')
        self.gate.restart()
        self.restart()

    def _pass_over(self, interval: int) -> None:
        """Count a sample that is passed over, with those that were lost before it."""
        self._answer = None
        count = max(round(seconds(interval) / self.robot.sample_time), 1)
        self._counts.add('passed over', self.wall_time(), count)
        self.warn_seldom('slow', f'too slow for a sample every {self.robot.sample_time:.9g} s: '
                         f'{self._counts.passed_over} passed over so far')

    def _watch_interval(self, interval: int) -> None:
        """Count the samples lost in an interval, ns, that is not the sampling time."""
        if self._counts.add_interval(seconds(interval), self.wall_time()):
            return
        self.warn_seldom(
            'interval', f'joint_states, strain: expected a sample every '
            f'{self.robot.sample_time:.9g} s (sample_time), got one after '
            f'{seconds(interval):.9g} s')

    def _on_reset(self, _: Any, response: Any) -> Any:
        """Take parameters that wait for ~/reset into force, and start again."""
        self.start_over()
        response.success, response.message = True, 'as at the start'
        return response

    def start_over(self) -> None:
        """Take parameters that wait into force, and be as at the start."""
        super().start_over()
        self.restart()
        self.gate.restart()
        self._pairing.clear()
        self.order.clear()
        self._answer = None

    def remember(self, answer: Any) -> None:
        """Keep an answer that was given after `take` returned, for when its sample is repeated."""
        self._answer = answer

    def silence(self) -> str:
        """Return why no sample comes; empty where samples come."""
        if not self.active:
            return 'the node is inactive'
        since = self.wall_time() - max(QUIET, 3.0 * self.robot.sample_time)
        if self._sample_at > since:
            return ''
        silent = [silent_topic(self, part) for part in self._parts
                  if self._received_at[part] < since]
        if silent:
            return f'no message on {" and ".join(silent)}'
        if any(self._accepted_at[part] < since for part in self._parts):
            return f'every message is refused: {self.last_rejection}'
        if self._paired_at > since:
            return f'every sample is refused: {self.last_rejection}'
        return self._pairing.why_nothing()

    def slowness(self) -> str:
        """Return which topic comes too seldom, and how often; empty where samples come in time."""
        if not self._counts.slow:
            return ''
        topics = ', '.join(f'{part} every {self._pairing.interval(part):.3g} s'
                           for part in self._parts)
        return (f'samples come every {self._pairing.interval():.3g} s ({topics}), expected '
                f'{self.robot.sample_time:.4g} s (sample_time)')

    def sample_status(self) -> DiagnosticStatus:
        """Return the status of the samples: lost, uneven, passed over, or why none comes."""
        values = {**self._counts.values(), 'commands from': self.acting.source}
        if self.acting.source == ZERO_TOLD:
            self.warn_seldom('effort', f'commands are taken from {ZERO_TOLD}', math.inf)
        silence = self.silence()
        if silence:
            self.warn_seldom('silence', f'no sample: {silence}', SILENCE_INTERVAL)
            return self.status('samples', 'stale' if self.order.last is None else 'error',
                               f'no sample: {silence}', values)
        slowness = self.slowness()
        if slowness:
            return self.status('samples', 'error', slowness, values)
        return self.status('samples', *self._counts.status(self.wall_time(), self.last_rejection),
                           values)
