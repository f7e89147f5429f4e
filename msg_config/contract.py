"""
The contract of topics and services, loaded from topics.yaml.

This module does not import ROS; `msg_config.ros` turns the contract into publishers and so on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any

import yaml

# Age of a command, s, from which drives no longer hold it and stop, as by a drive's own watchdog.
COMMAND_TIMEOUT = 0.1


@dataclass(frozen=True)
class Field:
    """A message field: its meaning and its unit."""

    meaning: str
    unit: str


@dataclass(frozen=True)
class Qos:
    """Quality of service in ROS's terms: reliability, history depth and durability."""

    reliability: str
    depth: int
    durability: str


@dataclass(frozen=True)
class Topic:
    """
    A topic of the contract.

    Attributes
    ----------
    name : str
        Name, relative to the node's namespace unless it starts with a slash.
    type : str
        Message type, ``package/msg/Name``.
    description : str
        One sentence.
    fields : Mapping[str, Field]
        The fields in use, in message order.
    qos : Qos
        Quality of service that publishers offer.
    subscribe : Qos
        Quality of service that subscriptions request; by default best effort, so that they accept
        any publisher.
    exclusive : bool
        Whether only one publisher, the first, is accepted.

    """

    name: str
    type: str  # noqa: A003
    description: str
    fields: Mapping[str, Field]
    qos: Qos
    subscribe: Qos
    exclusive: bool = False


@dataclass(frozen=True)
class Service:
    """A service that every node offers: private name, type ``package/srv/Name``, purpose."""

    name: str
    type: str  # noqa: A003
    description: str


def _contract() -> Mapping[str, Any]:
    text = files('msg_config').joinpath('topics.yaml').read_text(encoding='utf-8')
    return yaml.safe_load(text)


def _topic(name: str, entry: Mapping[str, Any]) -> Topic:
    best_effort = {**entry['qos'], 'reliability': 'best_effort', 'durability': 'volatile'}
    return Topic(
        name=name,
        type=entry['type'],
        description=entry['description'],
        fields=MappingProxyType({key: Field(**value) for key, value in entry['fields'].items()}),
        qos=Qos(**entry['qos']),
        subscribe=Qos(**{**best_effort, **entry.get('subscribe', {})}),
        exclusive=entry.get('exclusive', False),
    )


@cache
def load_topics() -> Mapping[str, Topic]:
    """Return every topic of the contract by its name."""
    topics = _contract()['topics']
    return MappingProxyType({name: _topic(name, entry) for name, entry in topics.items()})


@cache
def load_services() -> Mapping[str, Service]:
    """Return every service of the contract by its private name."""
    services = _contract()['services']
    return MappingProxyType({name: Service(name, **entry) for name, entry in services.items()})


HEAD = """# Topics and services

Made by `python -m msg_config.contract` from `msg_config/topics.yaml`, which all nodes and the bag
reader load. Names are relative to a node's namespace unless they start with a slash. SI units,
radians, axes of REP 103. Of the quality of service: reliability, depth.

"""


def _qos_text(qos: Qos) -> str:
    kept = ', transient local' if qos.durability == 'transient_local' else ''
    return f'{qos.reliability.replace("_", " ")}, {qos.depth}{kept}'


def _section(topic: Topic) -> str:
    heard = ' One publisher is heard, the first.' if topic.exclusive else ''
    rows = (f'| `{name}` | {field.meaning} | {field.unit if field.unit != "-" else ""} |'
            for name, field in topic.fields.items())
    return '\n'.join([
        f'## {topic.name}', '', f'`{topic.type}`. {topic.description}{heard}',
        f'Published {_qos_text(topic.qos)}; subscribed {_qos_text(topic.subscribe)}.', '',
        '| field | meaning | unit |', '|---|---|---|', *rows, '', ''])


def page() -> str:
    """Return the docs page of the topics and services, Markdown."""
    rows = (f'| `{service.name}` | `{service.type}` | {service.description} |\n'
            for service in load_services().values())
    services = '## Services\n\n| service | type | what it does |\n|---|---|---|\n'
    return ''.join([HEAD, *map(_section, load_topics().values()), services, *rows])


if __name__ == '__main__':
    print(page(), end='')
