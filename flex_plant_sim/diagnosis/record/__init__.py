"""Records: windows to work on and to lock, sensor noise."""
