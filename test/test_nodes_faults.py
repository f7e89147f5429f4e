"""Faults between real processes; `make faults` runs all of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from rclpy.context import Context


@pytest.mark.ros
def test_the_loop_holds_and_the_payload_comes_back(ros_context: Context, domain_id: int) -> None:
    from faults.processes import run

    found = run(['controller stopped', 'second plant'], ros_context, domain_id)
    assert not [text for text in found.values() if text.startswith('FAILED')], found
    for text in found.values():
        assert float(text.split('said after ')[1].split()[0]) < 1.5
