"""What the extended model gains for the payload estimate, where the true payload is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.report.extended_file import specs
from flex_plant_sim.logs.log import Log

# What the estimator estimates must not be told to it.
ESTIMATED = ('payload_mass', 'payload_change')
# Payload at the end of a log and its standard deviation, kg, of an estimator that is told a model.
Weigh = Callable[[Log, BaseModel], tuple[float, float]]


@dataclass(frozen=True)
class PayloadGain:
    """
    The payload at the end of a log, as the package's default estimator tells it.

    Attributes
    ----------
    log, estimator : str
    true : float
        kg.
    before, before_std : float
        With the nominal model: mass and its stated standard deviation, kg.
    after, after_std : float
        The same with the extended model.

    """

    log: str
    estimator: str
    true: float
    before: float
    before_std: float
    after: float
    after_std: float

    @property
    def before_percent(self) -> float:
        """Return the error with the nominal model, % of the true payload."""
        return 100.0 * (self.before - self.true) / self.true

    @property
    def after_percent(self) -> float:
        """Return the error with the extended model, % of the true payload."""
        return 100.0 * (self.after - self.true) / self.true

    def results(self) -> dict[str, Any]:
        """Return the figures for JSON, masses in kg."""
        figures = {f'{key}_kg' if isinstance(value, float) else key: value
                   for key, value in asdict(self).items()}
        return {**figures, 'before_percent': self.before_percent,
                'after_percent': self.after_percent}


def payload_gain(logs: Sequence[Log], true: float, nominal: BaseModel, extended: BaseModel,
                 estimator: str, weigh: Weigh) -> tuple[PayloadGain, ...]:
    """
    Return the payload estimates of both models over each log.

    Parameters
    ----------
    logs : sequence of Log
        With the same payload each.
    true : float
        The payload, kg, > 0.
    nominal, extended : Base
        Models; a payload_mass or payload_change found in the logs is left out: it is what is
        to be estimated.
    estimator, weigh : str, Weigh
        Its name, and what it does.

    """
    return tuple(PayloadGain(log.source, estimator, true, *weigh(log, _told(nominal, log)),
                             *weigh(log, _told(extended, log))) for log in logs)


def _told(base: BaseModel, log: Log) -> BaseModel:
    """Return what an estimator is told: a model's effects but the payload's, at the log's pace."""
    effects = [effect for effect in base.effects if effect.identifier not in ESTIMATED]
    return replace(base, robot=replace(base.robot, sample_time=log.sample_time,
                                       effects=specs(effects)))
