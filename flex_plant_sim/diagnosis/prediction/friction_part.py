"""How much of a latent torque of a joint dry friction and damping would be, by least squares."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.diagnosis.prediction.law import LatentSeries
import numpy as np


@dataclass(frozen=True)
class FrictionPart:
    """
    Friction -level sign(v) - damping v of a joint, and its share of a latent torque.

    Attributes
    ----------
    level : float
        Dry friction, N m; negative where the model has too much.
    damping : float
        N m s/rad; negative where the model has too much.
    share : float
        Share of the torque's power that both explain.

    """

    level: float
    damping: float
    share: float

    def __str__(self) -> str:
        """Return the friction in words, against that of the model."""
        level, damping = (f'{abs(value):.2g} {unit} {"more" if value > 0.0 else "less"} {what}'
                          for value, unit, what in ((self.level, 'N·m', 'dry friction'),
                                                    (self.damping, 'N·m·s/rad', 'damping')))
        return f'{level} and {damping}'


def friction_part(series: LatentSeries) -> FrictionPart:
    """Return the friction that is most like a latent torque of a joint while the joint moves."""
    speed = series.variables['speed'][1][series.scored]
    torque = series.value[series.scored]
    columns = -np.stack([np.sign(speed), speed], axis=1)
    size, *_ = np.linalg.lstsq(columns, torque, rcond=None)
    left = torque - columns @ size
    return FrictionPart(float(size[0]), float(size[1]),
                        1.0 - float(left @ left) / float(torque @ torque))
