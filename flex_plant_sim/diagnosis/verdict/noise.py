"""Says where a sensor is much noisier than the robot file tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.diagnosis.record.sensor_noise import white_noise
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.diagnosis.verdict.wording import digits_text
import numpy as np

# Factor on the told standard deviation from which it is said. Healthy sensors of shared records
# have up to 1.1, 1.2 and 2.2 at 100, 50 and 25 Hz, as differences of slow samples hold motion.
NOTED_FACTOR = 3.0


def with_noise(diagnosis: Diagnosis, records: Sequence[Record], robot: Robot) -> Diagnosis:
    """
    Return the diagnosis with the sensors that are noisier than told, in words.

    A diagnosis takes the noise from the record, so that hum hides what is smaller than it.
    """
    gauges = len(robot.gauge_names)
    told = np.repeat([robot.angle_noise, robot.strain_noise], [2, gauges])
    found = np.max([white_noise(record.measured) for record in records], axis=0)
    texts = [f'{name.replace("_", " ")} {digits_text(found[k] / told[k], 2)} times'
             for k, name in enumerate(robot.output_names)
             if found[k] > NOTED_FACTOR * told[k] > 0.0]
    if not texts:
        return diagnosis
    return replace(diagnosis, sentence=(
        f'{diagnosis.sentence} Sensors are noisier than the robot file says ({", ".join(texts)}): '
        'hum, a loose cable, samples too slow for the arm, or a file to be corrected. What is '
        'smaller is hidden.'))
