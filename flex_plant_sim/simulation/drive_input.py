"""
Computes the command that a drive applies from the command sent: limit first, then the effects.

The simulator, the predictors of the diagnosis and the estimator `rpe` use it.
"""

from __future__ import annotations

from typing import Any

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np


class DriveInput:
    """
    The commands applied by an arm's drives, sample by sample or for a whole record.

    The drive clips a command to its limit. Each effect then acts on the output of the effect
    before it and keeps the past of that, so that a delay delays the clipped command.

    Parameters
    ----------
    arm : ExtendedArm

    Attributes
    ----------
    past : tuple of Array
        What each effect got before, (memory, 2), the oldest first. It is replaced, not written
        to: whoever predicts in advance keeps it, and sets it where the prediction is undone.

    """

    def __init__(self, arm: ExtendedArm):
        self.limits = np.array([drive.command_limit for drive in arm.robot.drives])
        self.step = arm.robot.sample_time
        self.effects = tuple(effect for effect in arm.effects
                             if type(effect).on_command is not Effect.on_command)
        self.reset()

    def reset(self) -> None:
        """Set all past commands to zero."""
        self.past = tuple(np.zeros((effect.memory(self.step), 2)) for effect in self.effects)

    def __call__(self, command: Array, time: float) -> Array:
        """Return the commands applied, (2,), for commands (2,) sent at a time, s."""
        applied: Array = np.minimum(np.maximum(command, -self.limits), self.limits)
        kept = []
        for effect, past in zip(self.effects, self.past):
            sent, applied = applied, effect.on_command(applied, past, time, self.step)
            kept.append(np.vstack([past, sent])[1:])
        self.past = tuple(kept)
        return applied

    def of_record(self, commands: Array, time: Any) -> Array:
        """
        Return the commands applied for commands (N, 2) sent at times (N,), s; (N, 1 or B, 2).

        B is the number of parameter sets if the effects hold a batch of them.
        """
        applied = np.clip(commands, -self.limits, self.limits)[:, None, :]
        for effect in self.effects:
            memory = effect.memory(self.step)
            padded = np.concatenate([np.zeros((memory,) + applied.shape[1:]), applied])
            past = np.zeros(applied.shape[:-1] + (0, 2)) if memory == 0 else np.stack(
                [padded[k:k + len(applied)] for k in range(memory)], axis=-2)
            applied = effect.on_command(applied, past, time[:, None], self.step)
        return applied
