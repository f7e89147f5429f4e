"""A second truth of the same arm: a chain of rigid segments in MuJoCo."""
