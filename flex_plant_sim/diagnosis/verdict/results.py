"""What a diagnosis says: data classes that the report reads, without computation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from flex_plant_sim.effects.base import Effect

# See docs/report.md.
Verdict = Literal['nothing_wrong', 'cause', 'cannot_tell', 'not_in_catalogue',
                  'cause_and_remainder', 'data_cannot_answer']


@dataclass(frozen=True)
class ParameterValue:
    """
    A fitted parameter with its 95 % interval, in `unit`.

    Attributes
    ----------
    name : str
    value, low, high : float
        Of one that has few values, the ends of those that hold 95 %.
    unit : str
    choices : tuple of (str, float)
        Of one that has few values: what those that hold 95 % are called, and their probabilities,
        the most probable first.

    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    choices: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Alternative:
    """
    A fitted hypothesis (an effect at a site) that may stand in the place of a cause.

    Attributes
    ----------
    name, site : str
    parameters : tuple of ParameterValue
    gain : float
        Log-evidence over the model without it, nats.
    probability : float
        Posterior probability that this is the cause.

    """

    name: str
    site: str
    parameters: tuple[ParameterValue, ...]
    gain: float
    probability: float


@dataclass(frozen=True)
class PartEstimate:
    """
    A part of the robot with its prior and its posterior.

    Attributes
    ----------
    name : str
    unit : str
        Of the deviation from the robot file; empty where it is one of the logarithm.
    prior : float
        Prior standard deviation.
    mean, deviation : float
        Posterior mean and standard deviation.
    written : str
        What a robot file changes for it, where no key of it has the name.

    """

    name: str
    unit: str
    prior: float
    mean: float
    deviation: float
    written: str = ''


@dataclass(frozen=True)
class Cause:
    """
    A named cause.

    Attributes
    ----------
    name, site : str
    sentence : str
        In an engineer's words, with the size and its uncertainty.
    probability : float
    parameters : tuple of ParameterValue
    look_alikes : tuple of str
        Identifiers that this record cannot tell from it.
    effect : Effect
        Ready for an ExtendedArm.

    """

    name: str
    site: str
    sentence: str
    probability: float
    parameters: tuple[ParameterValue, ...]
    look_alikes: tuple[str, ...]
    effect: Effect


@dataclass(frozen=True)
class Hint:
    """What was said of a log when it was read: its `file`, and one line of `text`."""

    file: str
    text: str


@dataclass(frozen=True)
class DetectionLimit:
    """
    The smallest size that a record would have shown.

    Attributes
    ----------
    value : float
        Of an effect with several forms, such as a sensor before or behind a gear, a link that is
        softer or stiffer, of the form that is hardest to see.
    unit : str
    easiest : float
        Of the form that is easiest to see.

    """

    value: float
    unit: str
    easiest: float


@dataclass(frozen=True)
class Diagnosis:
    """
    The whole answer of one run.

    Attributes
    ----------
    verdict : Verdict
    sentence : str
    causes : tuple of Cause
    cannot_tell : tuple of tuple of str
        Sets of identifiers that cannot be separated.
    detection_limits : Mapping
        'identifier:site' to the smallest size that this record would have shown.
    not_excited : tuple of str
        'identifier:site' that this record cannot show at any sensible size.
    rounds : tuple of tuple of Alternative
        For every cause, the hypotheses that may stand in its place, the most probable first.
    advice : str
        What to record next, where it would help.
    remainder : Mapping
        Factor of each channel's errors over what the model with the causes states.
    parts : tuple of PartEstimate
        All parts of the robot, estimated with the causes.
    sets : tuple of (tuple of str, float)
        Labels of the sets of causes (`unknown` is one), with their probabilities.
    effects : Mapping
        Posterior probability of every effect, by identifier, of `unknown` and of `nothing`.
    hints : tuple of Hint
        What was said of the logs.

    """

    verdict: Verdict
    sentence: str
    causes: tuple[Cause, ...] = ()
    cannot_tell: tuple[tuple[str, ...], ...] = ()
    detection_limits: Mapping[str, DetectionLimit] = field(default_factory=dict)
    not_excited: tuple[str, ...] = ()
    rounds: tuple[tuple[Alternative, ...], ...] = ()
    advice: str = ''
    remainder: Mapping[str, object] = field(default_factory=dict)
    parts: tuple[PartEstimate, ...] = ()
    sets: tuple[tuple[tuple[str, ...], float], ...] = ()
    effects: Mapping[str, float] = field(default_factory=dict)
    hints: tuple[Hint, ...] = ()

    @property
    def names_nothing(self) -> bool:
        """Return whether nothing is wrong, or what is has no name."""
        return self.verdict != 'data_cannot_answer' and not self.causes

    @property
    def moves_parts_alone(self) -> bool:
        """Return whether the extended robot differs from the file by its parts alone."""
        return self.verdict in ('nothing_wrong', 'cannot_tell') and not self.causes
