"""Starts a node's process: signals are handled before anything slow is imported."""

from importlib import import_module
import os
import sys

from msg_config.quiet_start import end_at_once, open_what_is_closed

# Set before NumPy is imported, unless the user has set it: a product that waits for a second
# thread while another process has that core delays an answer by 4 to 8 ms.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')


def run_node(module: str, name: str) -> None:
    """Run the node of a class and end the process; signals are handled during its import."""
    end_at_once()
    open_what_is_closed()
    node = getattr(import_module(module), name)
    process = import_module('msg_config.node_process')
    sys.exit(process.run(node))
