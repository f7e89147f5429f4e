"""
The experiment of flex_demo: the parameters of its nodes and, unless matched, another arm.

The plant then differs from every estimator's model, in its parts and in its number of modes.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flex_payload_estimator.control.loop import LoopRecord
from flex_plant_sim.arm.parts import drawn
from flex_plant_sim.arm.robot_file import load_robot, robot_text
from flex_plant_sim.arm.robot_text import with_numbers
from flex_plant_sim.simulation.arm_shape import ArmShape
from flex_plant_sim.simulation.plant_setup import robot_of, simulator_of
from msg_config.errors import InputError
from msg_config.parameters import check_parameters
import numpy as np

# Modes per link of the plant: more than any estimator has, so that the plant is no estimator's own
# model.
PLANT_MODES = 8
# Modes per link of `rpe` and the controller: in a loop that feeds noise back three are too few.
RPE_MODES = 5
# Amplitude of the square set-points, rad: the forearm's tip then bends by a few percent of its
# length.
AMPLITUDE = 0.05


@dataclass(frozen=True)
class Experiment:
    """
    The checked parameters of the three nodes, and the duration of the run.

    Attributes
    ----------
    plant, estimator, controller : Mapping
        Parameters of plant_sim, payload_estimator and lqg_controller.
    duration : float
        s.

    """

    plant: Mapping[str, Any]
    estimator: Mapping[str, Any]
    controller: Mapping[str, Any]
    duration: float

    @classmethod
    def of(cls, options: argparse.Namespace, arm_file: Path | None = None) -> Experiment:
        """Return the experiment of the options; with `arm_file`, if given, as the plant."""
        arm = {'robot': options.robot, 'model': options.model, 'modes': options.modes}
        robot = robot_of({'robot': options.robot, 'sample_time': 0.0})
        payload = robot.payload_mass if options.payload is None else options.payload
        plant = {**arm, 'payload': payload, 'seed': options.seed, 'publish_clock': False}
        if arm_file is not None:
            plant.update(robot=str(arm_file), model='assumed_modes', modes=PLANT_MODES)
        if options.no_noise:
            plant.update(angle_noise=0.0, strain_noise=0.0)
        if options.drop_at is not None:
            if options.drop_at >= options.duration:
                raise InputError('--drop-at: expected a time before the end of the run, '
                                 f'{options.duration:g} s, got {options.drop_at:g} s')
            if payload == 0.0:
                raise InputError('--drop-at: expected a payload > 0 kg to drop, got 0 kg')
            plant['payload_schedule'] = [options.drop_at, payload, options.drop_at, 0.0]
        return cls(check_parameters('plant_sim', plant), check_parameters(
            'payload_estimator', {**arm, 'estimator': options.estimator}),
            check_parameters('lqg_controller', {
                **arm, 'integrator': False, 'reference_amplitude': options.amplitude,
                # The plant waits for each command, however busy the machine is.
                'watchdog': 0.0}),
            options.duration)

    @property
    def samples(self) -> int:
        """Return the number of samples in the duration, including the first."""
        return round(self.duration / robot_of(self.plant).sample_time) + 1


def drawn_arm(options: argparse.Namespace, path: Path) -> Path:
    """Write and return the plant's robot file: its parts are drawn from their tolerances."""
    nominal = load_robot(options.robot)
    arm = drawn(nominal, np.random.default_rng([options.seed, 1]))
    path.write_text(with_numbers(robot_text(options.robot), arm), encoding='utf-8')
    return path


def largest_bend_percent(experiment: Experiment, record: LoopRecord) -> float:
    """Return the largest deflection of the forearm's tip, % of the forearm's length."""
    shape = ArmShape.of(simulator_of(experiment.plant).arm)
    count = record.modal.shape[1] // 2
    tip = record.modal[:, count:] @ shape.deflection[1][-1]
    return float(100.0 * np.abs(tip).max() / shape.along[1, -1])
