"""The answer of a diagnosis as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
import math
from types import MappingProxyType
from typing import Any

from flex_plant_sim.diagnosis.prediction.latent_view import LatentView
from flex_plant_sim.diagnosis.report.payload_gain import PayloadGain
from flex_plant_sim.diagnosis.verdict.improvement import Gain, gain_results
from flex_plant_sim.diagnosis.verdict.results import Alternative, Cause, Diagnosis, ParameterValue
from flex_plant_sim.diagnosis.verdict.symptoms import ChannelResidual
import numpy as np


def answer(diagnosis: Diagnosis, gains: Sequence[Gain], before: Sequence[ChannelResidual],
           after: Sequence[ChannelResidual], payload: Sequence[PayloadGain],
           settings: Mapping[str, Any],
           latent: Mapping[str, LatentView] = MappingProxyType({})) -> dict[str, Any]:
    """
    Return the answer for JSON.

    The keys `verdict`, `causes`, `cannot_tell`, `detection_limits`, `gain`, `payload` and `latent`
    are an interface for programs and do not change. Numbers that are not finite are null.
    """
    rows = [row.results() for row in payload]
    found = {
        'verdict': diagnosis.verdict, 'sentence': diagnosis.sentence,
        'hints': [{'file': hint.file, 'text': hint.text} for hint in diagnosis.hints],
        'causes': [_cause(cause) for cause in diagnosis.causes],
        'cannot_tell': [list(names) for names in diagnosis.cannot_tell],
        'detection_limits': {label: asdict(limit)
                             for label, limit in diagnosis.detection_limits.items()},
        'not_excited': list(diagnosis.not_excited),
        'gain': gain_results(gains),
        'payload': {**(rows[0] if len(rows) == 1 else {}), 'logs': rows} if rows else None,
        'advice': diagnosis.advice, 'remainder': diagnosis.remainder,
        'residual': {'before': {row.channel: row.results() for row in before},
                     'after': {row.channel: row.results() for row in after}},
        'parts': {part.name: {'unit': part.unit, 'prior_sd': part.prior, 'mean': part.mean,
                              'sd': part.deviation} for part in diagnosis.parts},
        'sets': [{'causes': list(labels), 'probability': p} for labels, p in diagnosis.sets],
        'probabilities': diagnosis.effects,
        'candidates': [[_candidate(item) for item in ranking] for ranking in diagnosis.rounds],
        'latent': {stage: view.results() for stage, view in latent.items()},
        'settings': settings}
    cleaned: dict[str, Any] = plain(found)
    return cleaned


def _cause(cause: Cause) -> dict[str, Any]:
    return {'name': cause.name, 'site': cause.site, 'probability': cause.probability,
            'sentence': cause.sentence, 'parameters': _parameters(cause.parameters),
            'look_alikes': list(cause.look_alikes)}


def _parameters(parameters: Sequence[ParameterValue]) -> dict[str, Any]:
    return {p.name: {'value': p.value, 'low': p.low, 'high': p.high, 'unit': p.unit,
                     **({'choices': dict(p.choices)} if p.choices else {})}
            for p in parameters}


def _candidate(item: Alternative) -> dict[str, Any]:
    return {'name': item.name, 'site': item.site, 'gain_nats': item.gain,
            'probability': item.probability, 'parameters': _parameters(item.parameters)}


def plain(value: Any) -> Any:
    """Return a value in types of JSON: no arrays or numpy numbers; null where not finite."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
