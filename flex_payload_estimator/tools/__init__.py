"""Command-line tools; what holds for all of them is done by flex_plant_sim's."""

import flex_plant_sim.tools  # noqa: F401
