"""
Assembles samples from messages whose stamps are close to each other.

The nodes use it on live topics and the bag reader on recorded ones, before the gate.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
import math
from statistics import median
from typing import Any

# Share of the sampling interval by which the stamps of one sample may differ. Below one half, two
# messages of one topic cannot both be close enough, so that the first match is the only one.
SLOP = 0.4
# Messages of a part that may wait for another part: as many as a publisher keeps (topics.yaml).
PENDING = 10
# Recent offsets between stamps, of which the median is reported if no stamps match, and recent
# stamps, of which the mean interval is.
OFFSETS = 50


def slop_of(sample_time: float) -> int:
    """Return the largest difference, ns, of the stamps of one sample, at a sample time, s."""
    return int(SLOP * sample_time * 1e9)


@dataclass(frozen=True)
class PairedSample:
    """
    A complete sample.

    Attributes
    ----------
    stamp : int
        Stamp of its first part, ns.
    parts : dict
        Part name to its value.
    passed : sequence
        Values of the first part since the sample before that make no sample.

    """

    stamp: int
    parts: dict[str, Any]
    passed: Sequence[Any] = ()


@dataclass
class _Waiting:
    queue: deque[tuple[int, Any]] = field(default_factory=deque)
    stamps: deque[int] = field(default_factory=lambda: deque(maxlen=OFFSETS))
    count: int = 0

    def put(self, stamp: int, value: Any) -> None:
        """Add a value to the queue; it replaces one with the same stamp."""
        _note(self.stamps, stamp)
        for k, (at, _) in enumerate(self.queue):
            if at == stamp:
                self.queue[k] = (stamp, value)
                return
        self.queue.append((stamp, value))

    def nearest(self, stamp: int) -> tuple[int, Any] | None:
        """Return the waiting stamp and value nearest to a stamp."""
        if self.queue and self.queue[0][0] == stamp:
            return self.queue[0]
        return min(self.queue, key=lambda item: abs(item[0] - stamp), default=None)


class Synchroniser:
    """
    Collects the parts of a sample, as message_filters' ApproximateTimeSynchronizer does.

    The stamp of the first part becomes that of the sample. The parts may come in any order,
    twice, or never; at most PENDING messages of each part wait.

    Parameters
    ----------
    parts : sequence of str
        Names of the parts.
    slop : int
        Largest difference of their stamps from that of the first part, ns; see slop_of.

    """

    def __init__(self, parts: Sequence[str], slop: int):
        self._parts, self._slop = tuple(parts), slop
        self.clear()

    def clear(self) -> None:
        """Drop all waiting messages and counts."""
        self._waiting = {part: _Waiting() for part in self._parts}
        self._offsets: dict[str, deque[int]] = {
            part: deque(maxlen=OFFSETS) for part in self._parts[1:]}
        self._paired: deque[int] = deque(maxlen=OFFSETS)

    def add(self, part: str, stamp: int, value: Any) -> PairedSample | None:
        """Return the sample that this part, with its stamp in ns, completes, or None."""
        own = self._waiting[part]
        own.count += 1
        own.put(stamp, value)
        reference = self._reference(part, stamp)
        found = None if reference is None else self._complete(reference)
        if found is None and len(own.queue) > PENDING:
            own.queue.popleft()
        return found

    def _reference(self, part: str, stamp: int) -> int | None:
        """Return the waiting stamp of the first part that is nearest to a stamp."""
        if part == self._parts[0]:
            return stamp
        nearest = self._waiting[self._parts[0]].nearest(stamp)
        if nearest is None:
            return None
        self._offsets[part].append(stamp - nearest[0])
        return nearest[0]

    def _complete(self, reference: int) -> PairedSample | None:
        chosen = {}
        for part, waiting in self._waiting.items():
            near = waiting.nearest(reference)
            if near is None or abs(near[0] - reference) > self._slop:
                return None
            chosen[part] = near
        passed = [self._drop_up_to(part, stamp) for part, (stamp, _) in chosen.items()]
        _note(self._paired, reference)
        return PairedSample(reference, {part: value for part, (_, value) in chosen.items()},
                            passed[0])

    def _drop_up_to(self, part: str, stamp: int) -> list[Any]:
        """
        Drop messages older than those of a complete sample: their other parts were lost.

        Return their values.
        """
        queue, dropped = self._waiting[part].queue, []
        while queue:
            at, value = queue.popleft()
            if at == stamp:
                break
            dropped.append(value)
        return dropped

    def interval(self, part: str = '') -> float:
        """Return the mean interval of the last stamps of a part, or of samples, s, or NaN."""
        stamps = self._waiting[part].stamps if part else self._paired
        return (stamps[-1] - stamps[0]) * 1e-9 / (len(stamps) - 1) if len(stamps) > 1 else math.nan

    def why_nothing(self) -> str:
        """Return in one line why no sample is complete; empty if no message came yet."""
        counts = {part: waiting.count for part, waiting in self._waiting.items()}
        if not any(counts.values()):
            return ''
        silent = [part for part, count in counts.items() if not count]
        if silent:
            came = ', '.join(part for part, count in counts.items() if count)
            return f'{", ".join(silent)}: no message, while {came} comes'
        for part, offsets in self._offsets.items():
            off = median(offsets) if offsets else 0
            if abs(off) > self._slop:
                return (f'{part}: header.stamp: expected within {self._slop * 1e-6:.4g} ms of '
                        f'{self._parts[0]}, got {off * 1e-6:+.4g} ms')
        return f'{", ".join(counts)}: no stamps that belong together'


def _note(stamps: deque[int], stamp: int) -> None:
    """Keep a stamp that is later than those before; one that is not begins anew if it is early."""
    if stamps and stamp < stamps[0]:
        stamps.clear()
    if not stamps or stamp > stamps[-1]:
        stamps.append(stamp)
