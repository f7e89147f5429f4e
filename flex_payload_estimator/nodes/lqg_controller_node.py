"""The node that controls the arm: measurements and payload in, commands out."""

from __future__ import annotations

import sys
from typing import Any

from flex_payload_estimator.control.trajectory import Trajectory
from flex_payload_estimator.nodes.node_setup import controller_of, set_points_of
from flex_payload_estimator.nodes.sample_node import Sample, SampleNode
from msg_config.contract_node import DIAGNOSTICS_INTERVAL, run
from msg_config.messages import (
    diagnostic_status,
    doubles,
    joint_state,
    JOINTS,
    seconds,
    set_stamp,
)
import numpy as np
from trajectory_msgs.msg import JointTrajectory


class LQGControllerNode(SampleNode):
    """
    Answers every sample with the command of the same stamp.

    With `adapt` a sample has a third part, payload/inertia: the mass with the stamp that
    std_msgs/Float64MultiArray lacks. Set-points are a square wave until `reference` comes.
    """

    def __init__(self, **options: Any):
        super().__init__('lqg_controller', **options)
        self.controller = self.configured(lambda: controller_of(self.values))
        self.set_points = set_points_of(self.values)
        self._command = self.publisher('command')
        self.commanded = self._sent = np.zeros(2)
        self._message = joint_state(0, JOINTS, effort=self._sent)
        self.subscribe('reference', self._on_reference)
        estimate = ('payload/inertia',) if self.values['adapt'] else ()
        self.listen('joint_states', 'strain', *estimate)
        self.every(DIAGNOSTICS_INTERVAL, self._report)

    def restart(self) -> None:
        """Forget everything but the set-points."""
        self.controller.reset()
        self.commanded = self._sent = np.zeros(2)

    def take(self, sample: Sample) -> Any:
        """Return the command that answers a sample."""
        mass = self.values['payload_initial'] if sample.mass is None else sample.mass
        command = self.controller.command(sample.time, sample.output, sample.command, mass,
                                          self.set_points(sample.time))
        if np.all(np.isfinite(command)):
            self.commanded = self._sent = command
        else:
            self.reject('command', f'the command at {sample.time:.9g} s is not finite; the one '
                                   'before is kept')
        set_stamp(self._message, sample.stamp)
        self._message.effort = doubles(self._sent)
        self.answer(self._message)
        return self._message

    def answer(self, answer: Any) -> None:
        """Publish a command."""
        self._command.publish(answer)

    def _on_reference(self, message: JointTrajectory) -> None:
        now = seconds(self.order.last or 0)
        self.set_points = Trajectory.of(message, self.set_points(now), now)

    def _report(self) -> None:
        stamp = self.order.last
        status = diagnostic_status(
            'lqg_controller: command', 'stale' if stamp is None else 'ok',
            'no sample yet' if stamp is None else 'ok',
            {'time s': seconds(stamp or 0), 'command 1': float(self._sent[0]),
             'command 2': float(self._sent[1])})
        self.publish_diagnostics(stamp or 0, [status, self.sample_status()])


def main() -> None:
    """Run the node until Ctrl-C."""
    sys.exit(run(LQGControllerNode))


if __name__ == '__main__':
    main()
