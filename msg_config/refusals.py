"""The messages that a node refused: counts by topic and kind, and what diagnostics say of them."""

from __future__ import annotations

from collections import Counter

from msg_config.recent_counts import RecentCounts, WINDOW


class Refusals:
    """
    Counts of refused messages; times are of a monotonic clock, s.

    Attributes
    ----------
    by_topic : Counter
        Since the start.
    last : str
        Reason of the last refusal.

    """

    def __init__(self) -> None:
        self.by_topic: Counter[str] = Counter()
        self.last = ''
        self._counts: RecentCounts[tuple[str, str]] = RecentCounts()

    def add(self, topic: str, kind: str, reason: str, now: float) -> None:
        """Count a message, with the reason in words."""
        self._counts.add((topic, kind), now)
        self.by_topic[topic] += 1
        self.last = reason

    def recent_topics(self, kind: str, now: float) -> set[str]:
        """Return the topics with recent refusals of a kind."""
        return {topic for topic, found in self._counts.recent(now) if found == kind}

    def summary(self, now: float) -> tuple[str, str, dict[str, object]]:
        """Return level, text and values of the diagnostic status."""
        recent = self._counts.recent(now)
        values: dict[str, object] = {'refused': self.by_topic.total()}
        values |= {f'refused {topic}: {kind}': count
                   for (topic, kind), count in sorted(self._counts.total.items())}
        if not recent:
            return 'ok', 'ok', values
        text = f'{recent.total()} messages refused in the last {WINDOW:g} s, last: {self.last}'
        return 'warn', text, values
