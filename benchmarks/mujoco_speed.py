"""
Compare the simulator with a MuJoCo chain of the same arm: speed and accuracy, in one run.

Both run open loop from the same commands, each on one thread. The truth is the finite-element
arm of `test/truth`; the chain is its other simulator, without what acts within a sample. MuJoCo
takes the largest step at which its chain is stable. Its time leaves out building the model, ours
leaves out building the schedule, which is printed beside it. Errors are 100 |e| / |y - mean y| in
per cent.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
import time

import _truths  # noqa: F401
from finite_elements import natural_frequencies
from flex_plant_sim.arm.robot import EffectSpec
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.effects import build as build_effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate as step_arm
from flex_plant_sim.simulation.simulator import Simulator
import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from truth.configuration import reference_arm
from truth.mujoco.chain import build, Chain
from truth.mujoco.simulation import BROKEN_STRAIN
from truth.simulation import simulate as move

Array = NDArray[np.float64]
# Payload, kg; sampling interval, s; samples; modes per link; segments per link of the chain.
PAYLOAD, PERIOD, COUNT, MODES, SEGMENTS = 0.1, 0.01, 1000, 5, 20
CORIOLIS = EffectSpec('coriolis_centripetal', 'arm', {'share': 1.0})
BENT = EffectSpec('foreshortening', 'arm', {'share': 1.0})
FORCES = {'linear': (), 'Coriolis': (CORIOLIS,), 'foreshortening': (CORIOLIS, BENT)}
# Where natural frequencies are compared: (payload, kg, theta_2, rad).
POINTS = ((0.1, 0.0), (0.1, np.pi / 2), (0.0, 0.0))


@dataclass(frozen=True)
class Contender:
    """A simulator of the arm: name, ms to build, and outputs (N, 6) from commands (N, 2)."""

    name: str
    building: float
    outputs: Callable[[Array], Array]


def true_outputs(commands: Array) -> Array:
    """Return the outputs of the finite elements, (N, 6)."""
    motion = move(reference_arm(PAYLOAD), command=commands)
    return np.hstack([motion.joint, motion.fine_strain[::motion.steps_per_sample]])


def true_frequencies(payload: float, angle: float) -> Array:
    """Return the first natural frequencies of the finite elements, joints locked, rad/s."""
    return np.asarray(natural_frequencies(load_robot('reference'), angle, payload)[:4])


def run(chain: Chain, commands: Array, substeps: int) -> Array:
    """
    Return the chain's outputs (N, 6) from rest.

    Raises
    ------
    FloatingPointError
        The step is too long.

    """
    data, joints = mujoco.MjData(chain.model), list(chain.joint)
    gains = np.array([joint.torque_gain for joint in reference_arm(PAYLOAD).joints])
    found = np.empty((len(commands), 2 + len(chain.strain_map)))
    for k, command in enumerate(commands):
        found[k, :2] = data.qpos[joints]
        found[k, 2:] = chain.strain_map @ data.qpos[chain.hinges]
        if not np.abs(found[k, 2:]).max() < BROKEN_STRAIN:
            raise FloatingPointError(f'unstable at {k * PERIOD:.2f} s: take more sub-steps')
        data.qfrc_applied[joints] = gains * command
        mujoco.mj_step(chain.model, data, substeps)
    return found


def chain_frequencies(payload: float, theta_2: float) -> Array:
    """Return the chain's first natural frequencies with both joints locked, rad/s."""
    chain = build(reference_arm(payload), PERIOD / 20, SEGMENTS)
    data = mujoco.MjData(chain.model)
    data.qpos[chain.joint[1]] = theta_2
    mujoco.mj_forward(chain.model, data)
    mass = np.zeros((chain.model.nv, chain.model.nv))
    mujoco.mj_fullM(chain.model, data, mass)
    stiffness = np.diag(np.ravel(chain.model.jnt_stiffness[chain.hinges]))
    squared = eigh(stiffness, mass[np.ix_(chain.hinges, chain.hinges)], eigvals_only=True,
                   subset_by_index=(0, 3))
    return np.asarray(np.sqrt(squared))


def our_frequencies(payload: float, theta_2: float) -> Array:
    """Return the assumed-modes model's first natural frequencies, joints locked, rad/s."""
    form = ExtendedArm(load_robot('reference'), 'assumed_modes', MODES).form
    mass, stiffness = form.mass_at(np.cos(theta_2), payload), form.stiffness_at(np.cos(theta_2))
    squared = eigh(stiffness[2:, 2:], mass[2:, 2:], eigvals_only=True, subset_by_index=(0, 3))
    return np.asarray(np.sqrt(squared))


def largest_stable_substeps(commands: Array) -> int:
    """Return the fewest sub-steps per sample at which the chain stays finite and bounded."""
    for substeps in range(1, 200):
        try:
            run(build(reference_arm(PAYLOAD), PERIOD / substeps, SEGMENTS), commands, substeps)
            return substeps
        except FloatingPointError:
            continue
    raise FloatingPointError('no stable step found')


def chain(substeps: int) -> Contender:
    """Return MuJoCo's chain at a number of sub-steps per sample."""
    start = time.process_time()
    built = build(reference_arm(PAYLOAD), PERIOD / substeps, SEGMENTS)
    building = 1e3 * (time.process_time() - start)
    return Contender(f'MuJoCo chain, step {1e3 * PERIOD / substeps:.2f} ms', building,
                     lambda commands: run(built, commands, substeps))


def ours(modes: int, forces: str) -> Contender:
    """Return our simulator with the FORCES of a name."""
    effects = tuple(build_effect(spec) for spec in FORCES[forces])
    start = time.process_time()
    arm = ExtendedArm(load_robot('reference'), 'assumed_modes', modes, PAYLOAD, effects)
    simulator = Simulator(arm)
    building = 1e3 * (time.process_time() - start)

    def outputs(commands: Array) -> Array:
        simulator.reset()
        return step_arm(simulator, commands)[0]

    return Contender(f'assumed_modes {modes}, {forces}', building, outputs)


def milliseconds(contender: Contender, commands: Array, repeats: int) -> float:
    """Return the processor time of a simulated second, ms: the best of some runs."""
    found = []
    for _ in range(repeats):
        start = time.process_time()
        contender.outputs(commands)
        found.append(time.process_time() - start)
    return 1e3 * min(found) / (PERIOD * len(commands))


def moves(amplitude: float) -> Array:
    """Return commands: swings with jumps on both joints, rad/s."""
    t = PERIOD * np.arange(float(COUNT))
    return amplitude * np.column_stack([np.sin(2.0 * t) + 0.4 * np.sign(np.sin(1.3 * t)),
                                        np.sin(3.0 * t) + 0.4 * np.sign(np.sin(1.7 * t))])


def errors_percent(truth: Array, found: Array) -> Array:
    """Return 100 |e| / |y - mean y| per column."""
    spread = np.linalg.norm(truth - truth.mean(axis=0), axis=0)
    return np.asarray(100.0 * np.linalg.norm(truth - found, axis=0) / spread)


def print_frequencies() -> None:
    """Print both models' frequency errors against the finite elements."""
    print('natural frequencies, joints locked, error of the first four in %')
    for payload, angle in POINTS:
        exact = true_frequencies(payload, angle)
        print(f'  m_p {payload:.1f} kg, theta_2 {angle:.2f} rad: finite elements '
              f'{np.round(exact, 2)} rad/s')
        for name, of in (('MuJoCo chain', chain_frequencies),
                         (f'assumed_modes {MODES}', our_frequencies)):
            errors = 100.0 * (of(payload, angle) / exact - 1.0)
            print(f'    {name:16}', ' '.join(f'{error:+7.3f}' for error in errors))


def main() -> None:
    """Print times, errors and their ratios."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--amplitudes', type=float, nargs='+', default=[0.05, 0.2, 0.5, 1.0, 1.5],
                        help='of the commands, rad/s')
    parser.add_argument('--repeats', type=int, default=5)
    arguments = parser.parse_args()
    mujoco.set_mju_user_warning(lambda _: None)  # a refused step is expected: no log file for it
    print_frequencies()
    substeps = largest_stable_substeps(moves(max(arguments.amplitudes))[:200])
    baseline, *rest = [chain(substeps), chain(2 * substeps), ours(MODES, 'linear'),
                       ours(MODES, 'Coriolis'), ours(MODES, 'foreshortening'),
                       ours(3, 'foreshortening')]
    for amplitude in arguments.amplitudes:
        commands = moves(amplitude)
        truth = true_outputs(commands)
        print(f'\ncommands of {amplitude:g} rad/s: errors in % of joint 1, joint 2, four gauges; '
              'ms a simulated second')
        reference = milliseconds(baseline, commands, arguments.repeats)
        base_errors = errors_percent(truth, baseline.outputs(commands))
        for contender in (baseline, *rest):
            errors = errors_percent(truth, contender.outputs(commands))
            spent = milliseconds(contender, commands, arguments.repeats)
            print(f'  {contender.name:28}', ' '.join(f'{error:6.3f}' for error in errors),
                  f'| {spent:6.2f} ms (+ {contender.building:4.1f} ms once), '
                  f'{reference / spent:5.1f} x as fast, error x',
                  ' '.join(f'{ratio:.2f}' for ratio in errors / base_errors))


if __name__ == '__main__':
    main()
