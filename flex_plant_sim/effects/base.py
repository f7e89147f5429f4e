"""What an effect is: parameters, a site, and hooks into the arm; every hook defaults to no-op."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any, ClassVar

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.arm.state_space import StateSpace
from flex_plant_sim.effects.robot_scale import robot_scale
from msg_config.errors import InputError
import numpy as np

FRICTION, GAP = 'friction', 'gap'


@dataclass(frozen=True)
class Parameter:
    """
    A parameter of an effect; sizes are those of the reference robot, see robot_scale.

    Attributes
    ----------
    name : str
        With its unit at the end, as the robot file spells it, for example level_n_m.
    unit : str
    null : float
        The value at which the effect is absent.
    low, high : float
        Bounds.
    starts : tuple of float
        Values from which a fit starts.
    smallest : float
        Smallest deviation from null that matters in practice; inf where the parameter only
        shapes an effect whose size another parameter gives.
    typical : float
        Standard deviation of the prior around null: what size is conceivable, 68 % within it,
        on robots of this kind; of a parameter that cannot be below null, of the half that is
        left. inf for a time, which may be anywhere in the record.
    optional : bool
        Whether a robot file may leave it out: it is then at null.
    discrete : bool
        Whether nature has it at one of `starts`, each as likely, and nowhere between.

    """

    name: str
    unit: str
    null: float
    low: float
    high: float
    starts: tuple[float, ...]
    smallest: float
    typical: float
    optional: bool = False
    discrete: bool = False

    def scaled(self, factor: float) -> Parameter:
        """Return the parameter of a robot on which its unit is worth a factor more."""
        if factor == 1.0:
            return self
        return replace(self, null=factor * self.null, low=factor * self.low,
                       high=factor * self.high, smallest=factor * self.smallest,
                       typical=factor * self.typical,
                       starts=tuple(factor * start for start in self.starts))


@dataclass(frozen=True)
class Motion:
    """
    Where the arm is, for the hooks that depend on it; leading axes are a batch.

    At the start of a step; for `force`, at its predicted middle.

    Attributes
    ----------
    time : Array
        s, (…,) or scalar.
    position, velocity : Array
        p and p', (…, N).
    command : Array
        u after the command hooks, (…, 2).
    robot : Robot
        With the parameter effects applied.
    form : SecondOrderForm
    payload : float
        kg.
    step : float
        Length of the step, s.
    change : Array
        Of (p, p') over the step, (…, 2 N); for `force` of effects that are `inertial`.

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


@dataclass(frozen=True)
class Effect(ABC):
    """
    One effect at one site, with its parameter values.

    Values are floats, or arrays (B, 1) where a batch of arms differs in them; hooks that build
    matrices (on_robot, on_form, on_state_space) or move a joint's angle, on which the matrices
    depend, take floats only. `structural` says which.
    """

    identifier: ClassVar[str]
    family: ClassVar[str]
    explanation: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    sites: ClassVar[str]
    structural: ClassVar[bool] = False
    # Whether the states mean something else with it: it bends in other shapes.
    reshapes: ClassVar[bool] = False
    # Whether the effect is a cause with a name, which the diagnosis may propose.
    named: ClassVar[bool] = True
    # What decides within a step, beside the linear plant: FRICTION, GAP or nothing.
    contact: ClassVar[str] = ''
    # The parameter that says when it happens, if it is an event.
    event_time: ClassVar[str] = ''
    # The one that says how long that takes.
    event_duration: ClassVar[str] = ''
    # Whether what it adds is proportional to its sizes.
    linear: ClassVar[bool] = False
    # Whether every arm has it, so that what may be hidden is that a model leaves it out.
    in_nature: ClassVar[bool] = False
    # Whether its force depends on the acceleration.
    inertial: ClassVar[bool] = False

    site: str
    values: tuple[Any, ...]

    def __getitem__(self, name: str) -> Any:
        """Return a value by its parameter's name."""
        names = [parameter.name for parameter in self.parameters]
        return self.values[names.index(name)]

    @property
    def index(self) -> int:
        """Return the 0-based joint or link of the site (joint_2 -> 1)."""
        return int(self.site.rstrip('abcdefgh').rsplit('_', 1)[1]) - 1

    @property
    def modes(self) -> int:
        """Return the least number of shapes a link that the effect asks for."""
        return 0

    @classmethod
    def read(cls, values: Mapping[str, Any], parameters: Sequence[Parameter]) -> tuple[Any, ...]:
        """
        Return the effect's values from what a robot file says, by parameter name.

        Parameters
        ----------
        values : Mapping
            By parameter name.
        parameters : sequence of Parameter
            With the bounds that are allowed.

        Raises
        ------
        InputError
            A parameter that is missing, unknown or out of bounds.

        """
        known = [parameter.name for parameter in parameters]
        values = {_full(name, known): value for name, value in values.items()}
        for name in values:
            if name not in known:
                raise InputError(f'effects: {cls.identifier}: expected {", ".join(known)}, '
                                 f'got {name!r}')
        return tuple(_value(cls.identifier, parameter, values) for parameter in parameters)

    def written(self) -> dict[str, Any]:
        """Return what a robot file says of the effect, by parameter name."""
        return {p.name: float(value) for p, value in zip(self.parameters, self.values)}

    @classmethod
    def at(cls, site: str, robot: Robot) -> tuple[Parameter, ...]:
        """Return the parameters at a site of a robot: what each can be, what is conceivable."""
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
            (…, H, 2), the commands before it, the latest last; H = memory samples.
        time : Any
            s.
        sample_time : float
            Time between commands, s.

        """
        return command

    def memory(self, sample_time: float) -> int:
        """Return how many past commands on_command needs."""
        return 0

    def force(self, motion: Motion) -> Array | float:
        """Return the generalised force over a step, (…, N), from the motion at its middle."""
        return 0.0

    def inertia(self, motion: Motion) -> Array | float:
        """Return the mass matrix that an `inertial` force's part with p'' has, (…, N, N), or 0."""
        return 0.0

    def dry_friction(self, motion: Motion) -> tuple[Array, Array] | None:
        """Return the largest torque against motion at each joint, N m: forward, backward."""
        return None

    def yielding(self) -> Array:
        """Return how far each joint's friction gives before it slides, rad/(N m), (…, 2)."""
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
            (…, n), what the step gives with the contact closed and with it open.
        state : Array
            (…, n), at the start of the step.
        impulse : Array
            (…, n, 4), the change of `after` by a unit impulse, N m s, on each joint at the start
            of the step, then at its end.
        motion : Motion
            At the start of the step.

        """
        return after

    def on_output(self, output: Array, time: Any, robot: Robot) -> Array:
        """Return what the sensors say, given the true (theta_1, theta_2, strain…) (…, m)."""
        return output

    def late(self, sample_time: float) -> tuple[int, Effect]:
        """Return by how many whole samples the strain reads late, and the effect less those."""
        return 0, self

    def payload_at(self, time: Any, payload: Any) -> Any:
        """Return the payload, kg, at times, s, given what it would be without; scalar or (N,)."""
        return payload


def _full(name: str, known: Sequence[str]) -> str:
    """Return the one name that this is, with its unit left out (level for level_n_m)."""
    longer = [full for full in known if full.startswith(f'{name}_')]
    return longer[0] if name not in known and len(longer) == 1 else name


def _value(identifier: str, parameter: Parameter, values: Mapping[str, Any]) -> float:
    name = f'effects: {identifier}: {parameter.name}'
    if parameter.name not in values and parameter.optional:
        return parameter.null
    if parameter.name not in values:
        raise InputError(f'{name}: expected a value in {parameter.unit}, it is missing')
    given = values[parameter.name]
    if not isinstance(given, (int, float)):
        raise InputError(f'{name}: expected a number, got {given!r}')
    value = float(given)
    if not (math.isfinite(value) and parameter.low <= value <= parameter.high):
        raise InputError(f'{name}: expected {parameter.low:g} to {parameter.high:g} '
                         f'{parameter.unit}, got {value:g}')
    return value


def one_hot(index: int, size: int) -> Array:
    """Return the unit vector of an index, (size,)."""
    return np.eye(size)[index]
