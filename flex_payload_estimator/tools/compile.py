"""
flex_compile: compile every inner loop once, so that no node or tool waits for it later.

It runs each loop on a short example in a process of its own; Numba keeps the result on disk.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
import multiprocessing
import sys

from flex_payload_estimator.control.loop import run_loop
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_payload_estimator.estimators.rpe.modes import ROUGH
from flex_payload_estimator.nodes.node_setup import controller_of, estimator_of, set_points_of
from flex_plant_sim.arm.models import DEFAULT_MODEL, DEFAULT_MODES
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.compiled import COMPILED
from flex_plant_sim.diagnosis.prediction.latent_forces import latent_forces
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.windows import Record, Windows
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base
from flex_plant_sim.simulation.plant_setup import simulator_of
from flex_plant_sim.tools import command_line
from msg_config.errors import InputError
from msg_config.parameters import check_parameters
import numpy as np

# Samples of the example record, long enough to be cut into windows and smoothed.
SAMPLES = 2000


def _loop(estimator: str, model: str, modes: int) -> None:
    """Run simulator, estimator and controller in closed loop for a few samples."""
    arm = {'model': model, 'modes': modes}
    controller = check_parameters('lqg_controller', arm)
    estimates = check_parameters('payload_estimator', {**arm, 'estimator': estimator})
    plant = check_parameters('plant_sim', arm)
    run_loop(simulator_of(plant), estimator_of(estimates), controller_of(controller),
             set_points_of(controller), 0.05)


def estimators() -> None:
    """Compile rpe, and simulator and controller with it."""
    _loop('rpe', DEFAULT_MODEL, DEFAULT_MODES)
    # What free parts tell after a pass, which begins after some seconds in motion.
    stepper = RecursivePredictionError(load_robot('reference')).stepper
    free = stepper.begin(ROUGH, np.zeros(len(stepper.told_variance)), 0.1, 0.1)
    free.passes = 1
    stepper.published(free)


def regressions() -> None:
    """Compile SF1 on the reduced model and on a second-order model."""
    for model, modes in (('paper_reduced', 2), ('assumed_modes', 2)):
        for name in ('sf1_paper', 'sf1') if model == 'paper_reduced' else ('sf1',):
            _loop(name, model, modes)


def smoothing() -> None:
    """Compile the diagnosis' prediction, smoothing and free run of a record."""
    robot = load_robot('reference')
    rng = np.random.default_rng(0)
    time = robot.sample_time * np.arange(float(SAMPLES))
    record = Record('compiling', time, rng.normal(size=(SAMPLES, 2)),
                    1e-3 * rng.normal(size=(SAMPLES, 6)), robot.payload_mass)
    windows = Windows.cut(record, 10.0, robot.sample_time)[0]
    base = nominal_base(robot, DEFAULT_MODEL, DEFAULT_MODES)
    predictor = Predictor(base, windows, np.full(6, 1e-4), for_comparison=True)
    latent_forces(Predictor(base, windows, np.full(6, 1e-4)))
    # Any other robot than the base's, so that its residual is whitened anew.
    predictor.whitened_residual(robot=replace(robot, payload_mass=0.5 * robot.payload_mass))
    # A free run of an arm whose effects are asked at every step.
    arm = base.arm(robot.payload_mass)
    arm.advance(arm.schedule.at(1.0), np.zeros(arm.states), np.zeros(2), 0.0)


PARTS: tuple[Callable[[], None], ...] = (estimators, regressions, smoothing)


def options() -> argparse.ArgumentParser:
    """Return the options of flex_compile."""
    return command_line.parser(
        'Compile every inner loop once, so that no node or tool waits for it later.')


def _main() -> None:
    if not COMPILED:
        print('nothing to compile: Numba is not installed or switched off')
        return
    context = multiprocessing.get_context('spawn')
    workers = [context.Process(target=part, daemon=True) for part in PARTS]
    try:
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
    finally:
        # After a SIGTERM, which the workers do not get: none may run on.
        for worker in workers:
            if worker.is_alive():
                worker.kill()
    failed = [part.__name__ for part, worker in zip(PARTS, workers) if worker.exitcode]
    if failed:
        raise InputError(f'flex_compile: expected compiled loops, failed: {", ".join(failed)}')


def main(arguments: Sequence[str] | None = None) -> int:
    """Run flex_compile."""
    options().parse_args(arguments)
    return command_line.run(_main)


if __name__ == '__main__':
    sys.exit(main())
