"""Records the closed loop from its topics, in the same form as `control/loop.py` does offline."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from flex_payload_estimator.control.loop import LoopRecord
from flex_payload_estimator.control.set_points import SetPoints
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.simulation.simulator import Simulator
from msg_config.input_mapping import Channels
from msg_config.messages import seconds, stamp_of
from msg_config.ros import create_subscription
import numpy as np
from rclpy.node import Node

# Topics whose messages carry a stamp; payload has none.
STAMPED = ('joint_states', 'strain', 'payload/inertia', 'innovation', 'command')


class TopicRecorder(Node):
    """
    Keeps one message per stamp and topic, until all topics have a number of stamps.

    Parameters
    ----------
    samples : int
        Stamps to record.
    robot : Robot
        Its file gives the names of joints, gauges and commands in messages, and their units.
    on_estimate : callable
        Called with time (s), mass (kg) and variance (kg^2) at every new estimate.
    on_end : callable
        Called once, when every topic has its samples.

    """

    def __init__(self, samples: int, robot: Robot,
                 on_estimate: Callable[[float, float, float], None],
                 on_end: Callable[[], None], **options: Any):
        super().__init__('recorder', **options)
        self.samples, self.robot = samples, robot
        self.on_estimate, self.on_end = on_estimate, on_end
        self.messages: dict[str, dict[int, Any]] = {topic: {} for topic in STAMPED}
        self.estimates: dict[int, tuple[float, float, float]] = {}
        self._ended = False
        self._payloads: deque[Any] = deque(maxlen=100)
        create_subscription(self, 'payload', lambda message: self._payloads.append(message),
                            reliable=True)
        for topic in STAMPED:
            create_subscription(self, topic, self._keeper(topic), reliable=True)

    def _keeper(self, topic: str) -> Callable[[Any], None]:
        """Return the callback that keeps the messages of a topic."""
        kept = self.messages[topic]

        def keep(message: Any) -> None:
            stamp = stamp_of(message)
            if stamp in kept or len(kept) >= self.samples:
                return
            kept[stamp] = message
            if topic == 'payload/inertia':
                self._pair(stamp, message.inertia.m)
            if not self._ended and all(
                    len(own) >= self.samples for own in self.messages.values()):
                self._ended = True
                self.on_end()
        return keep

    def _pair(self, stamp: int, mass: float) -> None:
        """Give a stamp to the payload message of this mass, which was published just before."""
        while self._payloads:
            data = self._payloads.popleft().data
            if data[0] == mass:
                self.estimates[stamp] = tuple(data)
                self.on_estimate(seconds(stamp), data[0], data[1])
                return

    def record(self, simulator: Simulator, set_points: SetPoints) -> LoopRecord:
        """
        Return the record; the plant's modal coordinates and payload come from a second simulation.

        Parameters
        ----------
        simulator : Simulator
            As plant_sim built it, at its start: the same seed and commands give the same states,
            which no sensor shows.
        set_points : SetPoints
            Set-points of the controller.

        """
        stamps = sorted(set.intersection(*(set(own) for own in self.messages.values()),
                                         set(self.estimates)))
        joints, strain, command, innovation = (
            [self.messages[topic][stamp] for stamp in stamps]
            for topic in ('joint_states', 'strain', 'command', 'innovation'))
        inputs, gauge_names = self.robot.inputs, self.robot.gauge_names
        angles, gauges = inputs.joint_channels(), inputs.gauge_channels(gauge_names)
        commands = _stack(command, 'effort', inputs.command_channels())
        modal, true_mass = _simulated_again(simulator, commands)
        time = np.array([seconds(stamp) for stamp in stamps])
        mass, variance, p = np.array([self.estimates[stamp] for stamp in stamps]).T
        return LoopRecord(
            time, np.array([set_points(t) for t in time]),
            np.hstack([_stack(joints, 'position', angles), _stack(strain, 'position', gauges)]),
            _stack(joints, 'velocity', replace(angles, offset=(0.0, 0.0))), commands, mass,
            variance, p, np.array([message.position for message in innovation]),
            np.array([message.effort for message in innovation]), ('',) * len(stamps), modal,
            true_mass)


def _stack(messages: list[Any], field: str, channels: Channels) -> np.ndarray:
    """Return a field of JointStates in SI, (N, n)."""
    return np.array([channels.pick(message.name, getattr(message, field), field)
                     for message in messages])


def _simulated_again(simulator: Simulator, commands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return modal coordinates (N, 2n), m, and payload (N,), kg, at every sample."""
    end = 2 + 2 * simulator.arm.modes
    modal, mass = [], []
    for command in commands:
        simulator.measure()
        modal.append(simulator.state[2:end].copy())
        mass.append(simulator.mass(simulator.time))
        simulator.step(command)
    return np.array(modal), np.array(mass)
