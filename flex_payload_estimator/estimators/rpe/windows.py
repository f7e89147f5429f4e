"""Scores of the payload over windows: how coloured they are, and whether they pull one way."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

from flex_plant_sim.arm.second_order import Array

# What the scores' colour is taken for before blocks have shown it, and how many that is worth.
COLOUR_PRIOR, PRIOR_BLOCKS = 3.0, 4.0
SCATTER_PRIOR, PRIOR_WINDOWS = 2.0, 8.0
# A payload drifts where this many windows in a row agree, on average by so many sigma.
PERSISTENT, SIGMAS = 6, 4.0


def _standardised(window: tuple[float, float]) -> float:
    score, known = window
    return score / math.sqrt(known) if known > 0.0 else 0.0


@dataclass(frozen=True)
class Windows:
    """
    What past blocks and windows said of the payload.

    The score psi'S^-1 e and the information psi'S^-1 psi of the block and of the two staggered
    windows that still go on stand in `Hypothesis.sums`, (2, 3).

    Attributes
    ----------
    squared, expected : float
        Sums over past blocks of the first score squared, and of its information.
    changes : float
        Sum over past windows of half the squared difference of a window's standardised score
        from the one before: what scores scatter by, without what persists (von Neumann 1941).
    blocks : float
        How many.
    closed : tuple of (float, float)
        Score and information of the last PERSISTENT windows; each overlaps half the next.

    """

    squared: float = 0.0
    expected: float = 0.0
    changes: float = 0.0
    blocks: float = 0.0
    closed: tuple[tuple[float, float], ...] = ()

    def turned(self, sums: Array, column: int) -> Windows:
        """Return it with the block of `sums` closed, and the window of a column."""
        score, known = sums[:, column].tolist()
        closed = (*self.closed, (score, known))[-PERSISTENT:]
        change = 0.0
        if len(closed) > 2:
            change = 0.5 * (_standardised(closed[-1]) - _standardised(closed[-3]))**2
        return Windows(self.squared + sums[0, 0]**2, self.expected + sums[1, 0],
                       self.changes + change, self.blocks + 1.0, closed)

    def emptied(self) -> Windows:
        """Return it without the last windows."""
        return replace(self, closed=())

    @property
    def scatter(self) -> float:
        """Return the variance of windows' standardised scores, at least 1."""
        return max(1.0, (SCATTER_PRIOR * PRIOR_WINDOWS + self.changes)
                   / (PRIOR_WINDOWS + self.blocks))

    def trend(self) -> float:
        """Return the payload step, kg, that the last windows agree on; 0 where they do not."""
        scores = [_standardised(window) for window in self.closed]
        if len(scores) < PERSISTENT or min(scores) * max(scores) <= 0.0:
            return 0.0
        if abs(sum(scores)) < SIGMAS * PERSISTENT * self.scatter**0.5:
            return 0.0
        return sum(score for score, _ in self.closed) / sum(known for _, known in self.closed)

    @property
    def colour(self) -> float:
        """Return the score's long-run variance over that of white innovations, at least 1."""
        if self.expected <= 0.0:
            return COLOUR_PRIOR
        sums = COLOUR_PRIOR * PRIOR_BLOCKS + self.blocks * self.squared / self.expected
        return max(1.0, sums / (PRIOR_BLOCKS + self.blocks))
