"""
The simulator, which takes the place of the real arm: it applies commands and measures with noise.

It steps the plant of `extended_arm`; the node plant_sim and the tools drive it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
import math

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.drive_input import DriveInput
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.payload_profile import PayloadProfile
from flex_plant_sim.simulation.stepping import schedule_row, Stepper
from msg_config.errors import InputError
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
    The measurements of one instant.

    Attributes
    ----------
    time : float
        s.
    angle, velocity : Array
        rad and rad/s, (2,).
    strain : Array
        m/m, (gauges,).
    command : Array
        Commands that the drives applied before this instant, (2,).

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

    The linear part of a step is exact for a constant command; theta_2 and the payload are those
    at the start of the step.

    Parameters
    ----------
    arm : ExtendedArm
        Its step may be the sample time divided by an integer number of substeps.
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
        self._drive_input = DriveInput(arm)
        self._sensor_noise = np.array(
            [noise.angle] * 2 + [noise.strain] * (len(arm.output_matrix) - 2))
        self._angle = schedule_row(arm)
        # Built now, so that no sample has to wait for compilation.
        self._arms = {arm.payload: (arm, Stepper.of(arm))}
        self._pushes = arm.schedule.forces
        if noise.torque and not self._pushes:
            raise InputError(f'noise.torque: {arm.model_name} has no joint torques, '
                             'expected 0')
        self.reset()

    def reset(self) -> None:
        """Return to rest at time zero and restart the noise from its seed."""
        self.time, self.samples = 0.0, 0
        self.state = np.zeros(self.arm.states)
        self._applied = np.zeros(2)
        self._drive_input.reset()
        self._random = np.random.default_rng(self._seed)

    def begin_at(self, angles: Array) -> None:
        """Turn the joints to where they read angles, rad, (2,)."""
        self.state[:2] += angles - self.arm.output(self.state, self.time)[:2]

    def mass(self, time: float) -> float:
        """Return the payload at a time, kg, including effects on it."""
        mass = self.payload.at(time)
        for effect in self.arm.effects:
            mass = effect.payload_at(time, mass)
        return mass

    def measure(self) -> Measurement:
        """Return the sensor readings of the present state, with noise."""
        output = self.arm.output(self.state, self.time)
        velocity = self.arm.joint_velocity(self.state, self._applied)
        output = output + self._sensor_noise * self._random.standard_normal(output.size)
        return Measurement(self.time, output[:2], velocity.copy(), output[2:],
                           self._applied.copy())

    def draws(self, count: int) -> Array:
        """Return standard normal numbers of N samples: m outputs, then 2 torques; (N, m + 2)."""
        return self._random.standard_normal((count, len(self.arm.output_matrix) + 2))

    def step(self, command: Array) -> None:
        """
        Advance one sample with a command (2,), in the drives' own unit.

        The result is that of `advance`, whose preparation for many samples would cost more than
        one step.
        """
        command = np.asarray(command, dtype=float)
        if not all(map(math.isfinite, command.tolist())):
            check_finite(command[None])
        start = self.samples * self.arm.robot.sample_time
        self._applied, force = self._drive_input(command, start), np.zeros((1, self._pushes))
        draws = self._random.standard_normal(2)
        if self.noise.torque:
            force[0, :2] = self.noise.torque * draws
        for k in range(self.substeps):
            self._substep(start + self.arm.step_time * k, self._applied[None], force)
        self.samples += 1
        self.time = self.samples * self.arm.robot.sample_time

    def _substep(self, time: float, command: Array, force: Array) -> None:
        mass = self.mass(time)
        arm, stepper = self._arm_with_payload(mass, mass != self.mass(time + self.arm.step_time))
        run = stepper.run if stepper else partial(self._run_in_python, arm, np.array([time]))
        self.state = run(self.state, command, force)[1]

    def advance(self, commands: Array, draws: Array) -> tuple[Array, Array]:
        """
        Advance many samples; return the states (N, n) and the commands applied before, (N, 2).

        Parameters
        ----------
        commands : Array
            In the drives' own unit, (N, 2).
        draws : Array
            Standard normal numbers of the process noise, (N, 2).

        """
        count = len(commands)
        applied = self._commands_applied(commands)
        starts = (self.samples + np.arange(count))[:, None] * self.arm.robot.sample_time
        forces = np.zeros((count, self._pushes))
        if self.noise.torque:
            forces[:, :2] = self.noise.torque * draws
        times: Array = (starts + self.arm.step_time * np.arange(self.substeps)).ravel()
        states = self._run_by_payload(times, np.repeat(applied, self.substeps, axis=0),
                                      np.repeat(forces, self.substeps, axis=0))
        self.samples += count
        self.time = self.samples * self.arm.robot.sample_time
        self.state = states[-1].copy()
        before = np.vstack([self._applied, applied[:-1]])
        self._applied = applied[-1]
        return states[:-1:self.substeps], before

    def _commands_applied(self, commands: Array) -> Array:
        if not self._drive_input.effects:
            return self._drive_input(commands, 0.0)
        step = self.arm.robot.sample_time
        return np.array([self._drive_input(sent, (self.samples + k) * step)
                         for k, sent in enumerate(commands)]).reshape(-1, 2)

    def _run_by_payload(self, times: Array, commands: Array, forces: Array) -> Array:
        """Return the states before each step and after the last, one run for each payload."""
        masses = np.array([self.mass(time) for time in (*times, times[-1] + self.arm.step_time)])
        states, start = [self.state[None]], 0
        while start < len(times):
            stop = start + 1
            while stop < len(times) and masses[stop] == masses[start]:
                stop += 1
            rows = slice(start, stop)
            ramps = masses[start] != masses[start + 1]
            arm, stepper = self._arm_with_payload(masses[start], ramps)
            run = stepper.run if stepper else partial(self._run_in_python, arm, times[rows])
            states.append(run(states[-1][-1], commands[rows], forces[rows])[1:])
            start = stop
        return np.concatenate(states)

    def _arm_with_payload(self, mass: float, ramps: bool) -> tuple[ExtendedArm, Stepper | None]:
        """
        Return the arm with a payload, kg, and its compiled steps if it has any.

        A constant payload gets a schedule, which is kept. A payload that ramps is used for one
        step only, so its matrices are discretised exactly without one.
        """
        if mass not in self._arms:
            arm = self.arm.at_payload(mass)
            if ramps:
                return arm, None
            self._arms[mass] = arm, Stepper.of(arm)
        return self._arms[mass]

    def _run_in_python(self, arm: ExtendedArm, times: Array, start: Array, commands: Array,
                       forces: Array) -> Array:
        """Return the states before each step and after the last, with all effects evaluated."""
        states = [start]
        for time, command, force in zip(times, commands, forces):
            cosine = float(np.cos(self._angle @ states[-1]))
            scheduled = arm.payload in self._arms
            matrices = (arm.schedule.at(cosine) if scheduled
                        else arm.matrices(cosine, arm.payload))
            after = arm.advance(matrices, states[-1], command, time)
            states.append(after + matrices[2] @ force)
        return np.array(states)


def check_finite(commands: Array) -> None:
    """Raise InputError if any of the commands (N, 2) is not finite."""
    if not np.all(np.isfinite(commands)):
        k = int(np.argmin(np.isfinite(commands).all(axis=1)))
        raise InputError(f'command: expected finite numbers, got {commands[k]}')


def simulate(simulator: Simulator, commands: Array) -> tuple[Array, Array]:
    """
    Return outputs (N, m) and joint velocities (N, 2) for commands (N, 2).

    Row k is sampled before command k is applied.
    """
    commands = np.asarray(commands, dtype=float)
    check_finite(commands)
    arm, noise = simulator.arm, simulator.noise
    times = (simulator.samples + np.arange(len(commands))) * arm.robot.sample_time
    draws = simulator.draws(len(commands))
    states, applied = simulator.advance(commands, draws[:, -2:])
    outputs = arm.output(states, times)
    outputs[:, :2] += noise.angle * draws[:, :2]
    outputs[:, 2:] += noise.strain * draws[:, 2:-2]
    return outputs, np.array(arm.joint_velocity(states, applied))
