"""Run the chain in closed loop from set-points, or from commands."""

from __future__ import annotations

from dataclasses import dataclass, field
import math

import mujoco
import numpy as np

from truth.beam_elements import Array
from truth.configuration import Arm
from truth.mujoco.chain import build, Chain
from truth.mujoco.drives import Surroundings
from truth.simulation import Motion

# Strain from which a simulation counts as unstable, m/m.
BROKEN_STRAIN = 0.02
# Sub-steps of at most 0.5 ms and ten a sample: on the reference arm half as many are unstable.
LONGEST_STEP, FEWEST_STEPS = 5e-4, 10


@dataclass
class Loop:
    """The sampled position controller with what it read and sent."""

    arm: Arm
    reference: Array
    command: Array | None
    noise: Array
    sent: list[Array] = field(default_factory=list)
    read: list[Array] = field(default_factory=list)

    def sample(self, k: int, angle: Array) -> None:
        """Read the joint angles, rad, and send the next command."""
        sensors, step = self.arm.sensors, np.array(self.arm.sensors.angle_step)
        reading = (np.array(sensors.angle_gain) * angle + np.array(sensors.angle_offset)
                   + self.noise[k])
        reading = np.where(step > 0.0, step * np.round(reading / np.where(step > 0.0, step, 1.0)),
                           reading)
        self.read.append(reading)
        wish = np.array(self.arm.position_gain) * (self.reference[k] - reading)
        limit = np.array(self.arm.command_limit)
        self.sent.append(np.clip(wish, -limit, limit) if self.command is None
                         else self.command[k])

    def at(self, time: float) -> Array:
        """Return the command that reaches the drives at a time, s."""
        late = np.isin((0, 1), self.arm.late_drives) * self.arm.input_delay
        rows = np.floor((time - late) / self.arm.sample_time + 1e-6).astype(int)
        return np.array([self.sent[k][j] if k >= 0 else 0.0 for j, k in enumerate(rows)])


def simulate(arm: Arm, reference: Array | None = None, command: Array | None = None,
             noise: Array | None = None, steps: int | None = None) -> Motion:
    """
    Simulate `arm` for N samples, from `reference` (N, 2) rad or from `command` (N, 2).

    `noise` (N, 2) rad is added to the joint readings; `steps` replaces the sub-steps a sample,
    which are otherwise up to four times as many where fewer are unstable.
    """
    given = reference if command is None else command
    if given is None:
        raise ValueError('simulate: expected a reference or a command')
    least = max(FEWEST_STEPS, math.ceil(arm.sample_time / LONGEST_STEP - 1e-9))
    tried = [steps] if steps else [least, 2 * least, 4 * least]
    for count in tried:
        chain = build(arm, arm.sample_time / count)
        loop = Loop(arm, given, command, np.zeros_like(given) if noise is None else noise)
        try:
            strain = _run(arm, chain, loop, len(given), count)
        except FloatingPointError:
            if count == tried[-1]:
                raise
            continue
        break
    return Motion(np.array(loop.sent), np.array(loop.read), strain,
                  np.zeros((len(given), 2, 0)), count)


def _run(arm: Arm, chain: Chain, loop: Loop, samples: int, steps: int) -> Array:
    """Return the strains at every step, (N S, gauges)."""
    data, surroundings = mujoco.MjData(chain.model), Surroundings(arm, chain)
    step = arm.sample_time / steps
    strain = np.empty((samples * steps, len(chain.strain_map)))
    for k in range(samples):
        loop.sample(k, surroundings.angles(data))
        for i in range(k * steps, (k + 1) * steps):
            strain[i] = chain.strain_map @ data.qpos[chain.hinges]
            try:
                surroundings.act(data, loop.at(i * step), i * step, step)
            except (OverflowError, ValueError) as error:
                raise FloatingPointError(f'unstable at {i * step:.2f} s') from error
            mujoco.mj_step(chain.model, data)
        if not np.abs(strain[k * steps]).max() < BROKEN_STRAIN:
            raise FloatingPointError(f'unstable at {k * arm.sample_time:.2f} s')
    return strain
