"""Print the MuJoCo chain's frequency errors, its largest stable step and its time a second."""

from __future__ import annotations

import argparse
from dataclasses import replace
import time

import mujoco
from mujoco_chain import Arm, build, simulate
import numpy as np
from scipy.linalg import eigh

FINITE_ELEMENT_FREQUENCIES = {
    # (payload kg, theta_2 rad): joint-locked natural frequencies, rad/s (cubic Hermite elements)
    (0.1, 0.0): (7.87, 25.47, 143.4, 218.8),
    (0.1, np.pi / 2): (9.45, 19.36, 142.5, 212.7),
    (0.0, 0.0): (10.15, 39.30, 166.5, 254.2),
}


def locked_frequencies(arm: Arm, theta_2: float, n_segments: int = 20,
                       count: int = 4) -> np.ndarray:
    """Return the first natural frequencies with both joints locked, rad/s."""
    chain = build(arm, n_segments)
    data = mujoco.MjData(chain.model)
    data.qpos[chain.joint[1]] = theta_2
    mujoco.mj_forward(chain.model, data)
    mass = np.zeros((chain.model.nv, chain.model.nv))
    mujoco.mj_fullM(chain.model, data, mass)
    mass = mass[np.ix_(chain.hinges, chain.hinges)]
    stiffness = np.diag(np.ravel(chain.model.jnt_stiffness[chain.hinges]))
    squared = eigh(stiffness, mass, eigvals_only=True, subset_by_index=(0, count - 1))
    return np.sqrt(squared)


def largest_stable_substeps(arm: Arm, period: float = 0.01, n_segments: int = 20) -> int:
    """Return the fewest sub-steps a sample for which 2 s of steps stay finite and bounded."""
    commands = np.tile([[0.5, -0.5]], (200, 1))
    for substeps in range(1, 200):
        try:
            simulate(arm, commands, period, None, n_segments, substeps)
            return substeps
        except FloatingPointError:
            continue
    raise FloatingPointError('no stable step found')


def main() -> None:
    """Print frequency errors, the largest stable step and the time a simulated second."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--segments', type=int, default=20)
    n = parser.parse_args().segments
    mujoco.set_mju_user_warning(lambda _: None)  # a refused step is expected: no log file for it
    for (payload, theta_2), expected in FINITE_ELEMENT_FREQUENCIES.items():
        found = locked_frequencies(replace(Arm(), payload_mass=payload), theta_2, n)
        errors = 100 * (found / np.array(expected) - 1)
        print(f'm_p {payload:.1f} kg, theta_2 {theta_2:.2f} rad:', np.round(found, 3),
              'rad/s, error', np.round(errors, 2), '%')
    substeps = largest_stable_substeps(Arm(), n_segments=n)
    commands = 0.5 * np.sin(np.outer(np.arange(1000) * 0.01, [2.0, 3.0]))
    start = time.perf_counter()
    simulate(Arm(), commands, 0.01, None, n, substeps)
    print(f'largest stable step {0.01 / substeps * 1e3:.3f} ms ({substeps} a sample): '
          f'{(time.perf_counter() - start) / 10 * 1e3:.1f} ms a simulated second')


if __name__ == '__main__':
    main()
