"""A filter beside the incumbent, that may take its place."""

from __future__ import annotations

from dataclasses import dataclass

from flex_payload_estimator.estimators.rpe.hypothesis import Filter, level

# What begins afresh takes so long, s, to know what it can.
SETTLES_S = 0.1


@dataclass(eq=False)
class Trial:
    """
    A filter beside the incumbent.

    Attributes
    ----------
    kind : str
        'moved', 'still' or 'other'.
    runner : Filter
    since : float
        When it began, or was best to begin, s: the time of a change.
    mass : float
        The incumbent's payload then, kg.
    gain : float
        Log-likelihood over the incumbent's: since it began, or since when it was best to begin.
    age : float
        For how long that is, s; of a trial of a simpler mode, while the modes differ.
    time : float
        For how long it has run, s, counted alike.
    best : float
        The largest gain since it counts.

    """

    kind: str
    runner: Filter
    since: float
    mass: float
    gain: float = 0.0
    age: float = 0.0
    time: float = 0.0
    best: float = 0.0

    def count(self, took: float, gain: float) -> None:
        """Count a sample that took so long, s, and gained so much."""
        self.time, self.age, self.gain = self.time + took, self.age + took, self.gain + gain
        self.best = max(self.best, self.gain)

    def begin(self, time: float) -> None:
        """Count from now on."""
        self.gain = self.age = self.best = 0.0
        self.since = time

    @property
    def settles(self) -> bool:
        """Whether it began afresh just now, and pays for what the incumbent knows already."""
        if self.kind == 'other':
            return not self.runner.mode.parts and self.runner.age < SETTLES_S
        return self.kind == 'still' and self.age < SETTLES_S

    def any_time(self, incumbent: Filter) -> bool:
        """Tell whether what it takes to be may have begun at any time."""
        return self.kind == 'moved' or level(self.runner.mode) > level(incumbent.mode)

    def simpler(self, incumbent: Filter) -> bool:
        """Tell whether its mode has less freedom than the incumbent's."""
        return level(self.runner.mode) < level(incumbent.mode)

    def gained(self, incumbent: Filter) -> float:
        """Return what it gained over the incumbent with the last sample, nats."""
        if self.runner.mode.name == incumbent.mode.name:
            return self.runner.stated - incumbent.stated
        return self.runner.gained - incumbent.gained
