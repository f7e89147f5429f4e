"""
Show how much the LQG controller gains from knowing the payload.

The arm (`assumed_modes`, two modes, the robot's own noise) follows square set-points of +-0.5 rad
and 4 s with payloads of 0, 0.1 and 0.3 kg, several noise seeds each. One thing varies: the payload
for which predictor and gain are designed. It is fixed, estimated by `rpe` while the arm moves, or
the true one. The step from rest is left out, because there is no estimate yet.

`--drawn` takes another plant: five modes, Coriolis forces, and parts drawn from their
tolerances by the seed. The adaptive design then knows neither the parts nor the payload; the
design that it is compared with knows both.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
import math
from pathlib import Path

from flex_payload_estimator.colours import BLUE, ORANGE
from flex_payload_estimator.control.loop import LoopRecord, run_loop
from flex_payload_estimator.control.lqg import LQGController, LQGSettings
from flex_payload_estimator.control.set_points import square
from flex_payload_estimator.estimators.factory import make_estimator
from flex_plant_sim.arm.parts import drawn
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import build, parse
from flex_plant_sim.simulation.arm_shape import ArmShape
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, Simulator
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

MODEL, MODES = 'assumed_modes', 2
DRAWN_MODES, CORIOLIS = 5, 'coriolis_centripetal:arm:share=1'
# Time between steps, s; steps that are measured; settling band as a share of the tip's way; time
# after a step from which bending energy is averaged, s.
HALF_PERIOD, STEPS, BAND, CALM_AFTER = 2.0, 5, 0.02, 1.0
PAYLOADS = (0.0, 0.1, 0.3)
DESIGNS = ('fixed 0 kg', 'fixed 0.1 kg', 'fixed 0.3 kg', 'adaptive', 'true payload')
MEASURES = ('settling time / s (2: not settled before the next step)', 'bending energy / mJ',
            'command effort / (rad$^2$/s)')
COLOURS = ('#9aa5b1', '#5f7488', '#2f3e4e', ORANGE, BLUE)


@dataclass(frozen=True)
class Run:
    """Time, s, and tip error, mm, both (N,), and the measures, (STEPS, 3)."""

    time: Array
    error: Array
    measures: Array


def drawn_arm(seed: int, payload: float) -> ExtendedArm:
    """Return an arm unlike the controller's model: more modes, other parts, Coriolis forces."""
    robot = drawn(load_robot('reference'), np.random.default_rng([seed, 2]))
    return ExtendedArm(robot, MODEL, DRAWN_MODES, payload, [build(parse(CORIOLIS))])


def settings_of(design: str, payload: float, q_2: float) -> LQGSettings:
    """Return the controller's settings for a design."""
    adapt = design == 'adaptive'
    told = 0.0 if adapt else payload if design == 'true payload' else float(design.split()[1])
    return LQGSettings(adapt=adapt, mass_0=told, q_2=q_2, integrator=False,
                       command_limit=math.inf)


def run(design: str, payload: float, seed: int, q_2: float, other: bool = False) -> Run:
    """Run one closed loop and measure each step but the first."""
    robot = load_robot('reference')
    arm = drawn_arm(seed, payload) if other else ExtendedArm(robot, MODEL, MODES, payload)
    told = arm.robot if other and design == 'true payload' else robot
    simulator = Simulator(arm, None, Noise(robot.angle_noise, robot.strain_noise), seed)
    controller = LQGController(told, MODEL, MODES, settings_of(design, payload, q_2))
    record = run_loop(simulator, make_estimator('rpe', robot, MODEL, 3 if other else MODES),
                      controller, square(), HALF_PERIOD * (STEPS + 1))
    tip = tip_of(arm, np.hstack([record.output[:, :2], record.modal]))
    goal = tip_of(arm, np.pad(record.set_point, ((0, 0), (0, 2 * arm.modes))))
    error = np.linalg.norm(tip - goal, axis=1)
    return Run(record.time, 1e3 * error, measures(arm, record, goal, error))


def tip_of(arm: ExtendedArm, positions: Array) -> Array:
    """Return the payload's position, m, (N, 2), at coordinates p, (N, order)."""
    shape = ArmShape.of(arm, points=3)
    return np.array([shape.lines(position)[1, -1] for position in positions])


def measures(arm: ExtendedArm, record: LoopRecord, goal: Array, error: Array) -> Array:
    """
    Return each step's settling time, s, bending energy, mJ, and effort, rad^2/s: (STEPS, 3).

    Settled: the tip stays within 2 % of its way; 2 s where it does not before the next step.
    Bending energy: its mean from 1 s after the step on. Effort: the integral of both commands
    squared.
    """
    period = arm.robot.sample_time
    length, calm = round(HALF_PERIOD / period), round(CALM_AFTER / period)
    stiffness = arm.form.stiffness_at(1.0)[2:, 2:]
    energy = 0.5 * np.einsum('ki,ij,kj->k', record.modal, stiffness, record.modal)
    rows = []
    for first in range(length, length * (STEPS + 1), length):
        step = slice(first, first + length)
        way = np.linalg.norm(goal[first] - goal[first - 1])
        outside = np.flatnonzero(error[step] > BAND * way)
        rows.append((period * (outside[-1] + 1), 1e3 * energy[first + calm:step.stop].mean(),
                     period * np.sum(record.command[step]**2)))
    return np.array(rows)


def print_table(results: dict[tuple[float, str], list[Run]]) -> None:
    """Print means over steps and seeds, with the seeds' standard deviation."""
    print(f'{"payload":>8}  {"design":13}  {"settling s":>15}  {"bending energy mJ":>20}  '
          f'{"effort rad^2/s":>16}  steps not settled')
    for (payload, design), runs in results.items():
        mean, spread = statistics(runs)
        late = sum(int((one.measures[:, 0] >= HALF_PERIOD).sum()) for one in runs)
        print(f'{payload:5.1f} kg  {design:13}  {mean[0]:7.3f} +- {spread[0]:.3f}  '
              f'{mean[1]:10.4f} +- {spread[1]:.4f}  {mean[2]:8.3f} +- {spread[2]:.3f}  '
              f'{late:3d} of {STEPS * len(runs)}')


def print_drawn(seeds: int, q_2: float) -> None:
    """Print settling times on drawn arms beside those of the design that knows the arm."""
    print(f'{"payload":>8}  settling s: adaptive, true arm, ratio of the means; each arm')
    for payload in PAYLOADS:
        times = np.array([[run(design, payload, seed, q_2, True).measures[:, 0].mean()
                           for design in ('adaptive', 'true payload')] for seed in range(seeds)])
        mean = times.mean(axis=0)
        print(f'{payload:5.1f} kg  {mean[0]:7.3f} {mean[1]:7.3f}  {mean[0] / mean[1]:5.2f}; ',
              ' '.join(f'{one:.2f}/{other:.2f}' for one, other in times), flush=True)


def statistics(runs: list[Run]) -> tuple[Array, Array]:
    """Return the measures' mean over steps and seeds and their spread over seeds, (3,)."""
    means = np.array([one.measures.mean(axis=0) for one in runs])
    return means.mean(axis=0), means.std(axis=0)


def draw(results: dict[tuple[float, str], list[Run]], path: Path) -> None:
    """Draw the tip's error after a step and the three measures."""
    figure = Figure(figsize=(10.0, 7.0), layout='constrained')
    axes = figure.subplots(2, 2)
    _traces(axes[0, 0], results)
    for index, place in enumerate((axes[0, 1], axes[1, 0], axes[1, 1])):
        _bars(place, results, index)
    handles, labels = axes[0, 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', ncols=len(DESIGNS),
                  title='payload of the design')
    figure.savefig(path, dpi=130)


def _traces(axes: Axes, results: dict[tuple[float, str], list[Run]]) -> None:
    heaviest = PAYLOADS[-1]
    for design, colour in zip(DESIGNS, COLOURS):
        one = results[heaviest, design][0]
        # The last three curves coincide: the wide one shows behind the narrow ones.
        axes.semilogy(one.time, one.error, color=colour, lw=4.5 if design == 'adaptive' else 1.2,
                      zorder=1.5 if design == 'adaptive' else 2.0)
    axes.set_xlim(2.0 * HALF_PERIOD, 3.0 * HALF_PERIOD - 0.01)
    axes.set_ylim(bottom=0.1)
    axes.set_xlabel('time / s')
    axes.set_ylabel('distance of the tip from its goal / mm')
    axes.set_title(f'one step with {heaviest:g} kg')
    axes.grid(alpha=0.3)


def _bars(axes: Axes, results: dict[tuple[float, str], list[Run]], index: int) -> None:
    width = 0.8 / len(DESIGNS)
    for k, (design, colour) in enumerate(zip(DESIGNS, COLOURS)):
        found = [statistics(results[payload, design]) for payload in PAYLOADS]
        axes.bar(np.arange(len(PAYLOADS)) + (k - 2) * width, [mean[index] for mean, _ in found],
                 width, yerr=[spread[index] for _, spread in found], color=colour, label=design)
    axes.set_xticks(range(len(PAYLOADS)), [f'{payload:g} kg' for payload in PAYLOADS])
    axes.set_xlabel('payload of the arm')
    axes.set_title(MEASURES[index])
    axes.set_yscale('log' if index == 1 else 'linear')
    axes.grid(axis='y', alpha=0.3)


def main() -> None:
    """Print the table and draw if asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seeds', type=int, default=5)
    parser.add_argument('--q-2', type=float, default=LQGSettings.q_2,
                        help='weight of the commands; smaller is faster')
    parser.add_argument('--drawn', action='store_true',
                        help='an arm that is not its model; nothing to draw')
    parser.add_argument('--figure', type=Path, metavar='PNG', help='where to draw it')
    arguments = parser.parse_args()
    if arguments.drawn:
        print_drawn(arguments.seeds, arguments.q_2)
        return
    results = {(payload, design): [run(design, payload, seed, arguments.q_2)
                                   for seed in range(arguments.seeds)]
               for payload in PAYLOADS for design in DESIGNS}
    print_table(results)
    if arguments.figure:
        draw(results, arguments.figure)


if __name__ == '__main__':
    main()
