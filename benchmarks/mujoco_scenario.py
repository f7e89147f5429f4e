"""What decides a MuJoCo record: the arm, the way of the commands and the way of the readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import mujoco
from mujoco_chain import Arm, Hook
import numpy as np
from scipy.signal import cont2discrete, lfilter

Event = Callable[[mujoco.MjModel], Hook]


@dataclass(frozen=True)
class Drive:
    """Way of a command (2,) in rad/s to the velocity loop; pairs are (joint 1, joint 2)."""

    gain: tuple[float, float] = (1.0, 1.0)
    bias: tuple[float, float] = (0.0, 0.0)
    dead_zone: tuple[float, float] = (0.0, 0.0)
    saturation: tuple[float, float] = (np.inf, np.inf)
    lag: tuple[float, float] = (0.0, 0.0)
    delay: float = 0.0

    def shape(self, command: np.ndarray) -> np.ndarray:
        """Return the command after dead zone, limit, gain and bias."""
        half = np.asarray(self.dead_zone)
        opened = np.sign(command) * np.maximum(np.abs(command) - half, 0.0)
        limited = np.clip(opened, -np.asarray(self.saturation), self.saturation)
        return np.asarray(self.gain) * limited + np.asarray(self.bias)


@dataclass(frozen=True)
class Sensors:
    """Way of the true angles (2,) and strains (4,) to what the log shows."""

    angle_gain: tuple[float, float] = (1.0, 1.0)
    angle_offset: tuple[float, float] = (0.0, 0.0)
    strain_mix: np.ndarray = field(default_factory=lambda: np.eye(4))
    strain_bias: np.ndarray = field(default_factory=lambda: np.zeros(4))
    strain_drift: np.ndarray = field(default_factory=lambda: np.zeros(4))
    strain_delay: float = 0.0
    filter_frequency: float | None = None
    filter_damping: float = 0.8


@dataclass(frozen=True)
class Scenario:
    """Everything that decides a record but the noise and the set-points."""

    arm: Arm
    told: float
    drive: Drive = field(default_factory=Drive)
    sensors: Sensors = field(default_factory=Sensors)
    event: Event | None = None
    truth: dict[str, Any] = field(default_factory=dict)
    site: str = ''


def logged_strain(fine: np.ndarray, sensors: Sensors, timestep: float,
                  period: float) -> np.ndarray:
    """Return (N, 4) strains as the amplifier gives them, from those at every sub-step."""
    if sensors.filter_frequency is not None:
        omega = sensors.filter_frequency
        top, bottom = [omega**2], [1, 2 * sensors.filter_damping * omega, omega**2]
        numerator, denominator, _ = cont2discrete((top, bottom), timestep)
        fine = lfilter(numerator.ravel(), denominator, fine, axis=0)
    stride, late = round(period / timestep), round(sensors.strain_delay / timestep)
    fine = np.vstack([np.zeros((late, 4)), fine])[:len(fine)]
    strain = fine[::stride] @ sensors.strain_mix.T
    time = np.arange(len(strain))[:, None] * period
    return strain + sensors.strain_bias + sensors.strain_drift * time
