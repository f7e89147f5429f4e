"""Tells a /clock that never came, or that stands still while samples come."""

from __future__ import annotations

import math


class ClockWatch:
    """
    Compares ROS time with the samples at each report.

    Parameters
    ----------
    patience : float
        Time that ROS time may stand still beside new samples, s: the interval of reports.

    Attributes
    ----------
    sampled : float
        When the last sample with a new stamp came, s of a monotonic clock.

    """

    def __init__(self, patience: float):
        self._patience, self.sampled = patience, -math.inf
        self._last, self._seen = 0, -math.inf

    def __call__(self, time: int, now: float) -> str:
        """
        Return what is wrong with the clock, in one line; empty if it goes.

        Parameters
        ----------
        time : int
            ROS time, from /clock, ns.
        now : float
            s, of the same clock as `sampled`.

        """
        if time != self._last:
            self._last, self._seen = time, now
        if not time:
            return 'use_sim_time: expected a time on /clock, got none: this is stamped 0 s'
        if self.sampled - self._seen > self._patience:
            return f'use_sim_time: /clock stands still at {time * 1e-9:.9g} s while samples come'
        return ''
