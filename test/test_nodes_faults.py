"""Faults between real processes; `make faults` runs all of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rclpy.context import Context


@pytest.mark.ros
def test_the_loop_holds_and_the_payload_comes_back(ros_context: Context, domain_id: int) -> None:
    from faults.processes import run

    # On a busy machine a node speaks half a second later than the second that is asked of it.
    found = run(['controller stopped', 'second plant'], ros_context, domain_id, said_within=1.5)
    assert not [item for item in found if item.broken], found
