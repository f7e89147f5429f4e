"""
Mutated messages into the callbacks of the running nodes: none dies, and no NaN comes out.

`python test/faults/mutated_messages.py [--count N] [--seed S] [--page]`; the messages go
straight into the subscriptions' callbacks, each between two good samples.
"""

from __future__ import annotations

import argparse
import random
import sys
from typing import Any

from faults.page import record
from msg_config.contract import load_topics
from msg_config.messages import inertia_message
from msg_config.ros import interface_class
from msg_config.time_stamp import NANOSECONDS
import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.serialization import deserialize_message

NUMBERS = (0.0, -0.0, 1.0, -1.0, 1e-308, 5e-324, 1e4, 1e9, 1e30, -1e30, 1.7e308, -1.7e308,
           float('nan'), float('inf'), float('-inf'))
NAMES = ('joint_1', 'joint_2', 'shoulder', 'strain_1a', 'strain_1b', 'strain_2a', 'strain_2b', '',
         'a' * 5000, 'ünï\x07', '$(x)', 'gripper')
HEARD = {'plant_sim': ('command',),
         'payload_estimator': ('joint_states', 'strain', 'command'),
         'lqg_controller': ('joint_states', 'strain', 'payload/inertia', 'reference')}


def mutate(message: Any, chance: random.Random, depth: int = 0) -> None:
    """Change about a third of the fields of a message, in place."""
    for field, kind in message.get_fields_and_field_types().items():
        value = getattr(message, field)
        if callable(getattr(value, 'get_fields_and_field_types', None)):
            mutate(value, chance, depth + 1)
        elif chance.random() < 0.35:
            setattr(message, field, _other(kind, value, chance, depth))


def _other(kind: str, value: Any, chance: random.Random, depth: int) -> Any:
    length = chance.choice((0, 1, 2, 3, 4, 7))
    if kind == 'sequence<double>':
        return [chance.choice((*NUMBERS, chance.gauss(0.0, 1.0))) for _ in range(length)]
    if kind == 'sequence<string>':
        return [chance.choice(NAMES) for _ in range(length)]
    if kind == 'double':
        return chance.choice(NUMBERS)
    if kind == 'int32':
        return chance.choice((-2**31, -1, 0, 1, 7, 2**31 - 1))
    if kind == 'uint32':
        return chance.choice((0, 1, 999_999_999, 10**9, 2**32 - 1))
    if kind.startswith('sequence<') and depth < 2:
        return _points(kind, length, chance, depth)
    return value


def _points(kind: str, length: int, chance: random.Random, depth: int) -> list[Any]:
    package, name = kind[len('sequence<'):-1].split('/')
    found = [interface_class(f'{package}/msg/{name}')() for _ in range(length)]
    for item in found:
        mutate(item, chance, depth + 1)
        if hasattr(item, 'positions') and chance.random() < 0.5:
            item.positions = [chance.gauss(0.0, 0.3), chance.gauss(0.0, 0.3)]
    return found


class Victims:
    """The three nodes under attack, and what they publish."""

    def __init__(self, domain: int, **values: Any):
        from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
        from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode
        from flex_plant_sim.nodes.plant_sim_node import PlantSim
        from rclpy.parameter import Parameter

        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        given = [Parameter(name, value=value) for name, value in values.items()]
        self.nodes: dict[str, Any] = {
            kind.__name__: kind(context=self.context, parameter_overrides=given)
            for kind in (PlantSim, PayloadEstimatorNode, LQGControllerNode)}
        self.by_name: dict[str, Any] = {node.get_name(): node for node in self.nodes.values()}
        self.bad: list[str] = []
        self.samples = 0

    def hand(self, name: str, topic: str, message: Any) -> None:
        """Give a message to a node's callback, as an executor does."""
        self.by_name[name]._subscribed[topic].callback((message, {'publisher_gid': None}))

    def good(self, topic: str) -> Any:
        """Return a copy of a good message of a topic, to be mutated; empty where none is kept."""
        joint_states, strain = self.by_name['plant_sim']._messages
        kept = {'joint_states': joint_states, 'strain': strain, 'command': self._command()}
        kind = interface_class(load_topics()[topic].type)
        return deserialize_message(kept[topic], kind) if topic in kept else kind()

    def _command(self) -> bytes:
        """Return the controller's command, as it is sent."""
        controller = self.by_name['lqg_controller']
        return bytes(controller._writer(*divmod(controller.order.last or 0, NANOSECONDS),
                                        *controller.limiter.sent))

    def good_sample(self) -> Any:
        """Let the plant make a sample, hand it on, and close the loop as far as it answers."""
        plant, controller = self.by_name['plant_sim'], self.by_name['lqg_controller']
        for name in ('payload_estimator', 'lqg_controller'):
            for topic, message in zip(('joint_states', 'strain'), plant._messages):
                self.hand(name, topic, message)
        estimate = self.by_name['payload_estimator']._estimate
        if estimate is not None:
            self._check('mass', [estimate.mass, estimate.variance])
            self.hand('lqg_controller', 'payload/inertia',
                      inertia_message(plant._stamp, estimate.mass))
        sent = controller.limiter.sent
        self._check('command', sent)
        if np.abs(sent).max() > controller.values['command_limit']:
            self.bad.append(f'command beyond its limit: {sent}')
        before = plant.simulator.samples
        self.hand('plant_sim', 'command', self._command())
        self.samples += plant.simulator.samples - before
        return plant

    def _check(self, what: str, values: Any) -> None:
        if not np.isfinite(values).all():
            self.bad.append(f'{what}: {values}')

    def close(self) -> None:
        """Take the nodes down."""
        for node in self.nodes.values():
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)


def attack(count: int, seed: int, domain: int, **values: Any) -> tuple[Victims, list[str]]:
    """Hand `count` mutated messages to the nodes; return the nodes and what they died of."""
    chance, victims, deaths = random.Random(seed), Victims(domain, **values), []
    for number in range(count):
        name = chance.choice(sorted(HEARD))
        topic = chance.choice(HEARD[name])
        message = victims.good(topic) if chance.random() < 0.5 else interface_class(
            load_topics()[topic].type)()
        mutate(message, chance)
        try:
            victims.hand(name, topic, message)
            if number % 3 == 0:
                victims.good_sample()
        except Exception as error:  # noqa: B902  any is a death
            deaths.append(f'{number}: {name}: {topic}: {type(error).__name__}: {error}'[:300])
    return victims, deaths


def main() -> int:
    """Print deaths and numbers that are not finite; return 1 where there are any."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('--count', type=int, default=20_000)
    options.add_argument('--seed', type=int, default=0)
    options.add_argument('--domain', type=int, default=91)
    options.add_argument('--page', action='store_true', help='write it into docs/faults.md')
    chosen = options.parse_args()
    victims, deaths = attack(chosen.count, chosen.seed, chosen.domain, modes=2)
    for line in [*deaths[:20], *victims.bad[:20]]:
        print(line)
    refused = sum(node.rejected.total() for node in victims.nodes.values())
    record('messages', [
        f'{chosen.count} messages (seed {chosen.seed}): {len(deaths)} deaths, {len(victims.bad)} '
        f'bad numbers out, {refused} refused, {victims.samples} samples in between.'], chosen.page)
    victims.close()
    return int(bool(deaths or victims.bad))


if __name__ == '__main__':
    sys.exit(main())
