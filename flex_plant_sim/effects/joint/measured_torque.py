"""Measured torque: a tabulated law of a torque that no effect of the catalogue explains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect, FRICTION, Motion, one_hot
from flex_plant_sim.effects.parameter import Parameter
from msg_config.errors import InputError
import numpy as np

VARIABLES = ('speed', 'angle', 'load', 'command', 'time')


class MeasuredTorque(Effect):
    """
    A torque on one joint as a function of one variable, linear between knots, constant beyond.

    `variable` is speed (rad/s), angle (rad), load (N m, the moment at the link's first gauge),
    command (the drive's unit) or time (s). A knot that stands twice is a step. The part of a law
    over speed that opposes the motion acts like dry friction, so that it never reverses a joint.
    """

    identifier = 'measured_torque'
    family = 'joint and gear'
    explanation = 'A torque of {site} that no effect of the catalogue names follows a table.'
    parameters = ()
    sites = 'joint'
    named = False
    contact = FRICTION

    @property
    def variable(self) -> str:
        """Return the name of the variable that the torque depends on."""
        return str(self.values[0])

    @property
    def table(self) -> tuple[Array, Array]:
        """Return knots and torques, N m, (K,) each."""
        return np.array(self.values[1]), np.array(self.values[2])

    @classmethod
    def read(cls, values: Mapping[str, Any], parameters: Sequence[Parameter]) -> tuple[Any, ...]:
        """Return variable, knots and torques from a robot file's keys."""
        name = f'effects: {cls.identifier}'
        for key in ('variable', 'knots', 'torques_n_m'):
            if key not in values:
                raise InputError(f'{name}: {key}: expected a value, the key is missing')
        for key in set(values) - {'variable', 'knots', 'torques_n_m'}:
            raise InputError(f'{name}: expected variable, knots, torques_n_m, got {key!r}')
        variable = values['variable']
        if variable not in VARIABLES:
            raise InputError(f'{name}: variable: expected one of {", ".join(VARIABLES)}, '
                             f'got {variable!r}')
        knots, torques = (_numbers(f'{name}: {key}', values[key])
                          for key in ('knots', 'torques_n_m'))
        if len(knots) != len(torques):
            raise InputError(f'{name}: torques_n_m: expected {len(knots)} numbers as in knots, '
                             f'got {len(torques)}')
        if np.any(np.diff(knots) < 0.0):
            raise InputError(f'{name}: knots: expected ascending numbers, got {list(knots)}')
        return str(variable), knots, torques

    def written(self) -> dict[str, Any]:
        """Return the values as a robot file holds them."""
        return {'variable': self.variable, 'knots': tuple(map(float, self.values[1])),
                'torques_n_m': tuple(map(float, self.values[2]))}

    def force(self, motion: Motion) -> Array:
        """Return the torque as a generalised force, (…, N), without the part like dry friction."""
        torque = np.asarray(self._driving_torque(motion))[..., None]
        return torque * motion.form.force[:, self.index]

    def dry_friction(self, motion: Motion) -> tuple[Array, Array]:
        """Return the torques that brake forward and backward motion, N m, (…, 2) each."""
        joint = one_hot(self.index, 2)
        if self.variable != 'speed':
            return 0.0 * joint, 0.0 * joint
        speed = motion.velocity[..., self.index]
        forward, backward = self._directional_torques(speed)
        return (np.maximum(-forward, 0.0)[..., None] * joint,
                np.maximum(backward, 0.0)[..., None] * joint)

    def _driving_torque(self, motion: Motion) -> Array:
        j = self.index
        if self.variable == 'speed':
            speed = motion.velocity[..., j]
            forward, backward = self._directional_torques(speed)
            moved = np.where(speed > 0.0, np.maximum(forward, 0.0), 0.0)
            return self._offset + np.where(speed < 0.0, np.minimum(backward, 0.0), moved)
        at = {'angle': lambda: motion.position[..., j], 'command': lambda: motion.command[..., j],
              'load': lambda: motion.position @ load_row(motion.form, motion.robot, j),
              'time': lambda: motion.time}[self.variable]()
        return np.asarray(np.interp(at, *self.table), dtype=float)

    @cached_property
    def _beside_zero(self) -> tuple[float, float]:
        """Return the torques just below and just above zero."""
        knots, torques = self.table
        at = np.flatnonzero(knots == 0.0)
        if at.size:
            return float(torques[at[0]]), float(torques[at[-1]])
        value = float(np.interp(0.0, knots, torques))
        return value, value

    @property
    def _offset(self) -> float:
        """Return the mean of the torques on both sides of rest."""
        left, right = self._beside_zero
        return 0.5 * (left + right)

    # Kept, as a free run asks for both sides twice a step.
    @cached_property
    def _sides(self) -> tuple[Array, Array, Array, Array]:
        """Return knots and torques, without their offset, from zero up and up to zero."""
        knots, torques = self.table
        left, right = self._beside_zero
        above, below = knots > 0.0, knots < 0.0
        return (np.append(0.0, knots[above]), np.append(right, torques[above]) - self._offset,
                np.append(knots[below], 0.0), np.append(torques[below], left) - self._offset)

    def _directional_torques(self, speed: Array) -> tuple[Array, Array]:
        """Return the torque without its offset for forward and for backward motion."""
        up, pushing, down, pulling = self._sides
        return (np.asarray(np.interp(np.maximum(speed, 0.0), up, pushing)),
                np.asarray(np.interp(np.minimum(speed, 0.0), down, pulling)))


def _numbers(name: str, values: Any) -> tuple[float, ...]:
    if not (isinstance(values, (list, tuple)) and values
            and all(isinstance(v, float) and np.isfinite(v) for v in values)):
        raise InputError(f'{name}: expected a list of numbers, got {values!r}')
    return tuple(values)


def load_row(form: SecondOrderForm, robot: Robot, index: int) -> Array:
    """
    Return the bending moment at a link's first gauge over p, N m, (N,): 2 E I / b times strain.

    Raises
    ------
    InputError
        The link has no gauge.

    """
    link, first = robot.links[index], sum(len(link.gauge_positions) for link in
                                          robot.links[:index])
    if not link.gauge_positions:
        raise InputError(f'effects: measured_torque: load: expected a gauge on link {index + 1}')
    scale = 2.0 * link.bending_stiffness / link.thickness
    return np.asarray(scale * form.strain[first], dtype=float)
