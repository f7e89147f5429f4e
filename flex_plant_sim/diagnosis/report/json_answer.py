"""The answer of a diagnosis as JSON, and what the gain on the locked part adds to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
import math
from types import MappingProxyType
from typing import Any

from flex_plant_sim.arm.units import CHANNEL_SHOWN
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.prediction.latent_view import LatentView
from flex_plant_sim.diagnosis.report.improvement import Gain, gain_results
from flex_plant_sim.diagnosis.report.payload_gain import PayloadGain
from flex_plant_sim.diagnosis.report.symptoms import ChannelResidual, SWING
from flex_plant_sim.diagnosis.verdict.results import Alternative, Cause, Diagnosis, ParameterValue
from flex_plant_sim.diagnosis.verdict.unknown import LOOK_AT_RESIDUALS, refuted
from flex_plant_sim.diagnosis.verdict.wording import digits_text
import numpy as np

# Said where the extended robot is no gain: at what a cause stands at, or on the whole.
WORSE_WHERE_NAMED = 'No other channel rises as much, and a cause stands at it.'
PREDICTS_WORSE = ('On the whole the extended robot predicts the locked part worse than the file: '
                  'do not use it.')


def with_gain(diagnosis: Diagnosis, gains: Sequence[Gain], unnamed: int = 0) -> Diagnosis:
    """
    Return the diagnosis with, in words, the errors that surely fall and rise most.

    What falls is told of a channel that a cause stands at, if any does; what rises also at longer
    horizons.
    """
    count = len(diagnosis.causes) + unnamed
    at_horizon = [gain for gain in gains if gain.horizon == SWING]
    smaller = [gain for gain in at_horizon if gain.ratio_high < 1.0]
    larger = [gain for gain in gains
              if gain.horizon >= SWING and gain.ratio_low > 1.0]
    sites = {cause.site for cause in diagnosis.causes}
    named = [gain for gain in smaller if gain.channel in sites] or smaller
    changes = [f'{of} {_change(gain)}' for of, gain in (
        ('of', min(named, key=lambda gain: gain.ratio, default=None)),
        ('that of' if smaller else 'of', max(larger, key=lambda gain: gain.ratio, default=None)))
        if gain is not None]
    if not count or not changes:
        return diagnosis
    what = 'laws of what has no name' if not diagnosis.causes else 'it' if count == 1 else 'them'
    text = (f'With {what} and the parts as estimated the prediction error '
            f'{", ".join(changes)}.')
    found = replace(diagnosis, sentence=f'{diagnosis.sentence} {text}')
    if predicts_worse(gains):
        return refuted(replace(found, sentence=f'{found.sentence} {PREDICTS_WORSE}'))
    if larger and max(larger, key=lambda gain: gain.ratio).channel in sites:
        return refuted(replace(found, sentence=f'{found.sentence} {WORSE_WHERE_NAMED}'))
    return found


def with_gauges_beyond(diagnosis: Diagnosis, after: Sequence[ChannelResidual]) -> Diagnosis:
    """
    Return `nothing_wrong` with the gauges that err by more than it says, over a second.

    The evidence looks one step ahead, where a filter follows what errs slowly.
    """
    if diagnosis.verdict != 'nothing_wrong':
        return diagnosis
    share = DiscrepancyModel().gauge_share
    found = {row.channel: math.sqrt(max(row.free_run[SWING]**2 - row.noise**2, 0.0))
             / row.swing for row in after
             if row.unit == 'm/m' and SWING in row.free_run and row.swing > 0.0}
    beyond = [f'{channel.replace("_", " ")} errs by {100.0 * error:.0f} %'
              for channel, error in found.items() if share < error < math.inf]
    if not beyond:
        return diagnosis
    return replace(diagnosis, sentence=f'{diagnosis.sentence} But over {SWING:g} s, '
                   f'simulated by commands alone, {", ".join(beyond)} of what it reads: something '
                   'slow that no step shows may be missing.', advice=LOOK_AT_RESIDUALS)


def predicts_worse(gains: Sequence[Gain]) -> bool:
    """Return whether the locked part is predicted worse after than before, on the whole."""
    at_horizon = [gain for gain in gains if gain.horizon == SWING]
    with np.errstate(divide='ignore'):
        return (any(gain.ratio_low > 1.0 for gain in at_horizon)
                and float(np.mean(np.log([gain.ratio for gain in at_horizon]))) > 0.0)


def _change(gain: Gain) -> str:
    scale, unit = CHANNEL_SHOWN[gain.unit]
    space = '' if unit == '°' else ' '
    channel = gain.channel.replace('_', ' ')
    if not math.isfinite(gain.after):
        return f'{channel} diverges'
    return (f'{channel} after {gain.horizon:g} s {"falls" if gain.ratio < 1.0 else "rises"} from '
            f'{digits_text(scale * gain.before, 2)}{space}{unit} to '
            f'{digits_text(scale * gain.after, 2)}{space}{unit}')


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
    return {p.name: {'value': p.value, 'low': p.low, 'high': p.high, 'unit': p.unit}
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
