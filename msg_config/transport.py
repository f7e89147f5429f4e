"""How the topics travel: over UDP, for shared memory does not survive a killed process."""

from __future__ import annotations

from collections.abc import MutableMapping
import os
from pathlib import Path

LOOPBACK = Path(__file__).with_name('loopback.xml')
TRANSPORTS, PROFILES = 'FASTDDS_BUILTIN_TRANSPORTS', 'FASTDDS_DEFAULT_PROFILES_FILE'
RANGE, PEERS = 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_STATIC_PEERS'
# Where a user set one of these, the transports are the user's.
OWN = (TRANSPORTS, PROFILES, 'FASTRTPS_DEFAULT_PROFILES_FILE')


def avoid_shared_memory(environment: MutableMapping[str, str] = os.environ) -> None:
    """
    Keep this process's topics on UDP, unless the user's own settings of Fast DDS say otherwise.

    A process that is killed leaves its shared memory behind: what starts next may delete memory
    on which another still listens (Fast DDS 3.2.2, its issue 5469), or wait for ever for a segment
    that was being made. With LOCALHOST, ROS 2 Kilted and later open shared memory whatever
    FASTDDS_BUILTIN_TRANSPORTS says; there a profile that means the same takes its place.
    To be called before rclpy makes a node.

    Parameters
    ----------
    environment : MutableMapping
        What is changed.

    """
    if any(name in environment for name in OWN):
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
