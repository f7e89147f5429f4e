"""
The plant: an arm model extended by effects and sampled in time.

The simulator, the predictors and the diagnosis all take their discrete step from here.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

from flex_plant_sim.arm.models import DEFAULT_MODEL, DEFAULT_MODES, MODELS
from flex_plant_sim.arm.paper_model import CompactModel
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.schedule import chebyshev_nodes, NODES, Schedule
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.arm.state_space import state_space, StateSpace, zero_order_hold
from flex_plant_sim.effects import as_built
from flex_plant_sim.effects.base import Effect, FRICTION, GAP, Motion
from msg_config.errors import InputError
import numpy as np
from numpy.typing import NDArray


class ExtendedArm:
    """
    A robot's arm model, extended by effects and sampled with a zero-order hold.

    Parameters
    ----------
    robot : Robot
        Its own `effects` are not applied; pass them as `effects`.
    model : str
        'assumed_modes' or 'paper' (both with the full actuators), or 'paper_reduced': the
        state space (12)-(16), which takes no effect that acts on forces or coordinates.
    modes : int
        Modes per link.
    payload : float
        kg.
    effects : sequence of Effect
    step : float
        Length of one step, s.
    nodes : int
        Number of interpolation nodes over cos(theta_2).
    in_step : bool
        Whether the caller shifts outputs by `late`, the whole samples of their delays, (m,).

    Raises
    ------
    InputError
        The model is unknown, or is paper_reduced with an effect that needs joint velocities.

    """

    def __init__(self, robot: Robot, model: str = DEFAULT_MODEL, modes: int = DEFAULT_MODES,
                 payload: float | None = None, effects: Sequence[Effect] = (),
                 step: float | None = None, nodes: int = NODES, in_step: bool = False):
        if model not in MODELS:
            raise InputError(f'model: expected one of {", ".join(MODELS)}, got {model!r}')
        mass = robot.payload_mass if payload is None else payload
        delays = [effect.late(robot) for effect in effects if in_step]
        none_late: NDArray[np.intp] = np.zeros(len(robot.output_names), dtype=np.intp)
        self.late = sum((late for late, _ in delays), none_late)
        # Effects that replace the model come first, then those that need past commands.
        effects = sorted([e for _, e in delays] or effects,
                         key=lambda e: (not e.reshapes, -e.memory(robot.sample_time)))
        self.model_name, self.effects = model, tuple(effects)
        self.robot = as_built(replace(robot, payload_mass=mass), effects)
        self.payload = self.robot.payload_mass
        self.modes = max([modes, *(effect.modes for effect in effects)])
        self.form: SecondOrderForm = MODELS[model](self.robot, self.modes)
        for effect in effects:
            self.form = effect.on_form(self.form, self.robot)
        self.compact = CompactModel(self.robot, self.modes) if model == 'paper_reduced' else None
        self.step_time = robot.sample_time if step is None else step
        self.nodes = chebyshev_nodes(nodes)
        self.pushing = tuple(e for e in effects if type(e).force is not Effect.force)
        self._friction = tuple(e for e in effects if e.contact == FRICTION)
        self.gaps = tuple(e for e in effects if e.contact == GAP)
        self._output = tuple(e for e in effects if type(e).on_output is not Effect.on_output)
        self._check_reduced()

    def _check_reduced(self) -> None:
        for effect in self.effects if self.compact else ():
            if any(getattr(type(effect), hook) is not getattr(Effect, hook)
                   for hook in ('force', 'dry_friction', 'on_step', 'on_form')):
                raise InputError('model: paper_reduced has no joint velocities, '
                                 f'{effect.identifier} needs paper or assumed_modes')

    @cached_property
    def plant(self) -> StateSpace:
        """Return the continuous plant at the nodes, (K, n, …), with the states effects add."""
        return self._plant(self.nodes, self.payload)

    @cached_property
    def schedule(self) -> Schedule:
        """Return the sampled plant as a table over cos(theta_2)."""
        return Schedule.of(self.plant, self.nodes, self.step_time)

    def matrices(self, cosine: float, payload: float) -> tuple[Array, Array, Array]:
        """Return F (n, n), G (n, 2), E (n, N) at cos(theta_2) and kg, exactly discretised."""
        plant = self._plant(cosine, payload)
        inputs = np.concatenate([plant.b, plant.e], axis=-1)
        f, g = zero_order_hold(plant.a, inputs, self.step_time)
        return f, g[:, :2], g[:, 2:]

    @property
    def states(self) -> int:
        """Return the number of states."""
        return int(self.plant.a.shape[-1])

    @property
    def own_states(self) -> int:
        """Return the number of states before those that effects add."""
        if self.compact is not None:
            return int(self.compact.plant(self.nodes[:1], self.payload).a.shape[-1])
        return 2 * self.form.order

    @property
    def output_matrix(self) -> Array:
        """Return C to (theta_1, theta_2, strain…), (m, n)."""
        return self.plant.c[0]

    @cached_property
    def openings(self) -> tuple[Schedule, ...]:
        """
        Return, for each backlash, [F_open - F, G_open - G, F M^-1 Q, M^-1 Q] over cos(theta_2).

        These are the change of the step while the gear teeth are out of contact, and the change
        of state by unit impulses on the joints at the start and at the end of the step.
        """
        changes = []
        for effect in self.gaps:
            free = state_space(effect.open_form(self.form, self.robot), self.nodes, self.payload)
            # With open backlash a drive torque turns only the rotor.
            free.e[..., effect.index] = 0.0
            opened = Schedule.of(self._with_states(free), self.nodes, self.step_time)
            changes.append(self._with_impulses(opened))
        return tuple(changes)

    def _with_impulses(self, opened: Schedule) -> Schedule:
        n, closed = opened.states, self.schedule.table
        tables = (opened.table - closed).reshape(opened.nodes.size, n, -1)
        f, late = closed.reshape(tables.shape)[..., :n], self.plant.e @ self.form.force
        tables = np.concatenate([tables[..., :n + 2], f @ late, late], axis=-1)
        return replace(opened, table=tables.reshape(opened.nodes.size, -1), forces=4)

    def _plant(self, cosine: Any, payload: Any) -> StateSpace:
        return self._with_states(self.compact.plant(cosine, payload) if self.compact
                                 else state_space(self.form, cosine, payload))

    def _with_states(self, plant: StateSpace) -> StateSpace:
        for effect in self.effects:
            plant = effect.on_state_space(plant, self.robot)
        return plant

    def at_payload(self, payload: float) -> ExtendedArm:
        """Return the same arm with another payload, kg."""
        other = object.__new__(ExtendedArm)
        other.__dict__.update({key: value for key, value in self.__dict__.items()
                               if key not in ('plant', 'schedule', 'openings')})
        other.payload = payload
        return other

    def finer(self, steps: int) -> ExtendedArm:
        """Return the same arm with its step divided by `steps`."""
        other = object.__new__(ExtendedArm)
        other.__dict__.update({key: value for key, value in self.__dict__.items()
                               if key not in ('schedule', 'openings')})
        other.step_time = self.step_time / steps
        return other

    @property
    def has_contact(self) -> bool:
        """Return whether the arm has dry friction or backlash, which act within a step."""
        return bool(self._friction or self.gaps)

    @property
    def has_friction(self) -> bool:
        """Return whether the arm has dry friction."""
        return bool(self._friction)

    @property
    def acts_on_output(self) -> bool:
        """Return whether any effect acts on the sensors."""
        return bool(self._output)

    def motion(self, state: Array, command: Array, time: Any) -> Motion:
        """Return the motion that hooks of effects get, of states (…, n) and commands (…, 2)."""
        n = self.form.order
        return Motion(time, state[..., :n], state[..., n:2 * n], command, self.robot, self.form,
                      self.payload, self.step_time)

    def motion_between(self, state: Array, after: Array, command: Array, time: Any) -> Motion:
        """Return the motion at the middle of a step between two states, (…, n)."""
        change = (after - state)[..., :2 * self.form.order]
        return replace(self.motion(0.5 * (state + after), command, time), change=change)

    @property
    def passes(self) -> int:
        """Return how often a step evaluates its forces: twice if any depends on acceleration."""
        return 2 if any(effect.inertial for effect in self.pushing) else 1

    def advance(self, matrices: tuple[Array, Array, Array], state: Array, command: Array,
                time: Any) -> Array:
        """
        Return the state one step later.

        Dry friction is solved implicitly: it is the torque that would stop a joint within the
        step, limited to the friction level (a time-stepping scheme; no chatter at any T).

        Parameters
        ----------
        matrices : tuple of Array
            F, G, E from `schedule.at(cos(theta_2))`.
        state : Array
            (…, n).
        command : Array
            Commands applied by the drives, (…, 2).
        time : Any
            Time at the start of the step, s.

        """
        f, g, e = matrices
        after = _apply(f, state) + _apply(g, command)
        return self.apply_effects(e, state, after, command, time)

    def apply_effects(self, e: Array, state: Array, after: Array, command: Array,
                      time: Any) -> Array:
        """Return the state (…, n) one step later, from `after`, the linear plant's own step."""
        if not (self.pushing or self.has_contact):
            return after
        pushed = self.apply_free_effects(e, state, after, command, time)
        return self.apply_friction(e, state, pushed, self.motion(state, command, time))

    def apply_free_effects(self, e: Array, state: Array, after: Array, command: Array,
                           time: Any) -> Array:
        """Return the state one step later, (…, n), as `apply_effects` but for dry friction."""
        motion, pushed = self.motion(state, command, time), after
        for _ in range(self.passes if self.pushing else 0):
            middle = self.motion_between(state, pushed, command, time)
            found = after + _apply(e, self.smooth_force(middle))
            pushed = self._newton_step(e, pushed, found, middle) if self.passes > 1 else found
        cosine = np.cos(motion.position[..., 1])
        return self.apply_gaps(state, pushed, motion, [gap.at(cosine) for gap in self.openings])

    def _newton_step(self, e: Array, guess: Array, found: Array, middle: Motion) -> Array:
        """
        Return the Newton step of a state `guess` whose forces lead to `found`.

        Forces that depend on acceleration change with the velocity that they cause. In a light
        link with a heavy payload this added mass exceeds the link's own, so that plain iteration
        would not converge.
        """
        n, step, residual = self.form.order, self.step_time, found - guess
        mass = np.zeros((n, n)) + sum(effect.inertia(middle) for effect in self.pushing)
        through = e[..., n:2 * n, :] @ mass / step
        gained = np.linalg.solve(np.eye(n) + through, residual[..., n:2 * n, None])
        return np.asarray(found - (e @ (mass @ gained / step))[..., 0])

    def smooth_force(self, motion: Motion) -> Array:
        """Return the sum of the force effects, N m and the modes' own, (…, N)."""
        return np.zeros(self.form.order) + sum(effect.force(motion) for effect in self.pushing)

    def apply_gaps(self, state: Array, after: Array, motion: Motion,
                   openings: Iterable[Sequence[Array]]) -> Array:
        """Return `after`, the state (…, n) a step later, corrected for gaps; see `openings`."""
        for effect, (f, g, impulse) in zip(self.gaps, openings):
            parted = after + _apply(f, state) + _apply(g, motion.command)
            after = effect.on_step(after, parted, state, impulse, motion)
        return after

    def apply_friction(self, e: Array, state: Array, after: Array, motion: Motion) -> Array:
        """Return `after`, the state (…, n) one step later, corrected for dry friction."""
        return self._brake(e, state, after, motion) if self._friction else after

    def friction_limits(self, motion: Motion) -> tuple[Array, Array]:
        """Return the largest friction against forward and backward motion, N m, (…, 2) each."""
        forward, backward = np.zeros(2), np.zeros(2)
        for effect in self._friction:
            limits = effect.dry_friction(motion)
            if limits is not None:
                forward, backward = forward + limits[0], backward + limits[1]
        return forward, backward

    def friction_columns(self, e: Array) -> tuple[Array, Array]:
        """
        Return what unit joint torques change over a step.

        The state (…, n, 2), and the velocity of the torque's own joint (…, 2).
        """
        order, columns = self.form.order, e @ self.form.force
        return columns, np.stack([columns[..., order, 0], columns[..., order + 1, 1]], axis=-1)

    @property
    def bends(self) -> tuple[int, int]:
        """Return the index in p of each joint's presliding deflection; -1 if it has none."""
        names = [f'bend_joint_{j}' for j in (1, 2)]
        first, second = (self.form.names.index(name) if name in self.form.names else -1
                         for name in names)
        return first, second

    def yielding(self) -> Array:
        """Return the presliding compliance of each joint's friction, rad/(N m), (…, 2)."""
        return np.zeros(2) + sum(effect.yielding() for effect in self._friction)

    def _brake(self, e: Array, state: Array, free: Array, motion: Motion) -> Array:
        """
        Return the state after a step with dry friction, from the one without, `free`.

        The friction torque is that at the end of the step (implicit), within its limits.
        """
        order, step, bends = self.form.order, self.step_time, self.bends
        forward, backward = self.friction_limits(motion)
        columns, reach = self.friction_columns(e)
        bend = np.stack([state[..., k] if k >= 0 else 0.0 * state[..., 0] for k in bends], -1)
        yielding = self.yielding()
        torque = np.clip((bend + step * free[..., order:order + 2]) / (yielding + step * reach),
                         -backward, forward)
        after = free - _apply(columns, torque)
        for j, k in enumerate(bends):
            if k >= 0:
                after[..., k], after[..., order + k] = (yielding * torque)[..., j], 0.0
        return after

    def joint_velocity(self, state: Array, command: Array) -> Array:
        """Return (theta_1', theta_2'), rad/s, as tachometers have them, (…, 2)."""
        if self.compact is None:
            return state[..., self.form.order:self.form.order + 2]
        flexible = state[..., 2:self.form.order]
        return flexible @ self.compact.m_6.T + command @ self.compact.m_7.T

    def output(self, state: Array, time: Any) -> Array:
        """Return the sensor readings of a state (…, n), without noise; rad and m/m, (…, m)."""
        return self.sense(state @ self.output_matrix.T, time)

    def sense(self, output: Array, time: Any) -> Array:
        """Return the sensor readings of true outputs (…, m): the sensor effects are applied."""
        for effect in self._output:
            output = effect.on_output(output, time, self.robot)
        return output


def _apply(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]
