"""Accepts one publisher per topic: the first, as long as it sends; others are ignored."""

from __future__ import annotations

# Least time of silence, s, after which the accepted publisher is replaced; a killed one would stay
# listed in ROS for 20 s.
SILENCE = 0.5
# Time from its replacement, s, in which a publisher counts as only held up. A busy machine holds
# one up for less than a second (flex_plant_sim.inputs.stamps.TIME_JUMP), so its replacement, too.
HELD_UP = 2.0
# Number of bytes of a gid that identify the participant, that is the publishing process (RTPS 2.3,
# 9.3.1.2).
PARTICIPANT_BYTES = 12


class FirstPublisher:
    """
    Decides for each message whether its publisher is the one accepted on its topic.

    A second publisher of a topic takes over if it belongs to the process that is accepted on
    another topic and the present one does not, since joints and strain must be of one arm. A
    publisher that was replaced for its silence is accepted again when it sends soon after: it had
    been held up by a busy machine. One that comes later is a second one like any other.

    Attributes
    ----------
    silence : float
        Time, s, after which a publisher that sent nothing is replaced.

    """

    def __init__(self) -> None:
        self.silence = SILENCE
        self._kept: dict[str, tuple[bytes, float]] = {}
        self._held_up: dict[str, tuple[bytes, float]] = {}

    def is_kept(self, topic: str, gid: bytes | None) -> bool:
        """Return whether the last message accepted on a topic was of this publisher."""
        return topic in self._kept and self._kept[topic][0] == gid

    def speaks(self, topic: str, now: float) -> bool:
        """Return whether a publisher is accepted on a topic and not silent."""
        return topic in self._kept and now - self._kept[topic][1] <= self.silence

    def hears(self, topic: str, gid: bytes | None, now: float) -> bool:
        """Return whether a message is accepted; `gid` is None if the middleware gives none."""
        if gid is None:
            return True
        kept, heard = self._kept.get(topic, (gid, now))
        if kept != gid:
            if self._was_held_up(topic, gid, now):
                del self._held_up[topic]
            elif now - heard > self.silence:
                self._held_up[topic] = kept, now
            elif not self._belongs(topic, gid, kept, now):
                return False
        self._kept[topic] = gid, now
        return True

    def _was_held_up(self, topic: str, gid: bytes, now: float) -> bool:
        held, since = self._held_up.get(topic, (None, now))
        return held == gid and now - since <= max(HELD_UP, self.silence)

    def _belongs(self, topic: str, gid: bytes, kept: bytes, now: float) -> bool:
        others = {own[:PARTICIPANT_BYTES] for name, (own, heard) in self._kept.items()
                  if name != topic and now - heard <= self.silence}
        return gid[:PARTICIPANT_BYTES] in others and kept[:PARTICIPANT_BYTES] not in others
