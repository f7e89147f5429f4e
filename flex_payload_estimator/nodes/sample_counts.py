"""What became of the samples of a node: lost, refused, passed over; and at which interval."""

from __future__ import annotations

from msg_config.recent_counts import RecentCounts, WINDOW

# Share of the sampling time by which an interval may be off before a sample counts as lost.
UNEVEN = 0.5
# Samples over which their mean interval is taken, and the share of the sampling time from which it
# is another one: estimates of a model that is 2 % too fast are off by 1 to 2 %.
RATE_SAMPLES, RATE_AGREES = 200, 0.02
# Excess of long intervals over others from which samples come too seldom, not by accident. Where
# each is long with probability p, a walk of such steps is ever so far above its least value with
# (p / (1 - p))^20 (the gambler's ruin): 4e-8 where three samples of ten are lost at random.
EXCESS = 20


class SampleCounts:
    """
    Counts what became of the samples, and says it for the diagnostics.

    Attributes
    ----------
    restarts : int
        How often the time has leapt.
    sample_time : float
        Told, s.
    slow : bool
        Whether samples come too seldom: most intervals lack a sample. It ends once as many more
        are right again.

    """

    def __init__(self, sample_time: float):
        self.sample_time, self.restarts = sample_time, 0
        self._counts: RecentCounts[str] = RecentCounts()
        self._time = self._samples = 0.0
        self._mean, self._excess, self.slow = sample_time, 0, False

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
        self._excess = min(max(self._excess + (1 if long else -1), 0), EXCESS)
        self.slow = self._excess > 0 if self.slow else self._excess == EXCESS
        if not long:
            self._time, self._samples = self._time + interval, self._samples + 1.0
        if self._samples >= RATE_SAMPLES:
            self._mean, self._time, self._samples = self._time / self._samples, 0.0, 0.0
        even = not long and ratio >= 1.0 - UNEVEN
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
