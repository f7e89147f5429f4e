"""
The base class of effects: parameters, a site, and hooks into the arm that do nothing by default.

`ExtendedArm` calls the hooks when it builds the plant and at every step.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.parameter import full_name, given_value, Parameter
from flex_plant_sim.effects.robot_scale import robot_scale
from msg_config.errors import InputError
import numpy as np
from numpy.typing import NDArray

FRICTION, GAP = 'friction', 'gap'


@dataclass(frozen=True)
class Motion:
    """
    State and command of the arm for the hooks that depend on them; leading axes are a batch.

    It is taken at the start of a step; for `force`, at the predicted middle of the step.

    Attributes
    ----------
    time : Array
        s, (…,) or scalar.
    position, velocity : Array
        p and p', (…, N).
    command : Array
        u after the command hooks, (…, 2).
    robot : Robot
        Robot with the parameter effects applied.
    form : SecondOrderForm
    payload : float
        kg.
    step : float
        Length of the step, s.
    change : Array
        Change of (p, p') over the step, (…, 2 N); for `force` of effects that are `inertial`.

    """

    time: Any
    position: Array
    velocity: Array
    command: Array
    robot: Robot
    form: SecondOrderForm
    payload: float
    step: float
    change: Any = 0.0

    @property
    def acceleration(self) -> Array:
        """Return p'' over the step, (…, N)."""
        *batch, order = self.velocity.shape
        return np.broadcast_to(self.change / self.step, (*batch, 2 * order))[..., order:]


@dataclass(frozen=True)
class Effect(ABC):
    """
    One effect at one site, with its parameter values.

    Values are floats, or arrays (B, 1) for a batch of arms that differ in them. Effects that build
    matrices (on_robot, on_form, on_state_space), or move a joint's angle, on which the matrices
    depend, take only floats; they are marked by `structural`.
    """

    identifier: ClassVar[str]
    family: ClassVar[str]
    explanation: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    sites: ClassVar[str]
    structural: ClassVar[bool] = False
    # Whether the effect changes the shapes in which links bend, and so the meaning of the states.
    reshapes: ClassVar[bool] = False
    # Whether the effect is a cause with a name, which the diagnosis may propose.
    named: ClassVar[bool] = True
    # Kind of contact that acts within a step, beside the linear plant: FRICTION, GAP or none.
    contact: ClassVar[str] = ''
    # Parameter that gives the time of an event; empty if the effect is not an event.
    event_time: ClassVar[str] = ''
    # Parameter that gives the duration of the event.
    event_duration: ClassVar[str] = ''
    # Whether the contribution of the effect is proportional to its sizes.
    linear: ClassVar[bool] = False
    # Whether its force depends on the acceleration.
    inertial: ClassVar[bool] = False

    site: str
    values: tuple[Any, ...]

    def __getitem__(self, name: str) -> Any:
        """Return the value of a parameter by name."""
        names = [parameter.name for parameter in self.parameters]
        return self.values[names.index(name)]

    @property
    def index(self) -> int:
        """Return the 0-based joint or link of the site (joint_2 -> 1)."""
        return int(self.site.rstrip('abcdefgh').rsplit('_', 1)[1]) - 1

    @property
    def remark(self) -> str:
        """Return what the values amount to, for a reader; mostly nothing."""
        return ''

    @property
    def modes(self) -> int:
        """Return the least number of shapes per link that the effect requires."""
        return 0

    @classmethod
    def read(cls, values: Mapping[str, Any], parameters: Sequence[Parameter]) -> tuple[Any, ...]:
        """
        Return the effect's values from those of a robot file.

        Parameters
        ----------
        values : Mapping
            Values by parameter name.
        parameters : sequence of Parameter
            The parameters, with the bounds that are allowed.

        Raises
        ------
        InputError
            A parameter is missing, unknown or out of bounds.

        """
        known = [parameter.name for parameter in parameters]
        values = {full_name(name, known): value for name, value in values.items()}
        for name in values:
            if name not in known:
                raise InputError(f'effects: {cls.identifier}: expected {", ".join(known)}, '
                                 f'got {name!r}')
        return tuple(given_value(cls.identifier, parameter, values) for parameter in parameters)

    def written(self) -> dict[str, Any]:
        """Return the values as a robot file holds them, by parameter name."""
        return {p.name: float(value) for p, value in zip(self.parameters, self.values)}

    @classmethod
    def of_size(cls, site: str, size: float) -> Effect:
        """Return the effect at a site with its first parameter given, the others at null."""
        return cls(site, (size, *(parameter.null for parameter in cls.parameters[1:])))

    @classmethod
    def at(cls, site: str, robot: Robot) -> tuple[Parameter, ...]:
        """Return the parameters with bounds and sizes for a site of a robot."""
        return tuple(p.scaled(robot_scale(p.unit, site, robot)) for p in cls.parameters)

    def on_robot(self, robot: Robot) -> Robot:
        """Return the robot with changed parameters."""
        return robot

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with changed or added coordinates (added ones come last)."""
        return form

    def on_state_space(self, plant: StateSpace, robot: Robot) -> StateSpace:
        """Return the plant with added first-order states (added ones come last)."""
        return plant

    def on_command(self, command: Array, history: Array, time: Any,
                   sample_time: float) -> Array:
        """
        Return the command that reaches the drive.

        Parameters
        ----------
        command : Array
            (…, 2), applied from `time` on.
        history : Array
            (…, H, 2), the H = memory commands before it, latest last.
        time : Any
            s.
        sample_time : float
            Time between commands, s.

        """
        return command

    def memory(self, sample_time: float) -> int:
        """Return the number of past commands that on_command needs."""
        return 0

    def pushed_by(self, motion: Motion) -> Sequence[Any] | None:
        """Return all that `force` depends on, so that it can be kept; None if it cannot."""
        return None

    def force(self, motion: Motion) -> Array | float:
        """Return the generalised force over a step, (…, N), from the motion at its middle."""
        return 0.0

    def inertia(self, motion: Motion) -> Array | float:
        """Return the mass matrix of the part of an `inertial` force with p'', (…, N, N), or 0."""
        return 0.0

    def dry_friction(self, motion: Motion) -> tuple[Array, Array] | None:
        """Return the largest torque against motion at each joint, N m: forward, backward."""
        return None

    def yielding(self) -> Array:
        """Return the presliding compliance of each joint's friction, rad/(N m), (…, 2)."""
        return np.zeros(2)

    def open_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form while the effect's contact is open; for effects with on_step."""
        return form

    def on_step(self, after: Array, parted: Array, state: Array, impulse: Array,
                motion: Motion) -> Array:
        """
        Return the state after a step in which a contact may open or close.

        Parameters
        ----------
        after, parted : Array
            (…, n), the state after the step with the contact closed and with it open.
        state : Array
            (…, n), the state at the start of the step.
        impulse : Array
            (…, n, 4), the change of `after` by a unit impulse, N m s, on each joint at the start
            of the step, then at its end.
        motion : Motion
            The motion at the start of the step.

        """
        return after

    def on_output(self, output: Array, time: Any, robot: Robot) -> Array:
        """Return the sensor readings for the true (theta_1, theta_2, strain…), (…, m)."""
        return output

    def late(self, robot: Robot) -> tuple[NDArray[np.intp], Effect]:
        """Return the whole samples by which each output is late, (m,), the effect without them."""
        return np.zeros(len(robot.output_names), dtype=np.intp), self

    def payload_at(self, time: Any, payload: Any) -> Any:
        """Return the payload, kg, at times, s, given that without the effect; scalar or (N,)."""
        return payload


def one_hot(index: int, size: int) -> Array:
    """Return the unit vector of an index, (size,)."""
    found = np.zeros(size)
    found[index] = 1.0
    return found
