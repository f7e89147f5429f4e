"""The arm that stands in for the real one: steps with commands, measures with noise."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm_model import Array
from flex_plant_sim.errors import InputError
from flex_plant_sim.extended_arm import ExtendedArm
from flex_plant_sim.payload_profile import PayloadProfile
import numpy as np


@dataclass(frozen=True)
class Noise:
    """
    Standard deviations of the white noise of one sample.

    Attributes
    ----------
    angle : float
        rad.
    strain : float
        m/m.
    torque : float
        Process noise: torque on each joint, held over a sample, N m.

    """

    angle: float = 0.0
    strain: float = 0.0
    torque: float = 0.0


@dataclass(frozen=True)
class Measurement:
    """
    What is sampled at one instant.

    Attributes
    ----------
    time : float
        s.
    angle, velocity : Array
        rad and rad/s, (2,).
    strain : Array
        m/m, (gauges,).
    command : Array
        At the drive before this instant, (2,).

    """

    time: float
    angle: Array
    velocity: Array
    strain: Array
    command: Array

    @property
    def output(self) -> Array:
        """Return (theta_1, theta_2, strain…), (m,)."""
        return np.concatenate([self.angle, self.strain])


class Simulator:
    """
    Steps an extended arm at its sample time, nonlinear in theta_2 and in the payload.

    The linear parts are exact for a command held over the step; theta_2 and the payload are
    those at its start.

    Parameters
    ----------
    arm : ExtendedArm
        Its step may be the sample time divided by a whole number of substeps.
    payload : PayloadProfile
    noise : Noise
    seed : int

    """

    def __init__(self, arm: ExtendedArm, payload: PayloadProfile | None = None,
                 noise: Noise = Noise(), seed: int = 0):
        self.arm, self.noise, self._seed = arm, noise, seed
        self.payload = payload or PayloadProfile.constant(arm.payload)
        ratio = arm.robot.sample_time / arm.step_time
        self.substeps = round(ratio)
        if abs(ratio - self.substeps) > 1e-9 or self.substeps < 1:
            raise InputError(f'step: expected the sample time {arm.robot.sample_time:g} s '
                             f'divided by a whole number, got {arm.step_time:g} s')
        self._memory = max([e.memory(arm.robot.sample_time) for e in arm.effects], default=0)
        self._arms: dict[float, ExtendedArm] = {}
        self.reset()

    def reset(self) -> None:
        """Go back to rest at time zero, with the same noise to come."""
        self.time, self.samples = 0.0, 0
        self.state = np.zeros(self.arm.states)
        self._applied = np.zeros(2)
        self._history = np.zeros((self._memory, 2))
        self._random = np.random.default_rng(self._seed)

    def mass(self, time: float) -> float:
        """Return the payload at a time, kg, effects included."""
        mass = self.payload.at(time)
        for effect in self.arm.effects:
            mass = effect.payload_at(time, mass)
        return mass

    def measure(self) -> Measurement:
        """Return what the sensors say now, with noise."""
        output = self.arm.output(self.state, self.time)
        velocity = self.arm.joint_velocity(self.state, self._applied)
        angle = output[:2] + self.noise.angle * self._random.standard_normal(2)
        strain = output[2:] + self.noise.strain * self._random.standard_normal(output.size - 2)
        return Measurement(self.time, angle, velocity.copy(), strain, self._applied.copy())

    def step(self, command: Array) -> None:
        """Advance one sample with a command (2,), in the drives' own unit."""
        if not np.all(np.isfinite(command)):
            raise InputError(f'command: expected finite numbers, got {command}')
        sent = np.asarray(command, dtype=float)
        applied = self._at_drive(sent)
        torque = self.noise.torque * self._random.standard_normal(2)
        for k in range(self.substeps):
            time = self.time + k * self.arm.step_time
            arm, matrices = self._arm_and_matrices(time)
            disturbance = matrices[2][:, :2] @ torque if self.noise.torque else 0.0
            self.state = arm.advance(matrices, self.state, applied, time) + disturbance
        self._applied = applied
        self._history = np.vstack([self._history, sent])[1:] if self._memory else self._history
        self.samples += 1
        self.time = self.samples * self.arm.robot.sample_time

    def _at_drive(self, command: Array) -> Array:
        limits = [drive.command_limit for drive in self.arm.robot.drives]
        applied = np.clip(command, np.negative(limits), limits)
        for effect in self.arm.effects:
            applied = effect.on_command(applied, self._history, self.time,
                                        self.arm.robot.sample_time)
        return applied

    def _arm_and_matrices(self, time: float) -> tuple[ExtendedArm, tuple[Array, Array, Array]]:
        """Interpolate a schedule while the payload stays; discretise afresh while it ramps."""
        cosine, mass = np.cos(self.state[1]), self.mass(time)
        if mass not in self._arms:
            arm = self.arm.at_payload(mass)
            if mass != self.mass(time + self.arm.step_time):
                return arm, arm.matrices(cosine, mass)
            self._arms[mass] = arm
        return self._arms[mass], self._arms[mass].schedule.at(cosine)


def simulate(simulator: Simulator, commands: Array) -> tuple[Array, Array]:
    """
    Return outputs (N, m) and joint velocities (N, 2) for commands (N, 2).

    Row k is what is sampled before command k is applied.
    """
    outputs, velocities = [], []
    for command in commands:
        sample = simulator.measure()
        outputs.append(sample.output)
        velocities.append(sample.velocity)
        simulator.step(command)
    return np.array(outputs), np.array(velocities)
