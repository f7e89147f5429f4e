"""The improvement of the payload estimate by the extended model, if the true payload is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.report.extended_file import specs
from flex_plant_sim.logs.log import Log

# Effects that the estimator must not be given, because it estimates them.
ESTIMATED = ('payload_mass', 'payload_change')
# An estimator: from a log and a model to the payload at the end of the log and its standard
# deviation, kg.
Weigh = Callable[[Log, BaseModel], tuple[float, float]]


@dataclass(frozen=True)
class PayloadGain:
    """
    The payload at the end of a log, as estimated by the package's default estimator.

    Attributes
    ----------
    log, estimator : str
    true : float
        kg.
    before, before_std : float
        Estimate with the nominal model and its stated standard deviation, kg.
    after, after_std : float
        The same for the extended model.

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
        Logs with the same payload.
    true : float
        The payload, kg, > 0.
    nominal, extended : BaseModel
        Models; a payload_mass or payload_change found in the logs is left out, because the payload
        is to be estimated.
    estimator, weigh : str, Weigh
        The name of the estimator, and the estimator.

    """
    return tuple(PayloadGain(log.source, estimator, true, *weigh(log, _model_told(nominal, log)),
                             *weigh(log, _model_told(extended, log))) for log in logs)


def _model_told(base: BaseModel, log: Log) -> BaseModel:
    """Return the model for the estimator: without payload effects, at the log's sample time."""
    effects = [effect for effect in base.effects if effect.identifier not in ESTIMATED]
    return replace(base, robot=replace(base.robot, sample_time=log.sample_time,
                                       effects=specs(effects)))
