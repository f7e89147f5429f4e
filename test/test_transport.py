"""Topics keep off shared memory, which a killed process would leave behind."""

from __future__ import annotations

import os
import subprocess
import sys

from msg_config.transport import avoid_shared_memory, LOOPBACK
import pytest

NODE = """
from glob import glob
from msg_config.transport import avoid_shared_memory
avoid_shared_memory()
import rclpy
rclpy.init(domain_id=int(__import__('sys').argv[1]))
node = rclpy.create_node('here')
print(*{open(name).read().strip() for name in glob('/proc/self/task/*/comm')})
"""


def threads(domain_id: int, discovery: str) -> str:
    """Return the names of the threads of a process with a node."""
    environment = {name: value for name, value in os.environ.items()
                   if not name.startswith(('FASTDDS', 'FASTRTPS', 'ROS_AUTO'))}
    result = subprocess.run(
        [sys.executable, '-c', NODE, str(domain_id)], text=True, capture_output=True, check=True,
        env={**environment, 'ROS_AUTOMATIC_DISCOVERY_RANGE': discovery})
    return result.stdout


@pytest.mark.ros
@pytest.mark.parametrize('discovery', ['LOCALHOST', 'SUBNET'])
def test_no_thread_listens_on_shared_memory(domain_id: int, discovery: str) -> None:
    found = threads(domain_id, discovery)
    assert 'dds.udp' in found and 'dds.shm' not in found
    # Multicast goes beyond the machine: its port is the domain's first.
    assert (f'dds.udp.{7400 + 250 * domain_id}' in found) == (discovery == 'SUBNET')


@pytest.mark.parametrize('own', [
    {'FASTDDS_BUILTIN_TRANSPORTS': 'DEFAULT'}, {'FASTDDS_DEFAULT_PROFILES_FILE': 'mine.xml'}])
def test_what_the_user_set_stands(own: dict[str, str]) -> None:
    environment = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', **own}
    before = dict(environment)
    avoid_shared_memory(environment)
    assert environment == before


def test_a_profile_takes_the_place_of_localhost_where_nothing_else_is_asked() -> None:
    asked = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    for more in ({}, {'ROS_STATIC_PEERS': '10.0.0.7'}, {'RMW_IMPLEMENTATION': 'rmw_zenoh_cpp'}):
        environment = {**asked, **more}
        avoid_shared_memory(environment)
        replaced = environment.get('FASTDDS_DEFAULT_PROFILES_FILE') == str(LOOPBACK)
        assert replaced == (not more)
        assert (environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST') == bool(more)
