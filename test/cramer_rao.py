"""
The Cramer-Rao bound of the payload: the accuracy that no unbiased estimator can beat.

The arm is linearised along the true trajectory over state and payload, by central differences of
the sampled arm. With process noise the bound is the posterior one (Tichavsky, Muravchik and
Nehorai, IEEE Trans. Signal Process. 46, 1998), which for a linearised model is the Riccati
recursion of the augmented state (x, m).
"""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np
from numpy.typing import ArrayLike

# Steps of the central differences over the payload, kg, and over cos theta_2. Their truncation
# error goes with the square of the step, 1e-10; rounding divided by the step is 1e-11.
PAYLOAD_STEP = COSINE_STEP = 1e-5


@dataclass(frozen=True)
class Linearised:
    """
    The arm linearised along a trajectory: x+ = J x + j m + E torque and y = C x.

    Attributes
    ----------
    jacobian : Array
        J, (N, n, n).
    slope : Array
        j = d x+/dm at a known state, (N, n).
    push : Array
        E, the effect of a torque on each joint, (N, n, 2).
    output : Array
        C, (m, n).

    """

    jacobian: Array
    slope: Array
    push: Array
    output: Array


def linearise(arm: ExtendedArm, states: Array, commands: Array) -> Linearised:
    """
    Return the arm linearised along a trajectory.

    Parameters
    ----------
    arm : ExtendedArm
        At the true payload, without effects.
    states : Array
        States before each step, (N, n).
    commands : Array
        Commands held over each step, (N, 2).

    """
    assert not arm.effects
    cosine, sine = np.cos(states[:, 1]), np.sin(states[:, 1])
    f, _, e = arm.schedule.at(cosine)
    # Beyond |cos theta_2| = 1 the schedule would have to extrapolate.
    low = np.maximum(cosine - COSINE_STEP, -1.0)
    high = np.minimum(cosine + COSINE_STEP, 1.0)
    over_cosine = (_next_states(arm, high, states, commands)
                   - _next_states(arm, low, states, commands)) / (high - low)[:, None]
    jacobian = f.copy()
    jacobian[:, :, 1] -= sine[:, None] * over_cosine
    mass, step = arm.payload, min(PAYLOAD_STEP, 0.5 * arm.payload or PAYLOAD_STEP)
    below = max(mass - step, 0.0)
    slope = (_next_states(arm.at_payload(mass + step), cosine, states, commands)
             - _next_states(arm.at_payload(below), cosine, states, commands)) \
        / (mass + step - below)
    push = e @ arm.form.force if e.shape[-1] else np.zeros((len(states), arm.states, 2))
    return Linearised(jacobian, slope, push, arm.output_matrix)


def _next_states(arm: ExtendedArm, cosine: Array, states: Array, commands: Array) -> Array:
    """Return the states one sample later, (N, n), with the matrices at given cos theta_2."""
    f, g, _ = arm.schedule.at(cosine)
    return (f @ states[..., None] + g @ commands[..., None])[..., 0]


def payload_bound(model: Linearised, noise: ArrayLike, start: ArrayLike,
                  torque: ArrayLike = (0.0, 0.0), prior: float = np.inf) -> Array:
    """
    Return the smallest standard deviation of the payload, kg, after samples 0 to N, (N + 1,).

    Parameters
    ----------
    model : Linearised
        The arm linearised along the true trajectory.
    noise : ArrayLike
        Standard deviation of each channel, rad and m/m, (m,).
    start : ArrayLike
        Standard deviation of each state at sample 0, (n,); 0 where it is known.
    torque : ArrayLike
        Standard deviation of the process noise, a torque on each joint held over a sample,
        N m, (2,).
    prior : float
        Standard deviation of the payload's prior, kg; infinity where nothing is known.

    """
    n = model.jacobian.shape[-1]
    output = model.output / np.asarray(noise, dtype=float)[:, None]
    cov, sens = np.diag(np.square(np.asarray(start, dtype=float))), np.zeros(n)
    information = 0.0 if np.isinf(prior) else prior**-2
    unit, bound = np.eye(len(output)), []
    for k in range(len(model.jacobian) + 1):
        if k:
            jacobian, push = model.jacobian[k - 1], model.push[k - 1] * np.asarray(torque)
            cov = jacobian @ cov @ jacobian.T + push @ push.T
            sens = jacobian @ sens + model.slope[k - 1]
        inverse = np.linalg.inv(output @ cov @ output.T + unit)
        gain, seen = cov @ output.T @ inverse, output @ sens
        # Information on m in the innovations, whose covariance is S (block elimination).
        information += seen @ inverse @ seen
        sens = sens - gain @ seen
        keep = np.eye(n) - gain @ output
        cov = keep @ cov @ keep.T + gain @ gain.T
        bound.append(information**-0.5 if information > 0.0 else np.inf)
    return np.array(bound)
