"""What the extended model gains for the payload estimate, where the true payload is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.report.extended_file import specs
from flex_plant_sim.logs.log import Log

# What the estimator estimates must not be told to it.
ESTIMATED = ('payload_mass', 'payload_change')


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


def payload_gain(logs: Sequence[Log], true: float, nominal: Base,
                 extended: Base) -> tuple[PayloadGain, ...]:
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

    """
    name = _default_estimator()
    found = []
    for log in logs:
        before, after = (_estimate(log, base, name) for base in (nominal, extended))
        found.append(PayloadGain(log.source, name, true, *before, *after))
    return tuple(found)


def _default_estimator() -> str:
    from msg_config.parameters import load_parameters
    return str(load_parameters()['payload_estimator']['estimator'].default)


def _estimate(log: Log, base: Base, name: str) -> tuple[float, float]:
    # The estimators build on this package, so they are imported where they are used.
    from flex_payload_estimator.estimators.factory import make_estimator
    from flex_payload_estimator.tools.estimate import estimate
    effects = [effect for effect in base.effects if effect.identifier not in ESTIMATED]
    robot = replace(base.robot, sample_time=log.sample_time, effects=specs(effects))
    return estimate(log, make_estimator(name, robot, base.model, base.modes)).row(-1)
