"""Readings that are older than the motion: the Padé approximant of a delay, as added states."""

from __future__ import annotations

from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.mechanics.extra_states import with_states
import numpy as np
from numpy.typing import NDArray

# Delay, s, below which there is none: a hundredth of a sample at 1 kHz.
NO_DELAY = 1e-5
# A delay closer than this to the next whole number of samples counts as whole, in samples.
WHOLE = 1e-6


def whole_samples(delay: float, sample_time: float) -> tuple[int, float]:
    """Return a delay, s, as whole samples and the rest, s."""
    whole = int(delay / sample_time + WHOLE)
    return whole, max(delay - whole * sample_time, 0.0)


def with_delayed_outputs(plant: StateSpace, rows: NDArray[np.intp], delay: float) -> StateSpace:
    """
    Return the plant with some outputs delayed by the Padé approximant (2, 3).

    exp(-s) = (60 - 24 s + 3 s^2) / (60 + 36 s + 9 s^2 + s^3) with s tau for s. Like a delay, and
    unlike the approximant (2, 2), it has no direct response. Its phase is correct to 1 % up to
    omega tau = 2.

    Parameters
    ----------
    plant : StateSpace
        The plant; three states an output are added at its end, the output reads the first of them.
    rows : NDArray
        Numbers of the outputs, (g,).
    delay : float
        tau, s; none below NO_DELAY.

    """
    if delay < NO_DELAY:
        return plant
    old, count = plant.a.shape[-1], len(rows)
    wider, unit = with_states(plant, 3 * count), np.eye(count)
    first, second, third = (slice(old + k * count, old + (k + 1) * count) for k in range(3))
    wider.a[..., first, second] = wider.a[..., second, third] = unit / delay
    for row, back, ahead in ((first, 9.0, 3.0), (second, 36.0, -24.0), (third, 60.0, 60.0)):
        wider.a[..., row, first] = -back / delay * unit
        wider.a[..., row, :old] = ahead / delay * plant.c[..., rows, :]
    wider.c[..., rows, :] = 0.0
    wider.c[..., rows, first] = unit
    return wider
