"""
What is unnamed: the laws of the remaining latent forces, in sentences and as advice.

It completes the diagnosis after the verdict, where something unknown is at work.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flex_plant_sim.diagnosis.prediction.friction_part import friction_part
from flex_plant_sim.diagnosis.prediction.latent_view import Finding, LatentView
from flex_plant_sim.diagnosis.prediction.law import CONSTANT
from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.diagnosis.verdict.wording import digits_text

# Verdicts under which something unknown is at work.
UNNAMED_VERDICTS = ('not_in_catalogue', 'cause_and_remainder')
# Variables of laws in words.
VARIABLE_TEXT = {'speed': 'its speed', 'angle': 'its angle', 'load': 'the load on its link',
                 'command': 'its command', 'time': 'time', 'strain': 'its own strain',
                 'strain rate': 'the rate of its strain'}
# What a force is that follows no one variable.
MANY_OR_MEMORY = (
    'Behind that are several variables, an acceleration (as of a wrong mass), or something with a '
    'memory, such as a gap, a loose mass, a compliance or a delay.')


def with_unknown(diagnosis: Diagnosis, view: LatentView) -> Diagnosis:
    """Return the diagnosis with what latent forces show, where something is unnamed."""
    if diagnosis.verdict not in UNNAMED_VERDICTS:
        return diagnosis
    sentences = sentences_of(view)
    if not sentences:
        return diagnosis
    return replace(diagnosis, sentence=' '.join([diagnosis.sentence, *sentences]),
                   advice=diagnosis.advice and _advice(view))


def sentences_of(view: LatentView) -> tuple[str, ...]:
    """Return a sentence for each force that is shown."""
    return _sentences(_shown(view))


def _shown(view: LatentView) -> tuple[Finding, ...]:
    """Return torques that exceed model errors; else gauge errors, as these mostly echo torques."""
    return view.torques if _sentences(view.torques) else view.gauges


def _sentences(findings: Sequence[Finding]) -> tuple[str, ...]:
    """Return sentences about stated laws; without one, about forces that follow no variable."""
    known = tuple(sentence(f) for f in findings if f.law.stated)
    others = tuple(sentence(f) for f in findings if f.has_memory)
    return known or (*others, MANY_OR_MEMORY) if known or others else ()


def sentence(finding: Finding) -> str:
    """Return what a latent force shows, in one sentence."""
    law, series = finding.law, finding.series
    what, scale, unit = ('torque', 1.0, 'N·m') if series.unit == 'N m' else (
        'error', 1e6, 'µm/m')
    size = f'{digits_text(scale * series.rms, 2)} {unit} rms'
    site = series.site.replace('_', ' ')
    if law.stated and law.variable == CONSTANT:
        return f'An unnamed constant {what} acts on {site} ({size}).'
    if law.stated:
        over = VARIABLE_TEXT.get(law.variable, law.variable.replace('_', ' '))
        return (f'An unnamed {what} of {site} ({size}) is a law over {over}, which explains '
                f'{100.0 * law.share:.0f} % of it on stretches left out{_as_friction(finding)}.')
    swings = f', and swings at {finding.line.frequency:.2g} Hz' if finding.line else ''
    return f'An unnamed {what} of {site} ({size}) follows no one variable{swings}.'


def _as_friction(finding: Finding) -> str:
    """Return what of a law over a joint's speed is friction; nothing for other laws."""
    if finding.law.variable != 'speed':
        return ''
    part = friction_part(finding.series)
    share = f'{100.0 * part.share:.0f} % of it'
    return f"; {part} than the extended robot's drive has would be {share}"


def _advice(view: LatentView) -> str:
    stated = [f.law for f in _shown(view) if f.law.stated]
    if not stated:
        return ('Record both joints at rest after a push: what swings or creeps on shows the '
                'coordinate that the model lacks.')
    law = stated[0]
    site, over = law.site.replace('_', ' '), VARIABLE_TEXT.get(law.variable, law.variable)
    if law.variable in ('time', CONSTANT):
        return f'Record {site} again from a cold start and an hour later: does it return?'
    if law not in [f.law for f in view.torques]:
        return f'Look at {site}, its cable and its amplifier: what they read depends on {over}.'
    return (f'Record {site} through the whole range of {over}, both ways: the table that the '
            'extended robot carries is only known where this record was.')
