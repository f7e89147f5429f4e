"""What was said of the logs when they were read, as part of the answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flex_plant_sim.diagnosis.verdict.results import Diagnosis, Hint
from flex_plant_sim.logs.log import Log


def with_hints(diagnosis: Diagnosis, logs: Sequence[Log]) -> Diagnosis:
    """
    Return the diagnosis with all that was said of its logs.

    It begins with channels that look exchanged, inverted or in another unit: the rest of it is
    then of another arm.
    """
    hints = tuple(Hint(log.source, note) for log in logs for note in log.notes)
    misread = [note for log in logs for note in log.misread]
    sentence = diagnosis.sentence
    if misread:
        more = len(misread) - 1
        others = f'; {more} more like it' if more else ''
        sentence = (f'The log may not be what it was read as ({misread[0]}{others}), and what '
                    f'follows depends on it. {sentence}')
    return replace(diagnosis, sentence=sentence, hints=hints)
