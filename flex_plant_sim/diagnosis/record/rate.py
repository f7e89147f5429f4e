"""The rate at which records are looked at: that at which the model's discrepancy is calibrated."""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.diagnosis.record.windows import Record
import numpy as np

# Samples kept in a period of the slowest mode: as few as there are in the records that calibrate
# the discrepancy (of the reference robot at 100 Hz; 0.62 s without a payload, 1.07 with 0.28 kg).
SAMPLES_A_PERIOD = 62


def at_needed_rate(records: Sequence[Record], slowest: float, sample_time: float
                   ) -> tuple[list[Record], float]:
    """
    Return records with the samples that a diagnosis needs, and their sample time, s.

    What is sampled faster tells more of the sensors' noise alone: where the model is wrong, its
    errors last longer than a sample. Commands are averaged, so that none is lost.

    Parameters
    ----------
    records : sequence of Record
        Of one sample time, s.
    slowest : float
        Lowest natural frequency, rad/s.
    sample_time : float
        s.

    """
    every = max(int(2.0 * np.pi / slowest / sample_time / SAMPLES_A_PERIOD), 1)
    return [record.thinned(every) for record in records], every * sample_time
