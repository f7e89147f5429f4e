"""What the nodes agree on. Nothing is imported here, so that `quiet_start` can come first."""
