"""
The closed loop without ROS: plant -> estimator -> controller -> plant, one pass a sample.

It runs the same estimator and controller objects as the nodes, for tests and benchmarks.
`loop_figures.py` draws its record.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from flex_payload_estimator.control.set_points import SetPoints
from flex_payload_estimator.estimators.base import Estimate, PayloadEstimator
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.simulator import Simulator
from msg_config.errors import InputError
import numpy as np


class Controller(Protocol):
    """Computes the command from outputs and payload; called once a sample."""

    def reset(self) -> None:
        """Forget everything."""

    def command(self, time: float, output: Array, previous_command: Array, mass: float,
                set_point: Array) -> Array:
        """
        Return the command u_t, (2,), in the drive's own unit.

        Parameters
        ----------
        time : float
            t, s.
        output : Array
            y_t: angles, rad, and strains, m/m, (m,).
        previous_command : Array
            u_{t-1}, (2,).
        mass : float
            Estimated payload, kg.
        set_point : Array
            Joint angles, rad, (2,).

        """


@dataclass(frozen=True)
class LoopRecord:
    """
    Record of a closed loop: row k holds what was known and decided at time[k].

    Attributes
    ----------
    time : Array
        s, (N,).
    set_point, output, velocity, command : Array
        rad (N, 2); rad and m/m (N, m); rad/s (N, 2); drive's own unit (N, 2): command[k] is
        applied from time[k] on.
    mass, variance, p : Array
        Estimated payload, kg, its variance, kg^2, and SF1's P, (N,).
    innovation, innovation_std : Array
        rad and m/m, (N, m).
    status : tuple of str
        The estimator's status, N.
    modal : Array
        The plant's own modal coordinates q_11…q_1n, q_21…q_2n, m, (N, 2n).
    true_mass : Array
        The plant's payload, kg, (N,).

    """

    time: Array
    set_point: Array
    output: Array
    velocity: Array
    command: Array
    mass: Array
    variance: Array
    p: Array
    innovation: Array
    innovation_std: Array
    status: tuple[str, ...]
    modal: Array
    true_mass: Array


def run_loop(simulator: Simulator, estimator: PayloadEstimator, controller: Controller,
             set_points: SetPoints, duration: float) -> LoopRecord:
    """
    Return the record of a closed-loop experiment; estimator and controller are reset first.

    At each stamp t: the plant measures y_t with u_{t-1} applied, the estimator gives m_t from
    (y_t, u_{t-1}), the controller u_t from (y_t, u_{t-1}, m_t, w_t), the plant steps with u_t.

    Parameters
    ----------
    simulator : Simulator
        The plant.
    estimator : PayloadEstimator
        Gets outputs and commands.
    controller : Controller
        Gets outputs, commands and the estimated payload.
    set_points : SetPoints
        Set-points of the joint angles, rad, over time, s.
    duration : float
        s; the record holds round(duration / T) + 1 samples.

    Raises
    ------
    InputError
        duration is not positive.

    """
    if not duration > 0.0:
        raise InputError(f'duration: expected a time > 0 s, got {duration:g}')
    estimator.reset()
    controller.reset()
    # The command as sent: neither estimator nor controller can know what the drive's effects make
    # of it.
    sent = np.zeros(2)
    rows: list[tuple[Any, ...]] = []
    for _ in range(round(duration / simulator.arm.robot.sample_time) + 1):
        sample = simulator.measure()
        output, set_point = sample.output, set_points(sample.time)
        estimate = estimator.update(sample.time, output, sent)
        command = controller.command(sample.time, output, sent, estimate.mass, set_point)
        rows.append((sample.time, set_point, output, sample.velocity, command,
                     *_estimate_columns(estimate), *_truth(simulator)))
        simulator.step(command)
        sent = command
    return LoopRecord(*_columns(rows))


def _estimate_columns(estimate: Estimate) -> tuple[Any, ...]:
    """Return the estimate's part of a row of LoopRecord, from mass to status."""
    return (estimate.mass, estimate.variance, estimate.p, estimate.innovation,
            estimate.innovation_std, estimate.status)


def _truth(simulator: Simulator) -> tuple[Array, float]:
    """Return what only the plant knows: modal coordinates, m, (2n,), and payload, kg."""
    return (simulator.state[2:simulator.arm.form.order].copy(), simulator.mass(simulator.time))


def _columns(rows: list[tuple[Any, ...]]) -> list[Any]:
    """Return the columns of the rows: numbers as arrays, texts as a tuple."""
    return [column if isinstance(column[0], str) else np.array(column) for column in zip(*rows)]
