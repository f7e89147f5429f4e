"""Independent truth of the two-link flexible arm: finite elements, own integrator, own effects."""
