"""
Small vibrations of the whole arm with all its elements: the check of the reduced arm.

Its own assembly: the lower beam's transverse displacement is absolute, its root follows the elbow.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from truth.beam_elements import Array
from truth.configuration import Arm


def full_frequencies(arm: Arm, theta_2: float, elements: int = 20) -> Array:
    """
    Return the natural frequencies (4 elements,) with both rotors held, rad/s.

    Only for links without rigid hubs: the lower root is the elbow itself.
    """
    upper, lower = (link.mesh(elements) for link in arm.links)
    n = upper.size
    mass, stiffness = np.zeros((n + lower.size - 2,) * 2), np.zeros((n + lower.size - 2,) * 2)
    mass[:n, :n], stiffness[:n, :n] = upper.mass(), upper.stiffness()
    tip, slope = n - 2, n - 1
    mass[tip, tip] += arm.structure.elbow_mass
    mass[slope, slope] += arm.structure.elbow_inertia
    # Along its axis the lower link and its payload are rigid.
    carried = arm.payload.mass + arm.links[1].mass_per_length * arm.links[1].length
    mass[tip, tip] += carried * np.sin(theta_2)**2
    lower_mass = lower.mass()
    end = np.array([1.0, arm.payload.beyond_tip])
    lower_mass[-2:, -2:] += arm.payload.mass * np.outer(end, end)
    lower_mass[-1, -1] += arm.payload.inertia
    follow = np.zeros((lower.size, n + lower.size - 2))
    follow[0, tip], follow[1, slope] = np.cos(theta_2), 1.0
    follow[2:, n:] = np.eye(lower.size - 2)
    mass += follow.T @ lower_mass @ follow
    stiffness += follow.T @ lower.stiffness() @ follow
    return np.sqrt(eigh(stiffness[2:, 2:], mass[2:, 2:], eigvals_only=True))
