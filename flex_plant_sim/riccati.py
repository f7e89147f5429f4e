"""
The discrete Riccati equation by doubling its horizon, for one or many systems at once.

Controller and predictor of the payload estimator use it, and the filters of the diagnosis.
"""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
import numpy as np

# 2^64 samples are longer than any experiment.
DOUBLINGS = 64
# Growth over the last doubling, as a share of its own size, at which a state has settled: growth
# falls quadratically, so the next would be below rounding.
SETTLED = 1e-12


def settled_cost(e: Array, g: Array, h: Array) -> Array:
    """
    Return what S+ = H + F' S (I + G S)^-1 F tends to from zero, with F = I + E, (…, n, n).

    The structure-preserving doubling algorithm (Chu, Fan, Lin and Wang, International Journal of
    Control 77, 2004) in delta form: I + E carries the state over 2^k samples, G and H are what
    controls and costs of those samples sum to, and H tends to S. E is carried instead of I + E,
    so that short samples keep their digits. Each state has to settle by its own size: their units
    differ.

    Parameters
    ----------
    e, g, h : Array
        Of one sample, (…, n, n), or (n, n) for all: F - I; B Q_2^-1 B'; the cost of a state, Q_1.

    Raises
    ------
    FloatingPointError
        One does not settle: a mode that does not decay is out of the controls' reach, or costs
        nothing.

    """
    e, g, h = np.broadcast_arrays(e, g, h)
    for _ in range(DOUBLINGS):
        with np.errstate(over='ignore', invalid='ignore'):
            e, g, h, growth = _doubled(e, g, h)
        if not np.isfinite(h).all():
            break
        # What is nothing but rounding may be negative.
        grown, own = (np.diagonal(x, axis1=-2, axis2=-1) for x in (growth, h))
        if np.all(np.abs(grown) <= SETTLED * np.abs(own)):
            return h
    raise FloatingPointError('riccati: the iteration does not settle')


def _doubled(e: Array, g: Array, h: Array) -> tuple[Array, Array, Array, Array]:
    """Return E, G and H of twice as many samples, and by how much H grew."""
    n = e.shape[-1]
    unit = np.eye(n)
    f, product = unit + e, g @ h
    transposed = np.swapaxes(f, -1, -2)
    # W = (I + G H)^-1. Not as I - W, W G H keeps the digits of a small product.
    w = np.linalg.inv(unit + product)
    growth = transposed @ (h @ (w @ f))
    growth = 0.5 * (growth + np.swapaxes(growth, -1, -2))
    return (2.0 * e + e @ e - f @ (w @ product) @ f, g + f @ (w @ g) @ transposed, h + growth,
            growth)
