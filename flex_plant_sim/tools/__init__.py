"""Command-line tools that need no estimator, and the parts that all tools share."""

import os
import sys

from flex_plant_sim.quiet_signals import quiet_until_running

# Set before NumPy is imported, unless the user has set it: the matrices here are small, so threads
# of the linear algebra library cost several times what they gain.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
# A tool's own process is started by its script, or by python -m, which imports this first.
IN_OWN_PROCESS = os.path.basename(sys.argv[0] if sys.argv else '').startswith(('flex_', '-m'))
if IN_OWN_PROCESS:
    quiet_until_running()
    from msg_config.quiet_start import open_what_is_closed
    open_what_is_closed()
    from flex_plant_sim.tools.memory_limit import refuse_too_little
    refuse_too_little()
