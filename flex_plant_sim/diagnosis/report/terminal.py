"""The answer of a diagnosis as text for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.arm.units import CHANNEL_SHOWN
from flex_plant_sim.diagnosis.causes.search_state import MIN_RELATIVE_PROBABILITY
from flex_plant_sim.diagnosis.likelihood.prior import imitation_odds
from flex_plant_sim.diagnosis.report.payload_gain import PayloadGain
from flex_plant_sim.diagnosis.verdict.improvement import Gain
from flex_plant_sim.diagnosis.verdict.results import Alternative, Cause, Diagnosis
from flex_plant_sim.diagnosis.verdict.symptoms import SHOWN_HORIZONS
from flex_plant_sim.diagnosis.verdict.wording import (
    beyond_tolerance,
    digits_text,
    label_text,
    name_text,
    parameter_text,
    part_text,
    percent_text,
    set_text,
    size_text,
)

# Limits that are shown where nothing is wrong: what is asked of most arms. The report has all.
LIMITS = ('payload_mass:arm', 'coulomb_friction:joint_1', 'coulomb_friction:joint_2')
# The largest probability of a name.
CEILING = 1.0 / (1.0 + imitation_odds(0))


def answer_text(diagnosis: Diagnosis, gains: Sequence[Gain],
                payload: Sequence[PayloadGain]) -> str:
    """Return the text for the terminal: sentence, causes, parts, errors before and after."""
    lines = [diagnosis.sentence, *([diagnosis.advice] if diagnosis.advice else []), '']
    for k, cause in enumerate(diagnosis.causes):
        lines += _cause_lines(cause, [rival for place in diagnosis.rounds[k:k + 1]
                                      for rival in place])
    lines += [*_nothing_lines(diagnosis), *_part_lines(diagnosis), *_note_lines(diagnosis),
              *_limit_lines(diagnosis)]
    lines += ['', *_gain_lines(gains)]
    if diagnosis.moves_parts_alone and any(gain.before != gain.after for gain in gains):
        lines.append('  -> is with the parts as estimated: no cause is added')
    lines += _worse_lines(gains)
    return '\n'.join([*lines, *(_payload_line(row) for row in payload)])


def _cause_lines(cause: Cause, rivals: Sequence[Alternative]) -> list[str]:
    """Return a cause with its sizes, and what the record cannot tell from it with theirs."""
    lines = [_named_line(f'  {name_text(cause.name, cause.site)}', cause)]
    if cause.look_alikes:
        names = ', '.join(name.replace('_', ' ') for name in cause.look_alikes)
        lines.append(f'      this record cannot tell it from {names}')
    for name in cause.look_alikes:
        lines += [_named_line(f'    or {name_text(name, rival.site)}', rival)
                  for rival in rivals if rival.name == name][:1]
    return lines


def _named_line(start: str, named: Cause | Alternative) -> str:
    sizes = ', '.join(map(parameter_text, named.parameters))
    return f'{start:<34}{percent_text(named.probability):>7}   {sizes}'


def _nothing_lines(diagnosis: Diagnosis) -> list[str]:
    """Return how probable it is that nothing is wrong, where that is said, and what may be."""
    if diagnosis.verdict != 'nothing_wrong' or not diagnosis.sets:
        return []
    least, starts = MIN_RELATIVE_PROBABILITY * diagnosis.sets[0][1], ('    or ', '  ')
    return [f'{starts[not labels] + set_text(labels):<34}{percent_text(p):>7}'
            for labels, p in diagnosis.sets if p > least]


def _part_lines(diagnosis: Diagnosis) -> list[str]:
    """Return the parts beyond their tolerance that the sentence does not say."""
    texts = [part_text(part) for part in beyond_tolerance(diagnosis.parts)]
    new = [text for text in texts if text not in diagnosis.sentence]
    return [f'  parts beyond their tolerance: {"; ".join(new)}'] if new else []


def _note_lines(diagnosis: Diagnosis) -> list[str]:
    """Return what intervals and probabilities mean, where some are shown."""
    notes = []
    if diagnosis.causes or beyond_tolerance(diagnosis.parts):
        notes.append('± and ranges are 95 % intervals')
    if any(percent_text(cause.probability) == percent_text(CEILING)
           for cause in diagnosis.causes):
        notes.append(f'no name is stated above {percent_text(CEILING)}, as faults that the '
                     'catalogue lacks look like those it has')
    return [f'  ({"; ".join(notes)})'] if notes else []


def _limit_lines(diagnosis: Diagnosis) -> list[str]:
    """Return some detection limits where nothing is wrong."""
    limits = diagnosis.detection_limits
    shown = [f'{label_text(label)} {size_text(limits[label].value, limits[label].unit)}'
             for label in LIMITS if label in limits]
    if diagnosis.verdict != 'nothing_wrong' or not shown:
        return []
    return [f'  detection limits: {"; ".join(shown)}; --report and --json have all']


def _gain_lines(gains: Sequence[Gain]) -> list[str]:
    """Return the lines of a table of the rms errors, before -> after, on the locked part."""
    table = {(gain.channel, gain.horizon): gain for gain in gains}
    horizons = [h for h in dict.fromkeys(gain.horizon for gain in gains)
                if h in SHOWN_HORIZONS]
    lines = ['  error on the locked part ' + ''.join(f'{f"after {h:g} s":>21}' for h in horizons)]
    for channel in dict.fromkeys(gain.channel for gain in gains):
        cells = []
        for horizon in horizons:
            gain = table[channel, horizon]
            scale, unit = CHANNEL_SHOWN[gain.unit]
            cells.append(f'{digits_text(scale * gain.before, 3)} -> '
                         f'{digits_text(scale * gain.after, 3)}')
        lines.append(f'  {f"{channel}, {unit}":<25}' + ''.join(f'{cell:>21}' for cell in cells))
    return lines if horizons else []


def _worse_lines(gains: Sequence[Gain]) -> list[str]:
    """Return which channels the extended robot predicts worse at all horizons, beyond chance."""
    shown = [gain for gain in gains if gain.horizon in SHOWN_HORIZONS]
    kept = {gain.channel for gain in shown if gain.ratio_low <= 1.0}
    worse = [name for name in dict.fromkeys(gain.channel for gain in shown) if name not in kept]
    return [f'  {", ".join(worse)}: the robot file as it is predicts better'] if worse else []


def _payload_line(row: PayloadGain) -> str:
    return (f'  payload {row.true:.4g} kg, {row.estimator}: {row.before:.4g} kg '
            f'({row.before_percent:+.1f} %) -> {row.after:.4g} kg ({row.after_percent:+.1f} %)')
