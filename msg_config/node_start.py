"""The start of a node's process; imports nothing that takes time before signals are heeded."""

from importlib import import_module
import sys

from msg_config.quiet_start import end_at_once, open_what_is_closed


def run_node(module: str, name: str) -> None:
    """Run the node of a class and end the process; its module is imported under guard."""
    end_at_once()
    open_what_is_closed()
    node = getattr(import_module(module), name)
    process = import_module('msg_config.node_process')
    sys.exit(process.run(node))
