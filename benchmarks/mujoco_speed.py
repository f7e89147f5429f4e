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


def stepped_frequencies(arm: Arm, theta_2: float, timestep: float, n_segments: int = 20,
                        count: int = 4) -> np.ndarray:
    """
    Return the first frequencies of the stepped motion, joints held by huge inertias, rad/s.

    They are |log(lambda)|/timestep of the one-step transition matrix: what the integrator makes
    of the modes, where `locked_frequencies` is what the model has.
    """
    held = replace(arm, rotor_inertia=(1e7, 1e7), time_constant=(1.0, 1.0))
    model = build(held, n_segments, timestep).model
    data = mujoco.MjData(model)
    data.qpos[model.joint('joint_2').qposadr[0]] = theta_2
    transition = np.zeros((2 * model.nv, 2 * model.nv))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, transition, None, None, None)
    poles = np.log(np.linalg.eigvals(transition).astype(complex)) / timestep
    return np.sort(np.abs(poles[poles.imag > 1.0]))[:count]


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


def _duration(commands: np.ndarray, n_segments: int, substeps: int) -> float:
    """Return the processor time of one simulation, s: one thread, so load does not count."""
    start = time.process_time()
    simulate(Arm(), commands, 0.01, None, n_segments, substeps)
    return time.process_time() - start


def main() -> None:
    """Print frequency errors, the largest stable step and the time a simulated second."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--segments', type=int, default=20)
    n = parser.parse_args().segments
    mujoco.set_mju_user_warning(lambda _: None)  # a refused step is expected: no log file for it
    substeps = largest_stable_substeps(Arm(), n_segments=n)
    for (payload, theta_2), expected in FINITE_ELEMENT_FREQUENCIES.items():
        arm = replace(Arm(), payload_mass=payload)
        print(f'm_p {payload:.1f} kg, theta_2 {theta_2:.2f} rad')
        for name, found in (('model', locked_frequencies(arm, theta_2, n)),
                            ('stepped', stepped_frequencies(arm, theta_2, 0.01 / substeps, n))):
            errors = 100 * (found / np.array(expected) - 1)
            print(f'  {name:8}', np.round(found, 3), 'rad/s, error', np.round(errors, 2), '%')
    commands = 0.5 * np.sin(np.outer(np.arange(1000) * 0.01, [2.0, 3.0]))
    seconds = min(_duration(commands, n, substeps) for _ in range(5))
    print(f'largest stable step {0.01 / substeps * 1e3:.3f} ms ({substeps} a sample): '
          f'{seconds / 10 * 1e3:.1f} ms of processor time a simulated second, best of 5')


if __name__ == '__main__':
    main()
