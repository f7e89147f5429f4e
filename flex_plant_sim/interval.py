"""What is credible: the probability that stated intervals and sets hold, and what holds it."""

from collections.abc import Hashable, Mapping
from statistics import NormalDist
from typing import TypeVar

Value = TypeVar('Value', bound=Hashable)

CREDIBLE_LEVEL = 0.95
# Half width of such an interval, in standard deviations of a Gaussian.
Z95 = NormalDist().inv_cdf(0.5 * (1.0 + CREDIBLE_LEVEL))


def credible_values(probability: Mapping[Value, float]) -> tuple[Value, ...]:
    """Return the fewest values that hold CREDIBLE_LEVEL of a weight, the most probable first."""
    total, whole, kept = 0.0, sum(probability.values()), list[Value]()
    for value, share in sorted(probability.items(), key=lambda item: -item[1]):
        kept.append(value)
        total += share
        if total >= CREDIBLE_LEVEL * whole:
            break
    return tuple(kept)
