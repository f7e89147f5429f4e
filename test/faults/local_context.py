"""A ROS context on this machine alone, for the fault programs."""

from __future__ import annotations

import os

from msg_config.transport import avoid_shared_memory
import rclpy
from rclpy.context import Context


def local_context(domain: int) -> Context:
    """Return an initialised context of a domain whose topics stay on this machine and on UDP."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    avoid_shared_memory()
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    return context
