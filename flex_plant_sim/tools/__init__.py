"""Command-line tools."""

import os
import sys

from flex_plant_sim.quiet_signals import quiet_until_running

# Before NumPy is imported, and only where the user has not said otherwise: the matrices here are
# small, so that threads of the linear algebra library cost several times what they give.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
# Only in a tool's own process: its script, or python -m, which imports this package first.
if os.path.basename(sys.argv[0] if sys.argv else '').startswith(('flex_', '-m')):
    quiet_until_running()
    from msg_config.quiet_start import open_what_is_closed
    open_what_is_closed()
    from flex_plant_sim.tools.memory_limit import refuse_too_little
    refuse_too_little()
