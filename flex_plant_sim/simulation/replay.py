"""Simulates the arm with the commands of a log and compares the result with its measurements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from flex_plant_sim.arm.models import DEFAULT_MODEL, DEFAULT_MODES
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.first_rates import first_rates, first_rows, MOVES
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.agreement import fit_percent, rmse
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.nominal import nominal_effects
from flex_plant_sim.simulation.simulator import simulate, Simulator
from flex_plant_sim.simulation.slowest_mode import frequency_of, period_samples
from msg_config.errors import InputError
import numpy as np

# Angle, rad, and strain, m/m, that no arm reaches: a simulation that does has diverged.
DIVERGED_ANGLE, DIVERGED_STRAIN = 1e3, 1.0


@dataclass(frozen=True)
class Replay:
    """
    A log and its simulation from the same commands.

    Attributes
    ----------
    log : Log
    arm : ExtendedArm
    simulated : Array
        Outputs without noise, (N, m), columns as in log.output.
    start_rates : Array
        Rates with which the joints begin, rad/s, (2,).

    """

    log: Log
    arm: ExtendedArm
    simulated: Array
    start_rates: Array

    @property
    def units(self) -> tuple[str, ...]:
        """Return the unit of every channel."""
        return self.arm.robot.output_units

    @property
    def fit_percent(self) -> Array:
        """Return the fit of every channel, %, (m,)."""
        return fit_percent(self.log.output, self.simulated)

    @property
    def rmse(self) -> Array:
        """Return the root mean square error of every channel, (m,)."""
        return rmse(self.log.output, self.simulated)

    def results(self) -> dict[str, Any]:
        """Return settings and figures for JSON; the fit of an unmoving channel is NaN."""
        return {
            'log': self.log.source, 'samples': len(self.log),
            'duration_s': round(float(self.log.time[-1] - self.log.time[0]), 9),
            'robot': self.arm.robot.name, 'model': self.arm.model_name,
            'modes': self.arm.modes, 'payload_kg': self.arm.payload,
            'sample_time_s': self.log.sample_time,
            'effects': [f'{effect.identifier}:{effect.site}' for effect in self.arm.effects],
            'channels': {
                name: {'fit_percent': float(fit),
                       'rmse': float(error), 'unit': unit}
                for name, fit, error, unit in zip(self.log.output_names, self.fit_percent,
                                                  self.rmse, self.units)}}


def replay(log: Log, robot: Robot, model: str = DEFAULT_MODEL, modes: int = DEFAULT_MODES,
           payload: float | None = None, coriolis: bool = True) -> Replay:
    """
    Simulate a log from its commands alone, starting at the log's first joint angles.

    Where these tell that the joints move, and the rest of the log agrees, they begin so; links
    begin straight. The nominal effects are applied. The sample time is that of the log, not of
    the robot.

    Parameters
    ----------
    log : Log
        Its commands drive the simulation.
    robot : Robot
        The arm, with its effects.
    model : str
        A key of models.MODELS.
    modes : int
        Modes per link.
    payload : float, optional
        kg; that of the robot if not given.
    coriolis : bool
        See nominal_robot.

    Raises
    ------
    InputError
        If the simulation diverges.

    """
    robot = replace(robot, sample_time=log.sample_time)
    arm = ExtendedArm(robot, model, modes, payload,
                      nominal_effects(robot, model, coriolis))
    at_rest, moving = np.zeros(2), start_rates(log, arm)
    starts = [at_rest, moving] if moving.any() and arm.compact is None else [at_rest]
    # A drive that follows a step within a sample looks like one that moved before.
    simulated, rates = min(((_simulated(log, arm, rates), rates) for rates in starts),
                           key=lambda found: _misfit(log, found[0]))
    _check_bounded(log, arm, simulated)
    return Replay(log, arm, simulated, rates)


def _simulated(log: Log, arm: ExtendedArm, rates: Array) -> Array:
    """Return the outputs of an arm that begins at the first angles and rates, rad/s, (2,)."""
    simulator = Simulator(arm)
    simulator.begin_at(log.joint[0])
    if arm.compact is None:
        simulator.state[arm.form.order:arm.form.order + 2] = rates
    # An overflow is reported by `_check_bounded`, once.
    with np.errstate(all='ignore'):
        return simulate(simulator, log.command)[0]


def _misfit(log: Log, simulated: Array) -> float:
    """Return the sum of squared error over measured square, of channels not zero; inf if NaN."""
    power = np.sum(log.output**2, axis=0)
    with np.errstate(all='ignore'):
        error = np.sum((log.output - simulated)**2, axis=0)
        share = float(np.sum(error[power > 0.0] / power[power > 0.0]))
    return np.inf if np.isnan(share) else share


def start_rates(log: Log, arm: ExtendedArm) -> Array:
    """Return the joints' rates at a log's first row, rad/s, (2,); 0 where they may be at rest."""
    count = first_rows(period_samples(frequency_of(arm), log.sample_time))
    rates, deviations = first_rates(log.joint[:count], log.sample_time,
                                    np.full(2, arm.robot.angle_noise))
    return np.where(np.abs(rates) > MOVES * deviations, rates, 0.0)


def _check_bounded(log: Log, arm: ExtendedArm, simulated: Array) -> None:
    limits = np.array([DIVERGED_ANGLE] * 2 + [DIVERGED_STRAIN] * log.strain.shape[1])
    fault = ~(np.abs(simulated) < limits)
    if fault.any():
        k, channel = (int(index) for index in np.argwhere(fault)[0])
        pole = float(np.linalg.eigvals(arm.plant.a).real.max())
        raise InputError(
            f'{arm.robot.source}: the model {arm.model_name} with {arm.modes} modes and '
            f'{arm.payload:g} kg is unstable: {log.output_names[channel]} passes '
            f'{limits[channel]:g} after {log.time[k] - log.time[0]:g} s (fastest growing pole '
            f'{pole:+.3g} 1/s)')
