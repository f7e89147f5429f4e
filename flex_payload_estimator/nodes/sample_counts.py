"""What became of the samples of a node: lost, refused, passed over; and at which interval."""

from __future__ import annotations

from collections import deque

from msg_config.recent_counts import RecentCounts, WINDOW

# Share of the sampling time by which an interval may be off before a sample counts as lost.
UNEVEN = 0.5
# Samples over which their mean interval is taken, and the share of the sampling time from which it
# is another one: estimates of a model that is 2 % too fast are off by 1 to 2 %.
RATE_SAMPLES, RATE_AGREES = 200, 0.02
# Excess of long (uneven) intervals over others from which samples come too seldom (in bursts), not
# by accident. Where each is so with probability p, a walk of such steps is ever so far above its
# least value with (p / (1 - p))^20 (the gambler's ruin): 4e-8 where three samples of ten are lost
# at random.
EXCESS = 20


class _Excess:
    """Whether most intervals are of some kind; it ends once as many more are not."""

    def __init__(self) -> None:
        self._count, self.found = 0, False

    def add(self, of_kind: bool) -> None:
        """Count an interval."""
        self._count = min(max(self._count + (1 if of_kind else -1), 0), EXCESS)
        self.found = self._count > 0 if self.found else self._count == EXCESS


class SampleCounts:
    """
    Counts what became of the samples, and says it for the diagnostics.

    Attributes
    ----------
    restarts : int
        How often the time has leapt.
    sample_time : float
        Told, s.

    """

    def __init__(self, sample_time: float):
        self.sample_time, self.restarts = sample_time, 0
        self._counts: RecentCounts[str] = RecentCounts()
        self._time = self._samples = 0.0
        self._mean, self._long, self._uneven = sample_time, _Excess(), _Excess()
        self._intervals: deque[float] = deque(maxlen=EXCESS)

    @property
    def slow(self) -> bool:
        """Return whether samples come too seldom: most intervals lack a sample."""
        return self._long.found

    @property
    def bursts(self) -> str:
        """Return how stamps come in bursts, as of packets stamped on arrival; empty else."""
        if self.slow or not self._uneven.found:
            return ''
        return (f'stamps come in bursts, {min(self._intervals):.2g} to '
                f'{max(self._intervals):.2g} s apart, expected {self.sample_time:.4g} s '
                '(sample_time): stamp samples when they are taken, not when they arrive')

    @property
    def passed_over(self) -> int:
        """Return how many samples were passed over so far."""
        return self._counts.total['passed over']

    def add(self, kind: str, now: float, count: int = 1) -> None:
        """Count samples that were 'lost', 'refused' or 'passed over', at a wall time, s."""
        self._counts.add(kind, now, count)

    def restart(self) -> None:
        """Count a leap in time; the mean begins anew."""
        self.restarts += 1
        self._time = self._samples = 0.0

    def add_interval(self, interval: float, now: float) -> bool:
        """Take the interval to the last sample, s; return whether it is the sampling time."""
        ratio = interval / self.sample_time
        long = ratio >= 1.0 + UNEVEN
        even = not long and ratio >= 1.0 - UNEVEN
        self._long.add(long)
        self._uneven.add(not even)
        self._intervals.append(interval)
        if not long:
            self._time, self._samples = self._time + interval, self._samples + 1.0
        if self._samples >= RATE_SAMPLES:
            self._mean, self._time, self._samples = self._time / self._samples, 0.0, 0.0
        if not even:
            self.add('lost', now, max(round(ratio) - 1, 1))
        return even

    def status(self, now: float, reason: str) -> tuple[str, str]:
        """Return level and text of the diagnostics; `reason` is that of the last refusal."""
        recent = self._counts.recent(now)
        if recent['passed over']:
            due = WINDOW / self.sample_time
            return 'warn', (f'too slow: {recent["passed over"]} of {due:.0f} samples passed over '
                            f'in the last {WINDOW:g} s')
        if recent['refused']:
            return 'warn', f'{recent["refused"]} samples refused lately: {reason}'
        if self.bursts:
            return 'error', self.bursts
        if abs(self._mean - self.sample_time) > RATE_AGREES * self.sample_time:
            return 'warn', (f'samples come every {self._mean:.4g} s, expected '
                            f'{self.sample_time:.4g} s (sample_time)')
        if recent['lost']:
            return 'warn', f'{recent["lost"]} samples lost or not at the sampling time lately'
        return 'ok', 'ok'

    def values(self) -> dict[str, object]:
        """Return the counts since the start."""
        total = self._counts.total
        return {'lost or uneven': total['lost'] + total['passed over'],
                'refused': total['refused'], 'restarts': self.restarts}
