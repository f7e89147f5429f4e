"""A filter beside the incumbent, that may take its place."""

from __future__ import annotations

from dataclasses import dataclass

from flex_payload_estimator.estimators.rpe.hypothesis import Filter


@dataclass
class Trial:
    """
    A filter beside the incumbent.

    Attributes
    ----------
    kind : str
        'moved', 'still', 'other', 'again' or 'former'.
    runner : Filter
    since : float
        When it began, s; of a walking payload, when it was furthest behind: the time of a change.
    mass : float
        The incumbent's payload then, kg.
    gain, lowest : float
        Log-likelihood over the incumbent's since it began, and the least that it was.
    age : float
        How long it has run, s; a trial of another mode, while the modes differ.
    time : float
        How long it has run, s.
    square : float
        Its whitened innovations' mean square summed over that time, s.
    left : int
        Trials that it may begin again.
    place : int
        Number of the next sample that one which begins again is to learn.

    """

    kind: str
    runner: Filter
    since: float
    mass: float
    gain: float = 0.0
    lowest: float = 0.0
    age: float = 0.0
    time: float = 0.0
    square: float = 0.0
    left: int = 0
    place: int = 0
