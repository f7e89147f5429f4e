"""The entry point of the node plant_sim; `python -m flex_plant_sim.nodes.start` runs it too."""

from msg_config.node_start import run_node


def plant_sim() -> None:
    """Run plant_sim until Ctrl-C."""
    run_node('flex_plant_sim.nodes.plant_sim_node', 'PlantSim')


if __name__ == '__main__':
    plant_sim()
