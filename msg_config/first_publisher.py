"""One publisher a topic: the first is kept while it speaks, others are not heard."""

from __future__ import annotations

# A kept publisher that is silent for so long, s, gives way: killed, it stays listed for 20 s.
SILENCE = 0.5
# Of a gid, the bytes that name the participant (RTPS 2.3, 9.3.1.2): the process that publishes.
PARTICIPANT = 12


class FirstPublisher:
    """
    Decides for each message whether its publisher is the one that is heard on its topic.

    Where a second publisher of a topic belongs to the process that is heard on another topic,
    and the kept one does not, it takes over: joints and strain must be of one arm. One that gave
    way because it was silent comes first again when it speaks: a busy machine had held it up.
    """

    def __init__(self) -> None:
        self._kept: dict[str, tuple[bytes, float]] = {}
        self._held_up: dict[str, bytes] = {}

    def hears(self, topic: str, gid: bytes | None, now: float) -> bool:
        """Return whether a message is taken; `gid` is None where the middleware tells none."""
        if gid is None:
            return True
        kept, heard = self._kept.get(topic, (gid, now))
        if kept != gid:
            if gid == self._held_up.get(topic):
                del self._held_up[topic]
            elif now - heard > SILENCE:
                self._held_up[topic] = kept
            elif not self._belongs(topic, gid, kept, now):
                return False
        self._kept[topic] = gid, now
        return True

    def _belongs(self, topic: str, gid: bytes, kept: bytes, now: float) -> bool:
        others = {own[:PARTICIPANT] for name, (own, heard) in self._kept.items()
                  if name != topic and now - heard <= SILENCE}
        return gid[:PARTICIPANT] in others and kept[:PARTICIPANT] not in others
