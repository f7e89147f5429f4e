"""The estimator or the controller alone, fed by hand."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from msg_config.parameters import Parameter

if TYPE_CHECKING:
    from ros_loop import RosLoop

PAPER: dict[str, Any] = {'model': 'paper_reduced', 'modes': 2}
ESTIMATOR: dict[str, Any] = {**PAPER, 'estimator': 'sf1_paper'}
GAUGES = ('strain_1a', 'strain_1b', 'strain_2a', 'strain_2b')
JOINTS = ('joint_1', 'joint_2')
STEP = 10_000_000


def another(row: Parameter, now: Any) -> Any:
    """Return a good value of a parameter that differs from the present one."""
    if row.choices:
        return next(choice for choice in row.choices if choice != now)
    if row.type == 'bool':
        return not now
    if row.type == 'string':
        return 'stiff'
    if row.type.endswith('_array'):
        return {'payload_schedule': [0.05, 0.2],
                'effects': ['coulomb_friction:joint_2:level=0.4']}[row.name]
    assert row.maximum is not None and row.minimum is not None, row
    now = max(now, row.minimum)
    between = 0.5 * (now + min(row.maximum, 2.0 * now + 1.0))
    return round(between + 0.5) if row.type == 'int' else between


class Bench:
    """A node under test, fed by hand."""

    def __init__(self, loop: RosLoop, kind: str, **values: Any):
        from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
        from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode

        self.loop = loop
        self.answers = loop.record('payload/inertia' if kind == 'estimator' else 'command')
        self.diagnostics = loop.record('/diagnostics')
        estimator, given = kind == 'estimator', {**(
            ESTIMATOR if kind == 'estimator' else {**PAPER, 'adapt': False}), **values}
        self.node = loop.start(PayloadEstimatorNode if estimator else LQGControllerNode, **given)
        self.joint_states = loop.publisher('joint_states')
        self.strain = loop.publisher('strain')
        loop.until(lambda: self.answers_are_heard)

    @property
    def answers_are_heard(self) -> bool:
        """Return whether the recorder has found the node."""
        return bool(self.loop.observer.count_publishers(
            'payload/inertia' if 'payload' in self.node.get_name() else 'command'))

    def sample(self, k: int, angle: Any = (0.1, 0.2), strain: Any = (0.0,) * 4, *,
               joints: Any = JOINTS, gauges: Any = GAUGES, effort: Any = (0.0, 0.0)) -> None:
        """Publish sample k."""
        from msg_config.messages import joint_state

        self.joint_states.publish(joint_state(k * STEP, joints, angle, effort=effort))
        self.strain.publish(joint_state(k * STEP, gauges, strain))

    def joint_only(self, k: int, angle: Any, effort: Any) -> None:
        """Publish the joints of sample k and wait for its answer."""
        from msg_config.messages import joint_state

        self.joint_states.publish(joint_state(k * STEP, JOINTS, angle, effort=effort))
        self.loop.until(lambda: k * STEP in self.answers.stamps)

    def answered(self, k: int, **values: Any) -> None:
        """Publish a good sample k and wait for its answer."""
        self.sample(k, **values)
        self.loop.until(lambda: k * STEP in self.answers.stamps)

    def seldom(self, samples: range, times: int) -> None:
        """Publish joints at every sample, strain at every so many, and wait for the answers."""
        from msg_config.messages import joint_state

        for k in samples:
            effort = (0.1 * (k % times), 0.0)
            self.joint_states.publish(joint_state(k * STEP, JOINTS, (0.2, 0.2), effort=effort))
            if k % times == 0:
                self.strain.publish(joint_state(k * STEP, GAUGES, (0.0,) * 4))
                self.loop.until(lambda k=k: k * STEP in self.answers.stamps)  # type: ignore[misc]

    def status(self, name: str) -> Any:
        """Return the latest status of a name."""
        found = [s for m in self.diagnostics for s in m.status if s.name.endswith(name)]
        return found[-1] if found else None
