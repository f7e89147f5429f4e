"""What estimator and controller do alike: samples out of messages, one answer a stamp."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from flex_payload_estimator.nodes.pairing import Order, Pairing, StampOrder
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from geometry_msgs.msg import InertiaStamped
from msg_config.contract_node import ContractNode
from msg_config.errors import InputError
from msg_config.messages import (
    channels,
    check_finite,
    JOINTS,
    payload_mass,
    seconds,
    stamp_of,
)
from msg_config.recent_counts import RecentCounts
import numpy as np
from sensor_msgs.msg import JointState

UNEVEN = 0.1


@dataclass(frozen=True)
class Sample:
    """
    One stamp's measurements.

    Attributes
    ----------
    stamp : int
        ns.
    output : Array
        (theta_1, theta_2, strain…), rad and m/m, (m,); may hold what is not finite.
    command : Array
        Applied up to this stamp, (2,).
    mass : float or None
        Estimated payload, kg, where it is one of the parts.

    """

    stamp: int
    output: Array
    command: Array
    mass: float | None = None

    @property
    def time(self) -> float:
        """Return the stamp in s."""
        return seconds(self.stamp)


class SampleNode(ContractNode):
    """
    A node that answers each sample once, and a repeated sample with the same answer again.

    Subclasses give `take`, `answer` and `restart`.

    Attributes
    ----------
    commanded : Array or None
        The last command that this node sent or heard of, (2,): what is taken as applied where
        joint_states has no effort, as many robots have none.

    """

    def __init__(self, name: str, **options: Any):
        super().__init__(name, **options)
        self.order = StampOrder()
        self._pairing = Pairing(())
        self._answer: Any = None
        self.commanded: Array | None = None
        self._lost: RecentCounts[str] = RecentCounts()
        self._restarts = 0

    def take_robot(self, robot: Robot) -> None:
        """Take over the robot and the names of its channels."""
        self.robot = robot
        self.gauges, self.channels = robot.gauge_names, robot.output_names

    def pair(self, *parts: str) -> None:
        """Make samples of these topics' messages of one stamp."""
        self._parts, self._pairing = parts, Pairing(parts)

    def listen(self, *topics: str) -> None:
        """Take these topics' messages, and offer ~/reset. Call it when all else is ready."""
        callbacks = {'joint_states': self._on_joint_states, 'strain': self._on_strain,
                     'payload/inertia': self._on_inertia}
        self.pair(*topics)
        for topic in topics:
            self.subscribe(topic, callbacks[topic])
        self.offer('~/reset', self._on_reset)

    def take(self, sample: Sample) -> Any:
        """Compute, publish and return the answer to a new sample."""
        raise NotImplementedError

    def answer(self, answer: Any) -> None:
        """Publish an answer."""
        raise NotImplementedError

    def restart(self) -> None:
        """Forget everything."""
        raise NotImplementedError

    def _on_joint_states(self, message: JointState) -> None:
        angle = channels(message, 'position', JOINTS, 'joint_states')
        command = self._applied(message)
        self._add('joint_states', stamp_of(message), (angle, command))
        check_finite(angle, JOINTS, 'joint_states: position')
        check_finite(command, JOINTS, 'joint_states: effort')

    def _applied(self, message: JointState) -> Array:
        """Return u up to this sample: the effort, or else the last command."""
        if len(message.effort) or self.commanded is None:
            return channels(message, 'effort', JOINTS, 'joint_states')
        return self.commanded

    def _on_strain(self, message: JointState) -> None:
        strain = channels(message, 'position', self.gauges, 'strain')
        self._add('strain', stamp_of(message), strain)
        check_finite(strain, self.gauges, 'strain: position')

    def _on_inertia(self, message: InertiaStamped) -> None:
        self._add('payload/inertia', stamp_of(message), payload_mass(message))

    def _add(self, part: str, stamp: int, value: Any) -> None:
        if part not in self._parts:
            return
        parts = self._pairing.add(part, stamp, value)
        if parts is not None:
            angle, command = parts['joint_states']
            self._on_sample(Sample(stamp, np.concatenate([angle, parts['strain']]), command,
                                   parts.get('payload/inertia')))

    def _on_sample(self, sample: Sample) -> None:
        last = self.order.last
        order = self.order.judge(sample.stamp)
        if order is Order.REPEATED and self._answer is not None:
            self.answer(self._answer)
            return
        if order is Order.STALE:
            raise InputError(f'joint_states, strain: header.stamp: expected more than '
                             f'{seconds(last or 0):.9g} s, got {sample.time:.9g} s')
        if order is Order.RESTARTED:
            self._begin_again(last or 0, sample)
        elif order is Order.NEW and last is not None:
            self._watch_interval(sample.stamp - last)
        self._answer = None
        self._answer = self.take(sample)

    def _begin_again(self, last: int, sample: Sample) -> None:
        self._restarts += 1
        self.get_logger().warning(
            f'time went back from {seconds(last):.9g} s to {sample.time:.9g} s: starting afresh')
        self.restart()

    def _watch_interval(self, interval: int) -> None:
        count = seconds(interval) / self.robot.sample_time
        if abs(count - 1.0) <= UNEVEN:
            return
        self._lost.add('lost', self.wall_time(), max(round(count) - 1, 1))
        self.get_logger().warning(
            f'joint_states, strain: expected a sample every {self.robot.sample_time:.9g} s, '
            f'got one after {seconds(interval):.9g} s', throttle_duration_sec=1.0)

    def _on_reset(self, _: Any, response: Any) -> Any:
        self.begin_again()
        self.restart()
        self._pairing.clear()
        self.order.clear()
        self._answer = None
        response.success, response.message = True, 'as at the start'
        return response

    def sample_status(self) -> DiagnosticStatus:
        """Return how the samples come."""
        lost = self._lost.recent(self.wall_time()).total()
        values: dict[str, object] = {
            'lost or uneven': self._lost.total.total(), 'restarts': self._restarts}
        if self.order.last is None:
            return self.status('samples', 'stale', 'no sample yet', values)
        text = f'{lost} samples lost or not at the sampling time lately' if lost else 'ok'
        return self.status('samples', 'warn' if lost else 'ok', text, values)
