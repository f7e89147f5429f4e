"""Selects the transport of topics: UDP, since shared memory does not survive a killed process."""

from __future__ import annotations

from collections.abc import MutableMapping
import os
from pathlib import Path

LOOPBACK = Path(__file__).with_name('loopback.xml')
TRANSPORTS, PROFILES = 'FASTDDS_BUILTIN_TRANSPORTS', 'FASTDDS_DEFAULT_PROFILES_FILE'
RANGE, PEERS = 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_STATIC_PEERS'
# If one of these variables is set, the user has chosen the transports.
USER_SETTINGS = (TRANSPORTS, PROFILES, 'FASTRTPS_DEFAULT_PROFILES_FILE')


def avoid_shared_memory(environment: MutableMapping[str, str] = os.environ) -> None:
    """
    Keep this process's topics on UDP, unless the user has settings of Fast DDS.

    A process that is killed leaves its shared memory behind. The next process may then delete
    memory on which another still listens (Fast DDS 3.2.2, its issue 5469), or wait for ever for a
    segment that was being created. With LOCALHOST, ROS 2 Kilted and later open shared memory
    whatever FASTDDS_BUILTIN_TRANSPORTS says; there a profile with the same effect is used instead.
    To be called before rclpy creates a node.

    Parameters
    ----------
    environment : MutableMapping
        The environment variables to change.

    """
    if any(name in environment for name in USER_SETTINGS):
        return
    environment[TRANSPORTS] = 'UDPv4'
    if environment.get(RANGE, '').upper() == 'LOCALHOST' and _opens_shared_memory(environment):
        environment[RANGE] = 'SYSTEM_DEFAULT'
        environment[PROFILES] = str(LOOPBACK)


def _opens_shared_memory(environment: MutableMapping[str, str]) -> bool:
    """Return whether Fast DDS 3 is the middleware, which Kilted brought with EventsExecutor."""
    if 'fastrtps' not in environment.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp'):
        return False
    if environment.get(PEERS):  # a profile would not know them
        return False
    try:
        from rclpy.experimental import EventsExecutor  # noqa: F401
    except ImportError:
        return False
    return True
