"""The payload mass of the simulated arm over time: constant, pick, drop or ramp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from msg_config.errors import InputError


@dataclass(frozen=True)
class PayloadProfile:
    """
    Piecewise-linear payload; two points at the same time make a step (pick or drop).

    Attributes
    ----------
    times : tuple of float
        s, not decreasing.
    masses : tuple of float
        kg, not negative; constant before the first and after the last time.

    """

    times: tuple[float, ...]
    masses: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check times and masses."""
        if not self.masses or len(self.times) != len(self.masses):
            raise InputError(f'payload: expected as many times as masses, got {len(self.times)} '
                             f'and {len(self.masses)}')
        for mass in self.masses:
            if not (math.isfinite(mass) and mass >= 0.0):
                raise InputError(f'payload: expected a mass >= 0 kg, got {mass!r}')
        if any(b < a for a, b in zip(self.times, self.times[1:])):
            raise InputError(f'payload: expected times that do not decrease, got {self.times}')

    @classmethod
    def constant(cls, mass: float) -> PayloadProfile:
        """Return a constant payload, kg."""
        return cls((0.0,), (mass,))

    @classmethod
    def step(cls, before: float, time: float, after: float) -> PayloadProfile:
        """Return a pick or a drop at a time, s, with the masses before and after it, kg."""
        return cls((time, time), (before, after))

    @classmethod
    def of_pairs(cls, pairs: Sequence[float]) -> PayloadProfile:
        """Return the profile through pairs: time, s, mass, kg, time, mass and so on."""
        return cls(tuple(pairs[::2]), tuple(pairs[1::2]))

    def at(self, time: float) -> float:
        """Return the mass, kg, at a time, s; at a step, the mass after it."""
        later = next((k for k, t in enumerate(self.times) if t > time), len(self.times))
        if later == 0:
            return self.masses[0]
        if later == len(self.times):
            return self.masses[-1]
        (t0, t1), (m0, m1) = self.times[later - 1:later + 1], self.masses[later - 1:later + 1]
        return m0 + (m1 - m0) * (time - t0) / (t1 - t0)
