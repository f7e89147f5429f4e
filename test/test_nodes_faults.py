"""Faults between real processes; `make faults` runs all of them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rclpy.context import Context


@pytest.mark.ros
def test_the_loop_holds_and_the_payload_comes_back(ros_context: Context, domain_id: int) -> None:
    from faults.processes import run

    # When it is said is measured by `make faults`: a test's time depends on what else runs.
    found = run(['controller stopped'], ros_context, domain_id, math.inf)
    assert not [item for item in found if item.broken], found
