"""
A tool that ends with the process that started it, however that one ends.

`python -m flex_payload_estimator.tools.bound PARENT MODULE ARGUMENT…` runs the tool of a module
for the process PARENT. After a kill -9 nothing but the kernel can end it.
"""

from __future__ import annotations

import ctypes
from importlib import import_module
import os
import signal
import sys

from flex_plant_sim.quiet_signals import INTERRUPTED

# Of prctl(2): the signal that a process gets when the thread that started it ends.
PR_SET_PDEATHSIG = 1


def main() -> int:
    """Run the tool and return its exit code."""
    parent, module, *arguments = sys.argv[1:]
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != int(parent):  # it has ended before
        return INTERRUPTED
    code: int = import_module(module).main(arguments)
    return code


if __name__ == '__main__':
    sys.exit(main())
