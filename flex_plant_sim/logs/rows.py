"""
Turns rows as they were read into a log: gated, on an even grid, with notes on what was done.

Both formats, CSV and bag, come through here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.angle_steps import angle_steps, Slip
from flex_plant_sim.inputs.first_row import off_channel
from flex_plant_sim.inputs.gate import counted, Gate, judge_record, Limits, Refusal, TURN
from flex_plant_sim.inputs.jitter import deviations, stamp_share
from flex_plant_sim.inputs.plausible import alternates, SAMPLING_AGREES, unit_hint
from flex_plant_sim.inputs.resample import (
    even_grid,
    fill_by_hold,
    fill_by_line,
    fill_by_spline,
    Grid,
    KEPT,
    LOST,
)
from flex_plant_sim.inputs.single_errors import single_errors, SingleError
from flex_plant_sim.inputs.stale_rows import stale_note
from flex_plant_sim.logs.log import Log
from msg_config.errors import InputError
from msg_config.input_mapping import JOINTS
import numpy as np
from numpy.typing import NDArray

# Jitter, as a share of the sampling interval, from which a note is made; less may come from the
# digits of a file.
NOTED_JITTER = 0.01
# Changes of a channel after which it is no chance that all are a multiple of two or more samples
# apart: 2^-30, for each channel of a night's logs. Fewer rows tell of no channel that it is stuck.
HELD_CHANGES = 30
# By how much a gauge that does not change moves by what the others say, in standard deviations of
# their error: healthy ones of 60 records at most 4, those that stick for 0.1 s and more above 100.
MOVED = 10.0
# By what factor it is longer the same than usual, where all readings are held for some samples;
# readings that may be equal by chance at the turn of a swing: three were, on a healthy arm.
HELD, SHORTEST = 2.0, 4
# The hint on rows of one channel that are those of two sources in turn.
TWO_SOURCES = ' (do two publishers alternate? keep the rows of one)'
COMMANDS = ('command_1', 'command_2')
# Digits of a stamp: seconds since 1970 have ten before the point.
STAMP_DIGITS = 15


@dataclass(frozen=True)
class Rows:
    """
    Samples as they were recorded, in SI units, with channels in the robot's order.

    Attributes
    ----------
    source : str
        File or bag.
    time : Array
        s, (N,).
    joint, strain, command : Array
        rad, m/m, drives' own unit, (N, 2), (N, G), (N, 2).
    row : callable
        Gives the name of row k (from 0) by which a user finds it in the file.
    notes, doubts : tuple of str
        As in Log.
    slipped : Mapping of (str, str) to str
        The notes on slips by joint and row.

    """

    source: str
    time: Array
    joint: Array
    strain: Array
    command: Array
    row: Callable[[int], str]
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    slipped: Mapping[tuple[str, str], str] = field(default_factory=dict)

    def kept(self, which: Array | slice | Sequence[int]) -> Rows:
        """Return some of the rows, which keep their names."""
        numbers = np.arange(len(self.time))[which]
        return replace(self, time=self.time[which], joint=self.joint[which],
                       strain=self.strain[which], command=self.command[which],
                       row=lambda k: self.row(int(numbers[k])))

    def noted(self, note: str, doubtful: bool = False) -> Rows:
        """Return the rows with one more note."""
        return replace(self, notes=(*self.notes, note),
                       doubts=(*self.doubts, note) if doubtful else self.doubts)


def to_log(rows: Rows, robot: Robot, commands: Callable[[Grid], Array] | None = None) -> Log:
    """
    Return rows as a log on an even grid; samples that the gate refuses are treated as lost.

    Parameters
    ----------
    rows : Rows
        Rows with increasing times.
    robot : Robot
        Gives the gate, the gauges and the sampling interval.
    commands : callable, optional
        Gives the command at every place of a grid, (samples, 2), whose time is 0 at the first
        row; by default the commands are those of the rows.

    Raises
    ------
    InputError
        Too few rows, times that do not increase, or values that no arm has; names the row.

    """
    if len(rows.time) < 2:
        raise InputError(f'{rows.source}: expected at least 2 samples, got {len(rows.time)}')
    _check_time(rows)
    start = float(rows.time[0])
    rows = _pass_gate(_from_first_reading(rows, robot), robot)
    grid = even_grid(rows.time, rows.source, rows.row)
    rows = _with_gap_notes(rows, grid).kept(slice(grid.first, grid.last))
    if grid.samples < 2:
        raise InputError(f'{rows.source}: expected at least 2 samples in a row, got 1')
    rows = _with_held_note(_with_stuck_note(rows, robot), robot, grid)
    rows, taken = _with_jitter_note(rows, grid)
    shifted = replace(grid, start=grid.start - start)
    if commands is None:
        command = (fill_by_line(grid, rows.command) if taken is None
                   else fill_by_hold(grid, rows.command, taken))
    else:
        command = commands(shifted)
    log = Log(rows.source, rows.time[0] + grid.time,
              command, fill_by_spline(grid, rows.joint, taken),
              fill_by_spline(grid, rows.strain, taken),
              robot.gauge_names,
              rows.notes, rows.doubts, tuple(rows.slipped.values()),
              lost=grid.missing if grid.lost else None)
    return _with_sampling_note(_with_error_note(log, rows, grid), robot)


def _check_time(rows: Rows) -> None:
    if not np.isfinite(rows.time).all():
        k = int(np.argmin(np.isfinite(rows.time)))
        raise InputError(f'{rows.source}: {rows.row(k)}: time: expected a finite number, '
                         f'got {rows.time[k]}')
    interval = np.diff(rows.time)
    if (interval <= 0.0).any():
        k = int(np.argmax(interval <= 0.0)) + 1
        twice = int(np.sum(interval == 0.0))
        why = (f': {twice} of {len(rows.time)} rows have the time of the row before; keep one of '
               'each' if interval[k - 1] == 0.0 else ': the clock goes back; are two logs joined?')
        raise InputError(f'{rows.source}: {rows.row(k)}: time: expected more than '
                         f'{rows.time[k - 1]:.{STAMP_DIGITS}g} s, '
                         f'got {rows.time[k]:.{STAMP_DIGITS}g} s{why}')


def _from_first_reading(rows: Rows, robot: Robot) -> Rows:
    """Return the rows without the first where the next ones deny it."""
    output, limits = np.hstack([rows.joint, rows.strain]), Limits.of(robot)
    # What no arm has is no reading anywhere, and may be too large for a rate.
    output[~((output >= limits.low) & (output <= limits.high))] = np.nan
    k = off_channel(rows.time, output)
    if k is None:
        return rows
    off = f'{abs(output[0, k] - output[1, k]):.3g}'
    return rows.kept(slice(1, None)).noted(
        f'{rows.row(0)} left out: {robot.output_names[k]} is {off} {robot.output_units[k]} off '
        'the next row, which no later row is: not yet a reading?')


def _pass_gate(rows: Rows, robot: Robot) -> Rows:
    """Return the rows without those that the arm cannot have produced."""
    gate = Gate(robot)
    steps = angle_steps(rows.time, rows.joint, gate.limits, robot.sample_time)
    rows = _without_turns(rows, steps.turns)
    output = np.hstack([rows.joint, rows.strain])
    refusals = judge_record(gate, rows.time, output, rows.command,
                            {slip.row for slip in steps.slips})
    rows = _with_slip_notes(rows, [slip for slip in steps.slips if not any(
        refusals[k] for k in (slip.before, slip.row))])
    refused = [k for k, refusal in enumerate(refusals) if refusal is not None]
    if not refused:
        return rows
    wrong: list[Refusal] = [refusal for refusal in refusals if refusal is not None]
    first = wrong[0]
    where = f'{rows.row(refused[0])}: {first.text}'
    if len(refused) > LOST * len(rows.time):
        more = '' if len(refused) == 1 else f'; {len(refused)} of {len(rows.time)} samples like it'
        # An angle in degrees that starts slowly passes its limit by little at first.
        worst = max((item for item in wrong if item.channel == first.channel),
                    key=attrgetter('excess'))
        # A step between two sources is as fast as one in degrees.
        mixed = any(alternates(values) for name, values in zip(robot.output_names, output.T)
                    if name == first.channel)
        hint = TWO_SOURCES if mixed else unit_hint(worst)
        raise InputError(f'{rows.source}: {where}{hint}{more}')
    kept = rows.kept(np.setdiff1d(np.arange(len(rows.time)), refused))
    return kept.noted(f'{len(refused)} of {len(rows.time)} samples refused '
                      f'({counted(gate.refused)}), the first at {where}')


def _without_turns(rows: Rows, turns: NDArray[np.int64]) -> Rows:
    """Return the rows without these whole turns of the joints, (N, 2)."""
    for name, own in zip(JOINTS, turns.T):
        wrapped = np.flatnonzero(own)
        if wrapped.size:
            rows = rows.noted(f'{name}: {len(wrapped)} of {len(own)} rows are whole turns off, '
                              f'the first {rows.row(int(wrapped[0]))}: a wrapped angle, undone')
    return replace(rows, joint=rows.joint - TURN * turns)


def _with_slip_notes(rows: Rows, slips: Sequence[Slip]) -> Rows:
    for slip in slips:
        name, place = JOINTS[slip.joint], rows.row(slip.row)
        note = _slip_note(name, slip.step, place)
        rows = replace(rows.noted(note), slipped={**rows.slipped, (name, place): note})
    return rows


def _slip_note(name: str, step: float, place: str) -> str:
    return (f'{name} steps by {step:.3g} at {place}, against all others, and stays: did its '
            'sensor slip, or lose counts? Kept as it is')


def _with_gap_notes(rows: Rows, grid: Grid) -> Rows:
    if grid.dropped:
        kept, count = grid.last - grid.first, len(rows.time)
        few, stretch = kept < KEPT * count, f'{rows.row(grid.first)} to {rows.row(grid.last - 1)}'
        rows = rows.noted(f'a gap in time: only the longest stretch without one is read, '
                          f'{stretch}, {kept} of {count} samples'
                          + '; to diagnose it, keep its rows alone in a file' * few, few)
    if grid.lost:
        rows = rows.noted(f'{grid.lost} of {grid.samples} samples lost: interpolated by a cubic, '
                          'commands by a line')
    return rows


def _with_jitter_note(rows: Rows, grid: Grid) -> tuple[Rows, Array | None]:
    """Return the rows, with a note if stamps jitter; and where samples were taken, if not even."""
    if grid.jitter <= NOTED_JITTER * grid.interval:
        return rows, None
    every, share = f'every {1e3 * grid.interval:.6g} ms', stamp_share(grid, rows.time, rows.joint)
    jitter = f'stamps jitter by up to {1e3 * grid.jitter:.3g} ms'
    if not share.is_sure:
        return rows.noted(f'{jitter}: taken as even, {every}'), None
    part = min(share.value, 1.0)
    taken = grid.place + part * deviations(grid, rows.time)
    return rows.noted(f'{jitter}, and samples by {100.0 * part:.0f} % of that: interpolated to '
                      f'{every}'), taken


def _with_stuck_note(rows: Rows, robot: Robot) -> Rows:
    output = np.hstack([rows.joint, rows.strain])
    still = np.ptp(output, axis=0) == 0.0
    if len(rows.time) <= HELD_CHANGES:
        # In some rows an arm that is yet to move may rest.
        return rows
    if still.any() and not still.all():
        names = [name for name, stuck in zip(robot.output_names, still) if stuck]
        return rows.noted(f'{", ".join(names)}: never changes while the rest moves: stuck, or not '
                          'connected?', doubtful=True)
    for k, (name, values) in enumerate(zip(robot.gauge_names, rows.strain.T)):
        first, last = _dead_stretch(values, np.delete(rows.strain, k, axis=1))
        if first < last:
            rows = rows.noted(f'{name}: does not change from {rows.row(first)} to '
                              f'{rows.row(last)} while the others move: dead, or not connected?',
                              last - first > (1.0 - KEPT) * len(values))
    return rows


def _dead_stretch(values: Array, others: Array) -> tuple[int, int]:
    """
    Return the first and last row of the longest stretch in which a gauge is dead, or (0, 0).

    Its readings (N,) are equal there and no extreme, as of one that clips, while the other gauges,
    (N, G), say by least squares over its fresh readings that it moves by far more than they err.
    """
    starts = np.flatnonzero(np.r_[True, np.diff(values) != 0.0])
    lengths = np.diff(np.r_[starts, len(values)])
    basis = np.column_stack([others, np.ones(len(values))])
    expected = basis @ np.linalg.lstsq(basis[starts], values[starts], rcond=None)[0]
    moved = np.maximum.reduceat(expected, starts) - np.minimum.reduceat(expected, starts)
    extreme = np.isin(values[starts], [values.min(), values.max()])
    dead = (moved > MOVED * np.std((values - expected)[starts])) & ~extreme \
        & (lengths > max(HELD * np.median(lengths), SHORTEST))
    if not dead.any():
        return 0, 0
    longest = int(np.argmax(np.where(dead, lengths, 0)))
    return int(starts[longest]), int(starts[longest] + lengths[longest] - 1)


def _with_held_note(rows: Rows, robot: Robot, grid: Grid) -> Rows:
    """Return the rows with a note if measurements are held over several samples each."""
    output, held = np.hstack([rows.joint, rows.strain]), {}
    for name, values in zip(robot.output_names, output.T):
        changes = grid.place[1:][np.diff(values) != 0.0]
        every = int(np.gcd.reduce(np.diff(changes))) if len(changes) > HELD_CHANGES else 1
        if every > 1:
            held[name] = every
    if not held:
        note = stale_note(output, rows.row)
        return rows.noted(note) if note else rows
    return rows.noted(f'{", ".join(held)}: {"changes" if len(held) == 1 else "change"} only every '
                      f'{max(held.values())} samples, of '
                      f'{1e3 * grid.interval:.4g} ms: sampled slower than the log?', doubtful=True)


def _with_error_note(log: Log, rows: Rows, grid: Grid) -> Log:
    """Return the log with a note if single numbers of it contradict the others."""
    known = np.flatnonzero(np.isfinite(log.command).all(axis=1))
    if not known.size:
        return log
    start, stop = known[0], known[-1] + 1
    found = [error for error in single_errors(log.command[start:stop], log.output[start:stop])
             # Lost rows are interpolated, so they are no evidence.
             if log.lost is None or not log.lost[start + error.row]]
    values, names = np.hstack([log.command, log.output]), (*COMMANDS, *log.output_names)

    def place_of(error: SingleError) -> str:
        return rows.row(int(np.searchsorted(grid.place, start + error.row)))
    notes = [_slip_note(names[slip.column], slip.error, place_of(slip)) for slip in found
             if slip.lasting and (names[slip.column], place_of(slip)) not in rows.slipped]
    single = [error for error in found if not error.lasting]
    if single:
        error, counted = single[0], (
            'a single number contradicts' if len(single) == 1 else
            f'{len(single)} single numbers contradict')
        name, value = names[error.column], values[start + error.row, error.column]
        notes.append(
            f'{counted} the samples around, first '
            f'{place_of(error)}: {name}: {value:.6g}, where {value - error.error:.6g} would fit; '
            'kept as it is' + ('; or the arm was pushed' if name in COMMANDS else ''))
    return replace(log, notes=(*log.notes, *notes))


def _with_sampling_note(log: Log, robot: Robot) -> Log:
    own, said = log.sample_time, robot.sample_time
    if own <= 0.0:
        raise InputError(f'{log.source}: time: expected a sample about every {said:g} s, '
                         f'got every {log.time[1] - log.time[0]:.3g} s')
    if abs(own - said) <= SAMPLING_AGREES * said:
        return log
    note = f'sampled every {own:g} s, not {said:g} s as {robot.source} says; the log wins'
    return replace(log, notes=(*log.notes, note))
