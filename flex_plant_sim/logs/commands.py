"""
Finds the command that acted at each sample of a bag.

It is the command that was applied (effort of joint_states) if that is known, else the one sent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.resample import Grid
from flex_plant_sim.logs.bag_messages import Stamps, Stream
from msg_config.acting_command import effort_acted
from msg_config.input_mapping import InputMapping
from msg_config.time_stamp import NANOSECONDS
import numpy as np

# Share of the largest command up to which two commands count as equal: rounding to the nine
# digits of a file, or to a driver's single precision, may change as much.
SAME = 1e-6


@dataclass(frozen=True)
class Commands:
    """
    The commands in a bag.

    Attributes
    ----------
    until, applied : array
        Stamps, ns, and the command that acted up to each, (N,), (N, 2); empty if unknown.
    since, sent : array
        Stamps, ns, and the command sent at each, (M,), (M, 2).
    unused : str
        What keeps the effort of joint_states from being the applied command, or ''.
    notes : tuple of str
        Notes on which of the two is used.

    """

    until: Stamps
    applied: Array
    since: Stamps
    sent: Array
    unused: str = ''
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, streams: Mapping[str, Stream], mapping: InputMapping) -> Commands:
        """
        Return the commands in the effort of joint_states and on the topic command.

        Raises
        ------
        InputError
            Names and values do not match, or a joint is missing or ambiguous.

        """
        joints, command = streams['joint_states'], streams['command']
        channels = mapping.command_channels()
        sent = command.values(channels, 'effort')
        unused, applied = 'missing', np.zeros((0, 2))
        if joints.has('effort'):
            applied = joints.values(channels, 'effort')
            unused = ('' if effort_acted(applied, sent) else 'zero throughout'
                      if np.isfinite(applied).all() else 'not always finite')
        if unused:
            unused = f'effort of joint_states is {unused}'
            return cls(joints.stamps[:0], applied[:0], command.stamps, sent, unused)._with_note()
        return cls(joints.stamps, applied, command.stamps, sent)._with_note()

    def _with_note(self) -> Commands:
        if not len(self.since):
            return self
        if not len(self.until):
            return replace(self, notes=(
                f'commands: as sent on the topic command; {self.unused}',))
        last = np.searchsorted(self.since, self.until, side='left') - 1
        both = last >= 0
        differ = np.abs(self.applied[both] - self.sent[last[both]]).max(axis=1, initial=0.0) \
            > SAME * np.abs(self.sent).max(initial=0.0)
        if not differ.any():
            return self
        note = (f'commands: as applied (effort of joint_states); in {int(differ.sum())} of '
                f'{int(both.sum())} samples the topic command says otherwise')
        return replace(self, notes=(note,))

    def around(self, stamps: Stamps) -> Array:
        """Return the command that acted around each stamp, for the gate, (N, 2); 0 if unknown."""
        if len(self.until):
            return self.applied[np.searchsorted(self.until, stamps)]
        if not len(self.since):
            return np.zeros((len(stamps), 2))
        last = np.searchsorted(self.since, stamps, side='right') - 1
        return np.where((last >= 0)[:, None], self.sent[last], 0.0)

    def on(self, grid: Grid, start: int) -> Array:
        """
        Return the mean command from every place of a grid to the next, (samples, 2).

        A command that was applied up to a stamp acted since the stamp before it. If the applied
        command is not known, the command sent last before the middle of the interval is taken. If
        there is none either, the result is interpolated linearly, and NaN at the ends.

        Parameters
        ----------
        grid : Grid
            Grid of the samples.
        start : int
            Stamp of its time 0, ns.

        """
        found = self._sent_on(grid, start)
        if len(self.until):
            at = ((self.until - start) / NANOSECONDS - grid.start) / grid.interval
            share = max(round(grid.interval * NANOSECONDS / float(np.median(
                np.diff(self.until)))), 1)
            # Rounded to the finer grid of the joints, so that jitter does not shift a command.
            place = np.ceil(np.rint(at * share) / share - 1e-9).astype(np.int64) - 1
            inside = (place >= 0) & (place < grid.samples)
            count = np.bincount(place[inside], minlength=grid.samples)
            for joint in (0, 1):
                total = np.bincount(place[inside], self.applied[inside, joint], grid.samples)
                found[count > 0, joint] = (total / np.maximum(count, 1))[count > 0]
        return _interpolated(found)

    def _sent_on(self, grid: Grid, start: int) -> Array:
        found = np.full((grid.samples, 2), np.nan)
        if not len(self.since):
            return found
        at = ((self.since - start) / NANOSECONDS - grid.start) / grid.interval
        last = np.searchsorted(at, np.arange(grid.samples) + 0.5, side='right') - 1
        found[last >= 0] = self.sent[last[last >= 0]]
        return found


def _interpolated(values: Array) -> Array:
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    if not known.size:
        return values
    rows = np.arange(known[0], known[-1] + 1)
    for joint in (0, 1):
        values[rows, joint] = np.interp(rows, known, values[known, joint])
    return values
