"""Text of a value with its uncertainty, in significant digits only."""

from __future__ import annotations

import math


def decimals_of(std: float) -> int:
    """Return the number of decimals that shows two digits of a standard deviation."""
    if not (math.isfinite(std) and std > 0.0):
        return 4
    return min(max(1 - math.floor(math.log10(std)), 1), 9)


def with_uncertainty(value: float, std: float) -> str:
    """Return '0.1003 ± 0.0012': two digits of the standard deviation, and as many decimals."""
    digits = decimals_of(std)
    return f'{value:.{digits}f} ± {std:.{digits}f}'
