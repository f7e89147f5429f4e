"""Says where sensors vary much more, from sample to sample, than the robot file tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.record.sensor_noise import DIFFERENCES, white_noise
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.diagnosis.verdict.wording import digits_text
from flex_plant_sim.inputs.plausible import NOTED_FACTOR
import numpy as np

# Share by which rows in which two sensors jump the same way outnumber the others, from which on
# half of their variance is one thing's: (2 / pi) arcsin 0.5^0.5. Gauges of an arm that chatters on
# a gap have 0.64 to 0.69, those of 48 other records 0.33 at most.
ALIKE = 0.5
OWN = ('Sensors are noisier than the robot file says ({}): hum, a loose cable, samples too slow '
       'for the arm, or a file to be corrected.')
SHARED = ('Sensors vary from sample to sample by more than the noise in the robot file, and alike '
          '({}): the arm shakes, as on a gap, samples are too slow for it, or hum reaches them '
          'all.')


def with_noise(diagnosis: Diagnosis, records: Sequence[Record], robot: Robot) -> Diagnosis:
    """
    Return the diagnosis with the sensors that are noisier than told, in words.

    A diagnosis takes the noise from the record, so that hum hides what is smaller than it. Noise
    is each sensor's own; what an arm shakes by, all gauges see.
    """
    gauges = len(robot.gauge_names)
    told = np.repeat([robot.angle_noise, robot.strain_noise], [2, gauges])
    noise = np.array([white_noise(record.measured) for record in records])
    found, alike = np.max(noise, axis=0), np.any([jump_alike(r.measured) for r in records], axis=0)
    names: dict[str, list[str]] = {OWN: [], SHARED: []}
    for k, name in enumerate(robot.output_names):
        if found[k] > NOTED_FACTOR * told[k] > 0.0:
            names[SHARED if alike[k] else OWN].append(
                f'{name.replace("_", " ")} {digits_text(found[k] / told[k], 2)} times')
    said = [text.format(', '.join(of)) for text, of in names.items() if of]
    if not said:
        return diagnosis
    return replace(diagnosis, sentence=' '.join(
        [diagnosis.sentence, *said, 'What is smaller is hidden.']))


def jump_alike(measured: Array) -> Array:
    """Return which channels (N, m) jump as another one does, half of their variance, (m,)."""
    signs = np.sign(np.diff(measured, DIFFERENCES, axis=0))
    signs = signs[np.isfinite(signs).all(axis=1)]
    same = np.abs(signs.T @ signs) / max(len(signs), 1)
    np.fill_diagonal(same, 0.0)
    return np.asarray(np.max(same, axis=1) > ALIKE)
