"""The closed loop without ROS, with the very objects that the nodes use."""

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
    """Turns outputs and the payload into commands; one call a sample."""

    def reset(self) -> None:
        """Forget everything."""

    def command(self, time: float, output: Array, previous_command: Array, mass: float,
                set_point: Array) -> Array:
        """Return u_t, (2,)."""


@dataclass(frozen=True)
class LoopRecord:
    """
    One row a sample; row k holds what was known and decided at time[k].

    Attributes
    ----------
    time : Array
        s, (N,).
    set_point, output, velocity, command : Array
        rad (N, 2); rad and m/m (N, m); rad/s (N, 2); drive's own unit (N, 2): command[k] is
        applied from time[k] on.
    mass, variance, p : Array
        kg, kg^2 and SF1's P, (N,).
    innovation, innovation_std : Array
        rad and m/m, (N, m).
    status : tuple of str
        N.
    modal : Array
        The plant's own modal coordinates q_11…q_1n, q_21…q_2n, m, (N, 2n).
    true_mass : Array
        kg, (N,).

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
        Told outputs and commands.
    controller : Controller
        Told the estimate too.
    set_points : SetPoints
        Of the joint angles, rad, over time, s.
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
    # What was sent: what a drive's effects make of it, neither of the two can know.
    sent = np.zeros(2)
    rows: list[tuple[Any, ...]] = []
    for _ in range(round(duration / simulator.arm.robot.sample_time) + 1):
        sample = simulator.measure()
        output, set_point = sample.output, set_points(sample.time)
        estimate = estimator.update(sample.time, output, sent)
        command = controller.command(sample.time, output, sent, estimate.mass, set_point)
        rows.append((sample.time, set_point, output, sample.velocity, command,
                     *_columns_of(estimate), *_truth(simulator)))
        simulator.step(command)
        sent = command
    return LoopRecord(*_columns(rows))


def _columns_of(estimate: Estimate) -> tuple[Any, ...]:
    """Return the estimate's columns of a record, mass to status."""
    return (estimate.mass, estimate.variance, estimate.p, estimate.innovation,
            estimate.innovation_std, estimate.status)


def _truth(simulator: Simulator) -> tuple[Array, float]:
    """Return what only the plant knows: modal coordinates, m, and payload, kg."""
    return (simulator.state[2:simulator.arm.form.order].copy(), simulator.mass(simulator.time))


def _columns(rows: list[tuple[Any, ...]]) -> list[Any]:
    """Return the rows' columns as arrays, texts as a tuple."""
    return [column if isinstance(column[0], str) else np.array(column) for column in zip(*rows)]
