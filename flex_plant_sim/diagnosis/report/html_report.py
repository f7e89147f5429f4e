"""The report: one self-contained HTML file, for a phone, a desktop screen or paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
import math
from pathlib import Path
from typing import Any

from flex_plant_sim.arm.units import CHANNEL_SHOWN
from flex_plant_sim.atomic_file import made_folder, whole_file
from flex_plant_sim.diagnosis.report.figures import Picture
from flex_plant_sim.diagnosis.report.latent_pictures import LatentSection
from flex_plant_sim.diagnosis.report.payload_gain import PayloadGain
from flex_plant_sim.diagnosis.report.posterior_pictures import (
    moved,
    parts_picture,
    sets_picture,
)
from flex_plant_sim.diagnosis.verdict.improvement import Gain
from flex_plant_sim.diagnosis.verdict.results import Alternative, Cause, Diagnosis, Verdict
from flex_plant_sim.diagnosis.verdict.symptoms import ChannelResidual
from flex_plant_sim.diagnosis.verdict.wording import (
    digits_text,
    interval_text,
    key_text,
    name_text,
    parameter_text,
    part_text,
    percent_text,
    size_text,
)
from msg_config.errors import InputError

FILE_NAME = 'report.html'
VERDICT_TEXT: Mapping[Verdict, str] = {
    'nothing_wrong': 'nothing wrong', 'cause': 'cause found',
    'cannot_tell': 'cannot tell which', 'not_in_catalogue': 'not in the catalogue',
    'cause_and_remainder': 'cause found, something is left',
    'data_cannot_answer': 'the data cannot answer'}
# Number of candidates that are listed: a screen of them, as of the answer's sets (verdict.py).
RANKED = 12


@dataclass(frozen=True)
class Report:
    """
    The contents of the report.

    Attributes
    ----------
    diagnosis : Diagnosis
    before, after : tuple of ChannelResidual
        Residuals of the nominal and of the extended model.
    gains : tuple of Gain
    payload : tuple of PayloadGain
    settings : Mapping
        Robot, model, logs, seed, version.
    pictures : Mapping
        Pictures by section: traces, gains, speed and spectrum.
    latent : tuple of LatentSection
        Latent forces of the nominal model, joints first.
    unnamed : tuple of LatentSection
        Latent forces that remain beside the causes.

    """

    diagnosis: Diagnosis
    before: tuple[ChannelResidual, ...]
    after: tuple[ChannelResidual, ...]
    gains: tuple[Gain, ...]
    payload: tuple[PayloadGain, ...] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    pictures: Mapping[str, Sequence[Picture]] = field(default_factory=dict)
    latent: tuple[LatentSection, ...] = ()
    unnamed: tuple[LatentSection, ...] = ()


def render(report: Report) -> str:
    """
    Return the report as HTML.

    Raises
    ------
    InputError
        jinja2 is not installed.

    """
    try:
        from jinja2 import Environment, StrictUndefined
    except ImportError:
        raise InputError('report: expected jinja2 to be installed (pip install '
                         "'flex_payload[report]')") from None
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True,
                              lstrip_blocks=True)
    environment.filters |= {'percent': percent_text, 'interval': interval_text,
                            'site': _site_text, 'nats': _nats}
    template = (resources.files('flex_plant_sim') / 'diagnosis' / 'report' / FILE_NAME).read_text(
        encoding='utf-8')
    return environment.from_string(template).render(
        report=report, diagnosis=report.diagnosis, verdict=_verdict(report.diagnosis),
        causes=[_cause(cause) for cause in report.diagnosis.causes],
        errors=_error_rows(report.gains), channels=_channel_rows(report),
        rounds=[_ranking(candidates) for candidates in report.diagnosis.rounds],
        posterior=_posterior(report.diagnosis),
        parts=[part_text(part) for part in moved(report.diagnosis.parts)],
        limits=_limits(report.diagnosis), remainder=_remainder(report.diagnosis))


def _verdict(diagnosis: Diagnosis) -> str:
    """Return the verdict in a few words; a cause less likely than none counts as not found."""
    doubtful = all(cause.probability < 0.5 for cause in diagnosis.causes)
    if diagnosis.verdict == 'cause_and_remainder' and doubtful:
        return 'more likely something that is not in the catalogue'
    return VERDICT_TEXT[diagnosis.verdict]


def _posterior(diagnosis: Diagnosis) -> list[Picture]:
    """Return the pictures of the posterior, if the search has one."""
    return [*([sets_picture(diagnosis.sets)] if diagnosis.sets else []),
            *([parts_picture(diagnosis.parts)] if diagnosis.parts else [])]


def write_report(folder: str | Path, report: Report) -> Path:
    """
    Write report.html into a folder, which is created if needed; return its path.

    Raises
    ------
    InputError
        Nothing can be written there.

    """
    text = render(report)
    with made_folder(Path(folder)) as place, whole_file(place / FILE_NAME) as temporary:
        temporary.write_text(text, encoding='utf-8')
    return Path(folder) / FILE_NAME


def _site_text(label: str) -> str:
    """Return a label identifier:site in words."""
    name, _, site = label.partition(':')
    return name_text(name, site)


def _cause(cause: Cause) -> dict[str, Any]:
    parameters = [(key_text(p.name, p.unit), interval_text(p)) for p in cause.parameters]
    return {'title': name_text(cause.name, cause.site), 'sentence': cause.sentence,
            'probability': cause.probability, 'parameters': parameters,
            'look_alikes': [_site_text(name) for name in cause.look_alikes]}


def _error_rows(gains: Sequence[Gain]) -> list[dict[str, Any]]:
    """Return one row for each channel and horizon, in the units of the figures."""
    rows, order = [], list(dict.fromkeys(gain.channel for gain in gains))
    for gain in sorted(gains, key=lambda g: order.index(g.channel)):
        scale, unit = CHANNEL_SHOWN[gain.unit]
        finite = all(math.isfinite(value) for value in (gain.before, gain.after, gain.high))
        rows.append({
            'channel': gain.channel.replace('_', ' '), 'horizon': f'{gain.horizon:g} s',
            'before': _number(scale * gain.before), 'after': _number(scale * gain.after),
            'interval': f'{_number(scale * gain.low)} to {_number(scale * gain.high)}',
            'ratio': (f'{digits_text(1.0 / gain.ratio, 3)} ×'
                      if finite and gain.ratio > 0.0 else '–'),
            'unit': unit})
    return rows


def _nats(value: float) -> str:
    return f'{value:.0f}' if abs(value) >= 100.0 else f'{value:.3g}'


def _number(value: float) -> str:
    return digits_text(value, 3) if math.isfinite(value) else 'diverges'


def _channel_rows(report: Report) -> list[dict[str, Any]]:
    rows = []
    for before, after in zip(report.before, report.after):
        scale, unit = CHANNEL_SHOWN[before.unit]
        rows.append({
            'name': before.channel.replace('_', ' '), 'unit': unit,
            'noise': _number(scale * before.noise),
            'free_run': [(f'{h:g} s', _number(scale * e)) for h, e in before.free_run.items()],
            'before': before, 'after': after,
            'shapes': [(shape, share, after.drifted.get(shape, 0.0))
                       for shape, share in before.drifted.items()],
            'bands': [(f'{digits_text(low, 2)} to {digits_text(high, 2)} Hz', share, white)
                      for low, high, share, white in before.bands]})
    return rows


def _ranking(candidates: Sequence[Alternative]) -> list[dict[str, Any]]:
    """Return the best candidates of a round, with the lengths of their bars in percent."""
    best = sorted(candidates, key=lambda c: -c.gain)[:RANKED]
    largest = max((c.gain for c in best), default=0.0)
    return [{'title': name_text(c.name, c.site), 'gain': c.gain,
             'probability': c.probability,
             'sizes': ', '.join(map(parameter_text, c.parameters)),
             'width': 100.0 * max(c.gain, 0.0) / largest if largest > 0.0 else 0.0}
            for c in best]


def _limits(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    return [(_site_text(label), size_text(limit.value, limit.unit))
            for label, limit in sorted(diagnosis.detection_limits.items())]


def _remainder(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    return [(str(key).replace('_', ' '), _plain(value))
            for key, value in diagnosis.remainder.items()]


def _plain(value: object) -> str:
    """Return a value of the remainder as text: numbers rounded, mappings as pairs."""
    if isinstance(value, Mapping):
        return ', '.join(f'{str(k).replace("_", " ")} {_plain(v)}' for k, v in value.items())
    if isinstance(value, float):
        return f'{value:.3g}'
    if isinstance(value, (list, tuple)):
        return ', '.join(_plain(item) for item in value)
    return str(value)
