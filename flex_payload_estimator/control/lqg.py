"""LQG controller (31) in delta form: one Riccati iteration a sample, on the running payload."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from flex_payload_estimator.control.safeguards import BelievedPayload
from flex_payload_estimator.estimators.base import is_finite, largest_payload
from flex_payload_estimator.kalman.predictor import KalmanPredictor
from flex_payload_estimator.kalman.riccati import riccati_step, settled
from flex_payload_estimator.model.delta import DeltaOperator, halvings_for, series, TERMS
from flex_payload_estimator.model.payload_model import payload_model
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.compiled import compiled
from msg_config.errors import InputError
import numpy as np

# Standard deviations of the innovation beyond which a measurement is not used: an arm unlike its
# model (30 % softer, six payloads, dry friction) stays below 3.
GATE = 8.0
# So many in a row mean that the predictor is lost, and it begins again at the measurement. Chosen:
# at 100 Hz as long as a drive waits for a command. Angles that are 1 rad off for no longer move a
# joint of an arm with links 15 % softer by 0.01 rad, for twice as long by 0.5 rad.
MOST_DOUBTED = 10
# What r_2 is by default, rad^2 and V^2: a predictor told of less noise is no better a judge.
SMALLEST_VARIANCE = 1e-4


@dataclass(frozen=True, kw_only=True)
class LQGSettings:
    """
    What (30) and (31) give, and the choices beside it.

    Attributes
    ----------
    adapt : bool
        Schedule on the estimated payload; otherwise on mass_0.
    mass_0 : float
        Payload of the design until an estimate comes, kg.
    payload_max : float or None
        Estimates are taken inside [0, payload_max], kg, no faster than a gripper closes; None for
        what `largest_payload` says.
    q_2 : float
        Q_2 = q_2 I.
    r_1, r_2 : float
        R_1 = r_1 I, R_2 = r_2 I of the predictor, angles in rad, gauges in V; a disturbance, in
        its drive's own unit, wanders as much as a state may.
    terms : int
        n' of (19).
    integrator : bool
        Estimate a constant disturbance of each command and take it out: integral action. It
        cannot wind up, because the predictor is driven by the limited command.
    command_limit : float
        Largest magnitude of either command, beside the drive's own.

    """

    adapt: bool = True
    mass_0: float = 0.0
    payload_max: float | None = None
    q_2: float = 0.005
    r_1: float = 1e-4
    r_2: float = 1e-4
    terms: int = TERMS
    integrator: bool
    command_limit: float


class LQGController:
    """
    u_t = -L (x_t - x_ref) with L from one iteration of the Riccati equation a sample.

    The reference state holds both joints at their set-points with straight links, so that the
    end-point angle rests on its set-point too. Q_1 = C_theta' C_theta + C-bar'' C-bar': (31)
    weights theta_2e only and would leave one combination of the two joint angles free.

    Parameters
    ----------
    robot : Robot
    model : str
        'paper_reduced', 'paper' or 'assumed_modes'.
    modes : int
        Modes a link.
    settings : LQGSettings

    Attributes
    ----------
    payload_max : float
        Largest payload that an estimate is taken for, kg.
    doubted : int
        How many of the last measurements in a row were too far from their prediction to be used.
    leap : Array
        How far both angles were from their prediction, rad, (2,), where the last sample is
        believed after some that were not; otherwise zero.

    """

    def __init__(self, robot: Robot, model: str, modes: int, settings: LQGSettings):
        self.settings, self.step = settings, robot.sample_time
        self.model = payload_model(robot, model, modes)
        self._drive_limits = np.array([drive.command_limit for drive in robot.drives])
        self.limit_commands(settings.command_limit)
        self.payload_max = largest_payload(robot, settings.payload_max)
        self._believed = BelievedPayload(settings.mass_0, self.payload_max)
        n, extra = self.model.states, 2 * settings.integrator
        angles, end = self.model.output[:2], self.model.end_point[None]
        self.q_1 = angles.T @ angles + end.T @ end
        self.q_2 = settings.q_2 * np.eye(2)
        self._output_rows = np.hstack([self.model.output,
                                       np.zeros((len(self.model.output), extra))])
        self.kalman = KalmanPredictor(self._output_rows, settings.r_1 * np.eye(n + extra),
                                      settings.r_2 * np.eye(len(self.model.output)), self.step)
        halvings = halvings_for(self.model.radius, self.step, settings.terms)
        self._omega = DeltaOperator(n, self.step, settings.terms, halvings)
        self._start = self._settled_design()
        self.reset()
        for _ in range(2):
            # Compile what is compiled, so that no sample waits for it.
            self.command(0.0, np.zeros(len(self.model.scale)), np.zeros(2), 0.0, np.zeros(2))
        self.reset()

    def limit_commands(self, limit: float) -> None:
        """Let no command pass a magnitude, from the next one on; the drives' limits stay."""
        self._limit = np.minimum(self._drive_limits, limit)

    def _settled_design(self) -> Array:
        """Return the S at which the iterations start: the solution at mass_0, theta_2 = 0."""
        a_bar, b_bar = self._stretched()
        return settled(a_bar, b_bar, self.q_1, self.q_2, self.step)[1]

    @property
    def transition(self) -> tuple[Array, Array, float]:
        """Return A-bar (n, n) and B-bar (n, 2) from the last sample on, and cos(theta_2)."""
        if self._model is None:
            return *self._stretched(), 1.0
        n = self.model.states
        a_bar, b_bar = self._model[0][:n, :n], self._model[1][:n]
        return np.ascontiguousarray(a_bar), b_bar, math.cos(self._angle)

    def reset(self) -> None:
        """Forget everything."""
        self.kalman.reset()
        self.state = np.zeros(self._output_rows.shape[1])
        self.cost, self.gain = self._start.copy(), np.zeros((2, self.model.states))
        self._believed.reset()
        self._mass, self._angle = self.settings.mass_0, 0.0
        self._output: Array | None = None
        self.doubted, self.leap = 0, np.zeros(2)
        self._model: tuple[Array, Array] | None = None
        self._previous = np.zeros(2)

    def command(self, time: float, output: Array, previous_command: Array, mass: float,
                set_point: Array) -> Array:
        """
        Return u_t, inside the limits, (2,).

        Parameters
        ----------
        time : float
            s.
        output : Array
            (theta_1, theta_2, strain…), rad and m/m, (m,). Not finite: the predictor runs on
            without it.
        previous_command : Array
            Applied up to this sample, (2,).
        mass : float
            Estimated payload, kg; the last one is kept where it is not finite.
        set_point : Array
            Of the joint angles, rad, (2,).

        Raises
        ------
        InputError
            Wrong number of outputs, or set-points that are not finite.

        """
        if np.shape(output) != self.model.scale.shape:
            raise InputError(f'output: expected {len(self.model.scale)} numbers, '
                             f'got shape {np.shape(output)}')
        # Another layout in memory would be compiled for while the sample waits.
        set_point = np.array(set_point, dtype=float)
        previous_command = np.array(previous_command, dtype=float)
        if not is_finite(set_point):
            raise InputError(f'set_point: expected finite numbers, got {set_point}')
        if is_finite(previous_command):
            self._previous = previous_command
        self._predict(self.model.scale * output)
        if self.settings.adapt:
            self._mass = self._believed(float(mass), time)
        a, b = self.model.matrices(math.cos(self._angle), self._mass)
        *model, self.gain, self.cost, command = controlled(
            a, b, self._omega.room, self.q_1, self.q_2, self.cost, self.step, self.state,
            set_point, self._limit)
        self._model = model[0], model[1]
        return command

    def _predict(self, scaled: Array) -> None:
        """Move the state to this sample by (23)."""
        if self._model is not None:
            self.state = self.kalman.advance(self.state, *self._model, self._previous,
                                             self._output)
        good = is_finite(scaled) and not self._doubtful(scaled)
        if good and self._output is None and self._model is None:
            self.state[:2] = scaled[:2]
        self._output = scaled if good else None
        self._angle = float(scaled[1]) if good else float(self.state[1])

    def _doubtful(self, scaled: Array) -> bool:
        """Return whether a measurement is too far from its prediction to be used."""
        self.leap = np.zeros(2)
        if self._model is None:
            return False
        if self.kalman.explains(self.state, scaled, GATE, SMALLEST_VARIANCE):
            # The longer a measurement is doubted, the less the prediction is known against it.
            self.leap = (scaled[:2] - self.state[:2]) * (self.doubted > 0)
            self.doubted = 0
            return False
        self.doubted += 1
        if self.doubted <= MOST_DOUBTED:
            return True
        self.kalman.reset()
        self.leap = scaled[:2] - self.state[:2]
        self.state = np.zeros_like(self.state)
        self.state[:2], self.doubted = scaled[:2], 0
        return False

    def _stretched(self) -> tuple[Array, Array]:
        """Return A-bar and B-bar at mass_0, theta_2 = 0."""
        a, b = self.model.matrices(1.0, self.settings.mass_0)
        big = self._omega(a)
        return big.dot(a), big.dot(b)


@compiled
def controlled(a: Array, b: Array, room: tuple[Any, ...], q_1: Array, q_2: Array, cost: Array,
               step: float, state: Array, set_point: Array, limit: Array
               ) -> tuple[Array, Array, Array, Array, Array]:
    """
    Return A-bar, B-bar, the gain L and the cost S of one iteration, and u inside the limits.

    Where the disturbances of the commands are estimated, A-bar and B-bar have them too: they are
    constant over a sample.

    Parameters
    ----------
    a, b : Array
        A (n, n) and B (n, 2).
    room : tuple
        See `DeltaOperator`.
    q_1, q_2, cost, step
        See `riccati_step`.
    state : Array
        (n,), then the disturbances of the commands, if they are estimated.
    set_point, limit : Array
        (2,).

    """
    big, n = series(a, *room), len(a)
    a_bar, b_bar = np.dot(big, a), np.dot(big, b)
    gain, cost, _ = riccati_step(a_bar, b_bar, q_1, q_2, cost, step)
    error = state[:n].copy()
    error[:2] -= set_point
    command = -np.dot(gain, error)
    if state.size > n:
        command -= state[n:]
        whole, entry = np.zeros((n + 2, n + 2)), np.zeros((n + 2, 2))
        whole[:n, :n], whole[:n, n:], entry[:n] = a_bar, b_bar, b_bar
        a_bar, b_bar = whole, entry
    return a_bar, b_bar, gain, cost, np.minimum(np.maximum(command, -limit), limit)
