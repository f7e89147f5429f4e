"""Mutated messages into the running nodes; `make faults` sends more of them."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.mark.ros
def test_no_mutated_message_ends_a_node_or_lets_a_nan_out(domain_id: int) -> None:
    from faults.mutated_messages import attack

    victims, deaths = attack(500, 11, domain_id, model='paper_reduced', modes=2)
    refused = {name: node.rejected.total() for name, node in victims.nodes.items()}
    angles = victims.by_name['plant_sim'].simulator.state[:2]
    victims.close()
    assert not deaths
    assert not victims.bad
    assert min(refused.values()) > 20
    assert victims.samples > 100
    assert np.abs(angles).max() < 1.5
