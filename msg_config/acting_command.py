"""
Decides which command acted: effort of joint_states, or what was sent on the topic command.

Nodes and bag reader share it, so that an arm is weighed live as it is from its bag.
"""

from __future__ import annotations

from msg_config.errors import InputError
from msg_config.input_mapping import Array, JOINTS
import numpy as np

# Effort of a message that has none.
NO_EFFORT = np.full(2, np.nan)
# What a command is taken from.
APPLIED = 'effort of joint_states'
NONE_TOLD = 'topic command, as effort of joint_states is missing or NaN'
ZERO_TOLD = 'topic command, as effort of joint_states is zero so far'


def effort_acted(effort: Array, sent: Array) -> bool:
    """
    Return whether effort is the command that acted, rather than the one sent.

    It is not where it is not finite, or zero throughout while other commands were sent: some
    drivers fill the field with zeros or NaN.

    Parameters
    ----------
    effort, sent : Array
        Effort of joint_states and commands sent, in the drives' own unit, (…, 2) each.

    """
    return bool(np.isfinite(effort).all() and (effort.any() or not sent.any()))


class ActingCommand:
    """
    The command that acted up to each sample, by what has come so far.

    Effort of zero is believed until another command was sent before the sample, and effort for
    good from the first on that is not zero.

    Attributes
    ----------
    sent : Array or None
        The last command sent, (2,); None if there is none yet.
    source : str
        What the last command was taken from: APPLIED, NONE_TOLD or ZERO_TOLD.

    """

    def __init__(self) -> None:
        self._told, self._asked, self.source = np.zeros(2), np.zeros(2), APPLIED
        self.forget()

    def forget(self, sent: Array | None = None) -> None:
        """Forget all commands but `sent`, (2,); what the driver fills in stays known."""
        self.sent = self._before = sent
        self._stamp = -1

    def send(self, stamp: int, command: Array) -> None:
        """Take a command that was sent, (2,), with the stamp of the sample it answers, ns."""
        if stamp != self._stamp:
            self._before = self.sent
        self._stamp, self.sent = stamp, command

    def until(self, stamp: int, effort: Array) -> Array:
        """
        Return the command that acted up to a sample, in the drives' own unit, (2,).

        Parameters
        ----------
        stamp : int
            Of the sample, ns; the command that answers it acts later.
        effort : Array
            That of its joint_states, (2,); all NaN where there is none. One that is not finite
            in part is returned as it is, to be refused.

        Raises
        ------
        InputError
            There is no effort, and no command was sent.

        """
        sent = self._before if stamp == self._stamp and self._before is not None else self.sent
        known, finite = not np.isnan(effort).all(), np.isfinite(effort).all()
        if finite and not self._told.any():
            self._told = effort
        if sent is not None and not self._asked.any():
            self._asked = sent
        if known and (sent is None or not finite or effort_acted(self._told, self._asked)):
            self.source = APPLIED if finite else self.source
            return effort
        if sent is None:
            raise InputError(f'joint_states: effort: expected {len(JOINTS)} numbers, got none, '
                             'and no command came on topic command yet')
        self.source = ZERO_TOLD if known else NONE_TOLD
        return sent
