"""
The improvement by the extended model: prediction errors before and after.

They are measured on the locked part of the records, which the diagnosis has not used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.pool import all_of
from flex_plant_sim.diagnosis.prediction.free_run import (
    horizon_errors,
    HORIZONS,
    start_spacing,
)
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.interval import CREDIBLE_LEVEL
from flex_plant_sim.tiny import TINY
from msg_config.errors import InputError
import numpy as np

# Number of bootstrap replicates: 2.5 ± 0.5 % are then outside each bound of a 95 % interval.
REPLICATES = 1000
# Percentiles that bound a credible interval.
PERCENTILES = (50.0 - 50.0 * CREDIBLE_LEVEL, 50.0 + 50.0 * CREDIBLE_LEVEL)
# Blocks are at least as long as the horizon, but at most so long that this many remain.
MIN_BLOCKS = 5


@dataclass(frozen=True)
class Gain:
    """
    Errors of one channel at one horizon, before and after the extension.

    Attributes
    ----------
    channel, unit : str
    horizon : float
        Time since the last measurement used, s; one sample time means one-step prediction.
    before, after : float
        Root mean square, over the start instants, of the error at the end of the horizon.
    low, high : float
        95 % bootstrap interval of `after`.
    ratio_low, ratio_high : float
        95 % bootstrap interval of after / before, from the same replicates (pairs are kept).
    starts : int
        Number of start instants.

    """

    channel: str
    unit: str
    horizon: float
    before: float
    after: float
    low: float
    high: float
    ratio_low: float
    ratio_high: float
    starts: int

    @property
    def ratio(self) -> float:
        """Return after / before."""
        return self.after / self.before if self.before > 0.0 else 1.0


def measure_gain(nominal: Sequence[Predictor], extended: Sequence[Predictor],
                 seed: int = 0, jobs: int = 1) -> tuple[Gain, ...]:
    """
    Return the errors before and after for each channel, one step ahead and at each of HORIZONS.

    Horizons longer than every record are left out.

    The bootstrap resamples moving blocks of start instants, circularly within each record and
    jointly for both models (Künsch, Annals of Statistics 17 (1989)).

    Parameters
    ----------
    nominal, extended : sequence of Predictor
        One for each record, over the locked windows of the same records.
    seed : int
        Seed of the bootstrap.
    jobs : int
        Number of processes.

    Raises
    ------
    InputError
        There is no record, or the records of the models differ.

    """
    if not nominal or len(nominal) != len(extended):
        raise InputError(f'records: expected the same number before and after, at least one, '
                         f'got {len(nominal)} and {len(extended)}')
    models = [*nominal] if extended is nominal else [*nominal, *extended]
    found = all_of(lambda p: horizon_errors(p, HORIZONS), models, jobs)
    before, after = found[:len(nominal)], found[-len(nominal):]
    robot = nominal[0].base.robot
    step, channels = robot.sample_time, [*zip(robot.output_names, robot.output_units)]
    spacing = [start_spacing(p) * step for p in nominal]
    rng, gains = np.random.default_rng(seed), []
    for horizon in (step, *HORIZONS):
        kept = [k for k, found in enumerate(before) if horizon in found]
        if not kept:
            continue
        pairs = [np.stack([before[k][horizon], after[k][horizon]]) for k in kept]
        blocks = [max(1, round(horizon / spacing[k])) for k in kept]
        gains += _gains(channels, horizon, pairs, blocks, rng)
    return tuple(gains)


def _gains(channels: Sequence[tuple[str, str]], horizon: float, pairs: Sequence[Array],
           blocks: Sequence[int], rng: np.random.Generator) -> list[Gain]:
    with np.errstate(over='ignore', invalid='ignore'):
        squares = [pair**2 for pair in pairs]
        count = sum(square.shape[1] for square in squares)
        rms = np.sqrt(sum(square.sum(axis=1) for square in squares) / count)
        replicates = np.sqrt(sum(
            _resampled_sums(square, block, rng) for square, block in zip(squares, blocks)) / count)
        after = np.percentile(replicates[:, 1], PERCENTILES, axis=0)
        ratio = np.percentile(replicates[:, 1] / np.maximum(replicates[:, 0], TINY),
                              PERCENTILES, axis=0)
    return [Gain(name, unit, horizon, float(rms[0, k]), float(rms[1, k]),
                 float(after[0, k]), float(after[1, k]), float(ratio[0, k]), float(ratio[1, k]),
                 count) for k, (name, unit) in enumerate(channels)]


def _resampled_sums(squares: Array, block: int, rng: np.random.Generator) -> Array:
    """Return sums over resampled circular blocks of squares (2, S, m), scaled to S: (R, 2, m)."""
    count = squares.shape[1]
    length = max(1, min(block, count // MIN_BLOCKS))
    rounds = -(-count // length)
    wrapped = np.concatenate([squares, squares[:, :length]], axis=1)
    sums = np.cumsum(np.pad(wrapped, ((0, 0), (1, 0), (0, 0))), axis=1)
    per_block = sums[:, length:length + count] - sums[:, :count]
    drawn = rng.integers(0, count, (REPLICATES, rounds))
    return per_block[:, drawn].sum(axis=2).transpose(1, 0, 2) * count / (rounds * length)


def gain_results(gains: Sequence[Gain]) -> Mapping[str, Mapping[str, Any]]:
    """
    Return the gains for JSON: by channel, a list over the horizons for each figure.

    `low` and `high` bound `after` (95 %), and `ratio_low` and `ratio_high` bound after / before.
    Figures of a simulation that diverged are NaN, null in the file.
    """
    results: dict[str, dict[str, Any]] = {}
    for gain in gains:
        row = results.setdefault(gain.channel, {
            'unit': gain.unit, 'horizon_s': [], 'before': [], 'after': [], 'low': [],
            'high': [], 'ratio_low': [], 'ratio_high': [], 'starts': []})
        row['horizon_s'].append(gain.horizon)
        row['starts'].append(gain.starts)
        for key in ('before', 'after', 'low', 'high', 'ratio_low', 'ratio_high'):
            row[key].append(getattr(gain, key))
    return results
