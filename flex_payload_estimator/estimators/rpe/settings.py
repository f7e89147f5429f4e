"""Choices of the recursive-prediction-error estimator beyond the robot file."""

from __future__ import annotations

from dataclasses import dataclass

from msg_config.errors import InputError


@dataclass(frozen=True)
class RpeSettings:
    """
    Choices beyond the robot file.

    Attributes
    ----------
    payload_max : float or None
        Largest payload, kg; None: four lower links and twice the robot file's payload.
    torque_noise : tuple of float
        Told process noise: torque on each joint held over a sample, N m.
    block_s : float
        A change of payload is looked for in windows of one to two times this, s.
    event_nats : float
        Log-likelihood that a change of payload must gain.
    rest_drift : float
        Random walk of the payload while nothing tells of it, kg per square root of a second.

    """

    payload_max: float | None = None
    torque_noise: tuple[float, float] = (0.0, 0.0)
    block_s: float = 0.25
    event_nats: float = 12.0
    rest_drift: float = 2e-3

    def __post_init__(self) -> None:
        """Validate."""
        positive = {'payload_max': self.payload_max, 'block_s': self.block_s,
                    'event_nats': self.event_nats}
        for name, value in positive.items():
            if value is not None and not value > 0.0:
                raise InputError(f'{name}: expected a number > 0, got {value!r}')
        if min(*self.torque_noise, self.rest_drift) < 0.0:
            raise InputError('torque_noise, rest_drift: expected numbers >= 0, '
                             f'got {self.torque_noise}, {self.rest_drift!r}')
