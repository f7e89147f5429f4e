"""The start of a node's process; imports nothing that takes time before signals are heeded."""

from importlib import import_module
import os
import sys

from msg_config.quiet_start import end_at_once, open_what_is_closed

# Before NumPy is imported, unless the user has said otherwise: a product that waits for a second
# thread, where another process has that core, holds an answer up by 4 to 8 ms.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')


def run_node(module: str, name: str) -> None:
    """Run the node of a class and end the process; its module is imported under guard."""
    end_at_once()
    open_what_is_closed()
    node = getattr(import_module(module), name)
    process = import_module('msg_config.node_process')
    sys.exit(process.run(node))
