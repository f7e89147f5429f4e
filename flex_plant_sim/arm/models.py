"""The arm models by name, and the one that is taken where none is named."""

from __future__ import annotations

from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.paper_model import paper_model
from flex_plant_sim.arm.second_order import ArmModel

MODELS: dict[str, ArmModel] = {
    'paper_reduced': paper_model, 'paper': paper_model, 'assumed_modes': assumed_modes}
# As msg_config/parameters.yaml tells the nodes.
DEFAULT_MODEL, DEFAULT_MODES = 'assumed_modes', 3
