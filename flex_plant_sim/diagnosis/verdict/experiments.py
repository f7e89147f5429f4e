"""
The experiment that would tell look-alike causes apart, as advice.

Each family of effects dominates in one kind of record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.diagnosis.verdict.wording import apart_text
from flex_plant_sim.effects import catalogue

# Kinds of records, in words.
CREEP = 'both joints slowly through their whole range at constant speed, both ways'
PLUCK = 'free swings after a pluck of the tip, with the joints held'
WEIGH = 'the same moves with a payload that was weighed, and without one'
STATIC = 'known weights at the tip of the arm at rest'
STEPS = 'steps of the command of several sizes, from small to the limit'
BURST = 'fast reversals, ten a second and more'
WAIT = 'an hour of the same move, from cold'
# The record in which the effects of a family dominate, and the effects that need another one.
BY_FAMILY: Mapping[str, str] = {
    'joint and gear': CREEP, 'drive and timing': STEPS, 'sensors': STATIC,
    'links and structure': PLUCK, 'payload': WEIGH}
EXCEPTIONS: Mapping[str, str] = {
    **dict.fromkeys(('backlash', 'gear_compliance', 'motor_lag', 'input_delay',
                     'drive_bandwidth', 'strain_filter', 'strain_delay', 'angle_delay',
                     'hub_inertia'), BURST),
    **dict.fromkeys(('angle_gain', 'angle_offset', 'base_tilt'), CREEP),
    **dict.fromkeys(('strain_drift', 'payload_change'), WAIT)}


def experiment(names: Sequence[str]) -> str:
    """
    Return what to record to tell causes apart, in one sentence.

    Causes of one kind of record differ in size or shape there; of other causes, each record shows
    one alone.
    """
    shown_by = {name: _record_for(name) for name in names if name in catalogue()}
    kinds = dict.fromkeys(shown_by.values())
    words = apart_text(names)
    if len(kinds) == 1:
        return f'To tell {words}: record {next(iter(kinds))}.'
    shown = '; '.join(
        f'{kind} (shows {_listed([n for n, k in shown_by.items() if k == kind])})'
        for kind in kinds)
    return f'To tell {words}, record one of: {shown}.'


def with_experiment(diagnosis: Diagnosis) -> Diagnosis:
    """Return the diagnosis with the experiment for its look-alikes as advice."""
    if not diagnosis.cannot_tell:
        return diagnosis
    return replace(diagnosis, advice=experiment(diagnosis.cannot_tell[0]))


def _record_for(name: str) -> str:
    return EXCEPTIONS.get(name) or BY_FAMILY[catalogue()[name].family]


def _listed(names: Sequence[str]) -> str:
    return ' and '.join(name.replace('_', ' ') for name in names)
