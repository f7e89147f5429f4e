"""Counts events, in total and in the last seconds, for the diagnostics of nodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable
from typing import Generic, TypeVar

# Time, s, for which an event affects the diagnostics: long enough for a person to see it.
WINDOW = 10.0
Key = TypeVar('Key', bound=Hashable)


class RecentCounts(Generic[Key]):
    """
    Counts by key; those of the last WINDOW seconds are kept in buckets of one second.

    Attributes
    ----------
    total : Counter
        Counts since the start.

    """

    def __init__(self) -> None:
        self.total: Counter[Key] = Counter()
        self._buckets: dict[int, Counter[Key]] = {}

    def add(self, key: Key, now: float, count: int = 1) -> None:
        """Add to a count at a time, s."""
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
