"""
What the locked part says of a diagnosis: gains in words, and causes that it refutes.

No fit has seen that part. `complete` asks here, after the errors on it are measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

from flex_plant_sim.arm.units import CHANNEL_SHOWN
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.verdict.improvement import Gain
from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.diagnosis.verdict.symptoms import ChannelResidual, SWING
from flex_plant_sim.diagnosis.verdict.unknown import (
    LOOK_AT_RESIDUALS,
    refuted,
    UNNAMED_VERDICTS,
)
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


def with_gauges_beyond(diagnosis: Diagnosis, after: Sequence[ChannelResidual],
                       gains: Sequence[Gain]) -> Diagnosis:
    """
    Return a verdict without anything unnamed with the gauges that err by more than that allows.

    Over a second: the evidence looks one step ahead, where a filter follows what errs slowly. It
    has to be more at the low end of the error's interval, too. (Of 23 right answers to the logs of
    a foreign simulator one had such a gauge, of 15 wrong ones 6; without the interval 4 and 5.)
    """
    if diagnosis.verdict in (*UNNAMED_VERDICTS, 'data_cannot_answer'):
        return diagnosis
    share, rows = DiscrepancyModel().gauge_share, {row.channel: row for row in after}
    beyond = [f'{gain.channel.replace("_", " ")} errs by '
              f'{100.0 * _error_share(gain.after, rows[gain.channel]):.0f} %'
              for gain in gains if gain.horizon == SWING and gain.unit == 'm/m'
              and share < _error_share(gain.low, rows[gain.channel]) < math.inf]
    if not beyond:
        return diagnosis
    return replace(diagnosis, sentence=f'{diagnosis.sentence} But over {SWING:g} s, '
                   f'simulated by commands alone, {", ".join(beyond)} of what it reads: something '
                   'that no single step shows may be wrong.',
                   advice=diagnosis.advice or LOOK_AT_RESIDUALS)


def _error_share(error: float, row: ChannelResidual) -> float:
    """Return what of an error is beyond the sensor's noise, as a share of what it reads."""
    beyond = math.sqrt(max(error**2 - row.noise**2, 0.0))
    return beyond / row.swing if row.swing > 0.0 else 0.0


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
