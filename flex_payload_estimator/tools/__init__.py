"""Command-line tools; importing flex_plant_sim.tools does what all of them need at the start."""

import flex_plant_sim.tools  # noqa: F401
