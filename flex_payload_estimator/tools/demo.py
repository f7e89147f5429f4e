"""
flex_demo: an arm in closed loop over ROS 2 topics, and three estimators of its payload.

plant_sim, payload_estimator and lqg_controller run in lock-step in this process; the recorded
samples are then given to the other estimators, and all is written to one folder.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import os
from pathlib import Path
import shutil
import sys
import time
from typing import Any

from flex_payload_estimator.control.loop import LoopRecord
from flex_payload_estimator.control.loop_figures import FIGURES, save_figures
from flex_payload_estimator.nodes.node_setup import set_points_of
from flex_payload_estimator.tools.demo_folder import DIGESTS, digests, whole_folder
from flex_payload_estimator.tools.estimate import TIMES
from flex_payload_estimator.tools.experiment import (
    AMPLITUDE,
    drawn_arm,
    Experiment,
    largest_bend_percent,
    PLANT_MODES,
    RPE_MODES,
)
from flex_payload_estimator.tools.side_by_side import (
    draw_runs,
    EstimatorRun,
    run_estimators,
    runs_table,
)
from flex_payload_estimator.tools.words import with_uncertainty
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.atomic_file import SUMMARY
from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.logs.bag_log import write_bag
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.origin import Origin
from flex_plant_sim.simulation.nominal import has_coriolis
from flex_plant_sim.simulation.plant_setup import robot_of, simulator_of
from flex_plant_sim.tools import command_line
from msg_config.errors import InputError
from msg_config.parameters import load_parameters
from msg_config.transport import avoid_shared_memory
import numpy as np

# Files of the output folder.
LOG, BAG, ARM, PICTURE = 'run.csv', 'run_mcap', 'arm.yaml', 'payload.png'
# Interval between printed estimates, s of data.
PRINT_INTERVAL = 0.5
# Time without an estimate after which the demo gives up, s.
SILENCE = 30.0
# An estimate has settled where it stays within this share of the true payload: the 5 % criterion
# of control engineering.
SETTLED = 0.05


def run_over_topics(experiment: Experiment) -> LoopRecord:
    """
    Run the three nodes in lock-step in this process; return what the topics carried.

    The topics have a namespace of this process, so that no other arm on the network receives the
    commands.

    Raises
    ------
    InputError
        A parameter does not fit, ROS 2 is missing, or no estimate comes.

    """
    try:
        import rclpy
    except ImportError:
        raise InputError('rclpy is missing: run `make demo`, which installs it, or source '
                         'a ROS 2 installation') from None
    avoid_shared_memory()
    rclpy.init(args=[])
    try:
        return _spin(experiment)
    except Exception:  # noqa: B902  rclpy raises many kinds
        # Ctrl-C shuts rclpy down first, and whatever uses it then fails.
        if rclpy.ok():
            raise
        raise KeyboardInterrupt from None
    finally:
        rclpy.try_shutdown()


def _spin(experiment: Experiment) -> LoopRecord:
    """Run nodes and recorder until every sample is recorded; return the record."""
    from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
    from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode
    from flex_payload_estimator.nodes.topic_recorder import TopicRecorder
    from flex_plant_sim.nodes.plant_sim_node import PlantSim
    from msg_config.node_process import make_executor
    from rclpy.parameter import Parameter
    from rclpy.task import Future

    namespace = f'/flex_demo_{os.getpid()}'
    end: Future[None] = Future()
    print(f'topics: {namespace}/payload, joint_states, strain, command, diagnostics …')
    progress = Progress()
    recorder = TopicRecorder(
        experiment.samples, robot_of(experiment.plant), progress,
        lambda: end.set_result(None), namespace=namespace)
    nodes: list[Any] = [recorder]
    for kind, values in ((PayloadEstimatorNode, experiment.estimator),
                         (LQGControllerNode, experiment.controller),
                         (PlantSim, experiment.plant)):
        nodes.append(kind(namespace=namespace, parameter_overrides=[
            Parameter(name, value=list(value) if isinstance(value, tuple) else value)
            for name, value in values.items() if value != ()]))
    executor = make_executor()
    for node in nodes:
        executor.add_node(node)
    for node in nodes[1:]:
        node.interrupted.add_done_callback(lambda _: end.set_result(None))
    while not end.done():
        heard = progress.count
        executor.spin_until_future_complete(end, timeout_sec=SILENCE)
        if progress.count == heard and not end.done():
            raise InputError(f'no estimate for {SILENCE:g} s: is ROS 2 communication blocked on '
                             'this machine?')
    if any(node.interrupted.done() for node in nodes[1:]):
        raise KeyboardInterrupt
    record = recorder.record(simulator_of(experiment.plant),
                             set_points_of(experiment.controller))
    # Before the nodes: the middleware still calls the executor for what they are about to destroy.
    executor.shutdown()
    for node in nodes:
        node.destroy_node()
    return record


class Progress:
    """Prints the estimates of a run, and counts them."""

    def __init__(self) -> None:
        self.count, self._next = 0, 0.0

    def __call__(self, at: float, mass: float, variance: float) -> None:
        """Print time, mass and standard deviation, at most twice a second of data."""
        self.count += 1
        if at + 1e-9 >= self._next:
            self._next = at + PRINT_INTERVAL
            print(f't = {at:6.2f} s   payload = {with_uncertainty(mass, np.sqrt(variance))} kg',
                  flush=True)


def log_of(experiment: Experiment, record: LoopRecord) -> Log:
    """Return the run as a log that names its origin."""
    robot, plant = robot_of(experiment.plant), experiment.plant
    return Log('flex_demo', record.time, record.command, record.output[:, :2],
               record.output[:, 2:], robot.gauge_names,
               origin=Origin(robot.name, plant['model'], plant['modes'],
                             has_coriolis(simulator_of(plant).arm.effects)))


def summary_of(experiment: Experiment, record: LoopRecord) -> dict[str, Any]:
    """Return the figures of the run for JSON."""
    error = np.abs(record.mass - record.true_mass)
    outside = np.flatnonzero(error > SETTLED * np.maximum(record.true_mass, 1e-9))
    settled = 0 if outside.size == 0 else outside[-1] + 1
    steps = {f'{t:g}': float(record.mass[k]) for t in TIMES
             for k in np.flatnonzero(np.abs(record.time - t) < 1e-6)}
    return {
        'robot': experiment.plant['robot'], 'model': experiment.plant['model'],
        'modes': experiment.plant['modes'], 'estimator': experiment.estimator['estimator'],
        'seed': experiment.plant['seed'], 'duration_s': experiment.duration,
        'samples': len(record.time), 'true_mass_kg': float(record.true_mass[-1]),
        'mass_kg': float(record.mass[-1]), 'std_kg': float(np.sqrt(record.variance[-1])),
        'at_s': steps, 'within_5_percent_from_s':
            float(record.time[settled]) if settled < len(record.time) else None}


def write_output(experiment: Experiment, record: LoopRecord, folder: Path,
                 figures: tuple[int, ...], runs: Sequence[EstimatorRun]) -> None:
    """Write the summary, the pictures and the log of the run into a folder."""
    log = log_of(experiment, record)
    inputs = robot_of(experiment.plant).inputs
    write_csv(folder / LOG, log, inputs)
    write_bag(folder / BAG, log, inputs=inputs)
    save_figures(record, folder, figures)
    draw_runs(record, runs, folder / PICTURE)
    summary = summary_of(experiment, record)
    if (folder / ARM).exists():
        # Relative to the summary, because the folder is renamed.
        summary['robot'] = ARM
    command_line.write_json(folder / SUMMARY, {**summary, DIGESTS: digests(folder)})


def opening_words(options: argparse.Namespace) -> str:
    """Return the first text that is printed: what is about to run."""
    plant = f"the estimator's own model (--matched): {options.model}, n = {options.modes}" \
        if options.matched else (
            f"no estimator's own model: n = {PLANT_MODES} modes a link,\n"
            f'  parts drawn from their tolerances with seed {options.seed}')
    compiling = '; the first run compiles, up to a minute' if COMPILED else ''
    return (f'flex_demo: {options.duration:g} s over ROS 2 topics; {options.estimator} tells the '
            f'controller the payload\n  the plant is {plant}\n'
            f'starting the nodes{compiling} …')


def figure_words(options: argparse.Namespace) -> str:
    """Return the line that names the paper's figures that were drawn; empty if none was."""
    names = [f'figure_{number}.png' for number in sorted(set(options.figures))]
    if not names:
        return ''
    shown = f'{names[0]} … {names[-1]}' if len(names) == len(FIGURES) else ', '.join(names)
    what = "the paper's figures" if len(names) > 1 else "the paper's figure"
    whose = f'; figure 5 is {options.estimator}' if 5 in options.figures else ''
    return f'          {options.out}/{shown}   {what}{whose}\n'


def closing_words(experiment: Experiment, record: LoopRecord, runs: Sequence[EstimatorRun],
                  options: argparse.Namespace) -> str:
    """Return the last text that is printed: the results, and what to look at next."""
    out = options.out
    plant = options.robot if options.matched else f'{out}/{ARM}'
    plant = '' if plant == 'reference' else f' --robot {plant}'
    # The plant's own file holds the payload of the robot file that it was drawn from.
    plant += '' if options.payload is None else f' --payload {options.payload}'
    arm = '' if options.robot == 'reference' else f' --robot {options.robot}'
    same = f'{arm} --model {options.model} --modes {options.modes}'
    beside = Path(sys.argv[0]).with_name('flex_estimate')
    here = f'{beside.parent}/' if not shutil.which('flex_estimate') and beside.is_file() else ''
    return f"""
true payload {record.true_mass[-1]:g} kg; the forearm bent by up to \
{largest_bend_percent(experiment, record):.1f} % of its length
{runs_table(record, runs)}
look at   {out}/{PICTURE}   the estimators side by side
{figure_words(options)}\
          {out}/run.csv, {out}/run_mcap   the run as CSV and as a bag (MCAP)
next      {here}flex_estimate {out}/run.csv{same} --estimator {options.estimator}
          {here}flex_replay {out}/run.csv{plant} --model {experiment.plant['model']} \
--modes {experiment.plant['modes']}"""


def options_of(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed options."""
    options = command_line.parser(
        'An arm in closed loop over ROS 2 topics, and three estimators of its payload.')
    command_line.add_arm_arguments(options, modes=RPE_MODES)
    options.add_argument('--estimator', default='rpe', help='payload estimator in the loop',
                         choices=load_parameters()['payload_estimator']['estimator'].choices)
    options.add_argument('--duration', default=10.0, type=_time, metavar='S',
                         help='simulated time, s')
    options.add_argument('--drop-at', default=None, type=_time, metavar='S',
                         help='let the payload fall at this time, s')
    options.add_argument('--amplitude', default=AMPLITUDE, type=_angle, metavar='RAD',
                         help='of the square set-points; the paper takes 0.5')
    options.add_argument('--matched', action='store_true',
                         help="let the plant be the estimator's own model")
    options.add_argument('--no-noise', action='store_true', help='measure without noise')
    options.add_argument('--seed', default=0, type=command_line.seed, metavar='N',
                         help='seed of all noise')
    options.add_argument('--out', default='demo_output', type=Path, metavar='FOLDER',
                         help='where figures and logs go')
    options.add_argument('--figures', default=tuple(FIGURES), nargs='*', type=int,
                         choices=tuple(FIGURES), metavar='N', help='which of figures 4 to 9')
    return options.parse_args(arguments)


def _time(text: str) -> float:
    value = command_line.number(text)
    if not 0.0 < value <= 1e5:
        raise argparse.ArgumentTypeError(f'expected a time > 0 s, at most 1e5, got {text!r}')
    return value


def _angle(text: str) -> float:
    value = command_line.number(text)
    if not 0.0 < value < np.pi:
        raise argparse.ArgumentTypeError(f'expected an angle > 0 rad, below pi, got {text!r}')
    return value


def _demo(arguments: Sequence[str] | None) -> None:
    options = options_of(arguments)
    Experiment.of(options)
    with whole_folder(options.out, [options.robot]) as folder:
        print(opening_words(options), flush=True)
        experiment = Experiment.of(
            options, None if options.matched else drawn_arm(options, folder / ARM))
        begin = time.monotonic()
        record = run_over_topics(experiment)
        took = time.monotonic() - begin
        print(f'{experiment.duration:g} s of data in {took:.1f} s over topics; the other '
              f'estimators on the same samples, writing {options.out} …', flush=True)
        runs, left_out = run_estimators(record, load_robot(options.robot), {
            options.estimator: (options.model, options.modes)})
        for reason in left_out:
            print(reason, flush=True)
        write_output(experiment, record, folder, tuple(options.figures), runs)
        words = closing_words(experiment, record, runs, options)
    print(words)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run flex_demo and return its exit code."""
    return command_line.run(lambda: _demo(arguments))


if __name__ == '__main__':
    sys.exit(main())
