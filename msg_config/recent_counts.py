"""How often things happened: in all, and lately."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable
from typing import Generic, TypeVar

# What is older no longer colours the diagnostics, s: long enough to be seen by a person.
WINDOW = 10.0
Key = TypeVar('Key', bound=Hashable)


class RecentCounts(Generic[Key]):
    """
    Counts by key, those of the last WINDOW seconds in buckets of a second.

    Attributes
    ----------
    total : Counter
        Since the start.

    """

    def __init__(self) -> None:
        self.total: Counter[Key] = Counter()
        self._buckets: dict[int, Counter[Key]] = {}

    def add(self, key: Key, now: float, count: int = 1) -> None:
        """Count at a time, s."""
        self.total[key] += count
        self._drop(now)
        self._buckets.setdefault(int(now), Counter())[key] += count

    def recent(self, now: float) -> Counter[Key]:
        """Return the counts of the last WINDOW seconds."""
        self._drop(now)
        return sum(self._buckets.values(), Counter())

    def _drop(self, now: float) -> None:
        for second in [second for second in self._buckets if now - second > WINDOW]:
            del self._buckets[second]
