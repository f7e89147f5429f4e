"""
Dry friction in a prediction: it acts at the estimate, and its variance is process noise.

Friction takes the torque z that would stop a joint within a step, limited to its level. Where z is
known no better than to the distance of a limit, the torque taken says nothing of whether the joint
sticks: P gets the variance of the limited z, normal as the state is. Neither P nor s shrinks in a
joint that sticks, so that the measurement can tell that it does not.
"""

from __future__ import annotations

import math

from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Motion
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# A spread this small a share of the limits' distance is rounding.
ROUNDING = 1e-12


def clipped_variance(mean: float, std: float, low: float, high: float) -> float:
    """
    Return the variance of min(max(z, low), high) of a normal number z.

    Parameters
    ----------
    mean, std, low, high : float
        Of z, and the limits, in one unit.

    """
    if std <= ROUNDING * (high - low):
        return 0.0
    places = (low - mean) / std, (high - mean) / std
    below, within = (0.5 * (1.0 + math.erf(place / math.sqrt(2.0))) for place in places)
    at_low, at_high = (math.exp(-0.5 * place * place) / math.sqrt(2.0 * math.pi)
                       for place in places)
    inside = within - below
    expected = low * below + high * (1.0 - within) + mean * inside - std * (at_high - at_low)
    # About the mean, so that no digits are lost where it hardly varies.
    a, b, away = low - expected, high - expected, mean - expected
    return max(a * a * below + b * b * (1.0 - within) + (away * away + std * std) * inside
               - std * ((b + away) * at_high - (a + away) * at_low), 0.0)


def _stopping(arm: ExtendedArm, force: Array) -> tuple[Array, Array]:
    """Return dz/d(free state), N m, (2, n), and d(state)/d(torque taken), (n, 2)."""
    order, step = arm.form.order, arm.step_time
    columns, reach = arm.friction_columns(force)
    rows, columns = np.zeros((2, len(columns))), -columns
    for joint, bend in enumerate(arm.bends):
        rows[joint, order + joint] = step
        if bend >= 0:
            # The presliding deflection follows the torque alone.
            rows[joint, bend], columns[[bend, order + bend]] = 1.0, 0.0
            columns[bend, joint] = arm.yielding()[joint]
    return rows / (arm.yielding() + step * reach)[:, None], columns


def brake(f: Filter, arm: ExtendedArm, force: Array, before: Array, motion: Motion) -> None:
    """
    Let dry friction act on a filter that was predicted without; x and P change in place.

    Parameters
    ----------
    f : Filter
        Predicted.
    arm : ExtendedArm
        With the filter's payload.
    force : Array
        d(state after the step)/d(force), (n, N).
    before : Array
        State before the step, (n,).
    motion : Motion
        At the start of the step.

    """
    rows, columns = _stopping(arm, force)
    free, through = f.state, rows @ f.sensitivity
    stds = np.sqrt(np.maximum(((rows @ f.cov) * rows).sum(1)
                              + ((through @ f.beta_cov) * through).sum(1), 0.0))
    forward, backward = arm.friction_limits(motion)
    variance = np.array([clipped_variance(*one) for one in zip(
        (rows @ free).tolist(), stds.tolist(), (-backward).tolist(), forward.tolist())])
    f.x += arm.apply_friction(force, before, free, motion) - free
    f.cov += (columns * variance) @ columns.T
