"""Command-line tools."""

import os

# Before NumPy is imported, and only where the user has not said otherwise: the matrices here are
# small, so that threads of the linear algebra library cost several times what they give.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
