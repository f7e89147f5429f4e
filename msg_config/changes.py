"""Changes of parameters while a node runs: applied at once, applied at the reset, or refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from msg_config.errors import InputError
from msg_config.parameters import load_parameters
from msg_config.ros import parameter_value


class Changes:
    """
    Sorts changes by when the parameter table lets them apply, and keeps those that wait.

    What a waiting change describes is built at once, so that it is known to be valid; the reset
    then only installs it.

    Parameters
    ----------
    node : str
        Name of the node's table.
    values : dict
        The parameters in force.

    Attributes
    ----------
    values : dict
        The parameters in force.

    """

    def __init__(self, node: str, values: dict[str, Any]):
        self.values = values
        self._rows = load_parameters()[node]
        self._wanted = dict(values)
        self._built: Any = None

    def sort(self, parameters: Sequence[Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """
        Return the changes that wait for a reset, and those that apply at once.

        Parameters
        ----------
        parameters : sequence of rclpy.parameter.Parameter
            Those of other tables (use_sim_time) are ignored.

        Raises
        ------
        InputError
            A value does not fit, or a read-only parameter would change.

        """
        later, live = {}, {}
        for parameter in parameters:
            row = self._rows.get(parameter.name)
            if row is None:
                continue
            value = row.check(parameter_value(parameter))
            if row.applies == 'live':
                live[row.name] = value
            elif value != self._wanted[row.name]:
                if row.applies == 'read_only':
                    raise InputError(f'{row.name}: read-only while the node runs: start it again '
                                     f'with {row.name}:={parameter.value}')
                later[row.name] = value
        return later, live

    def prepare(self, live: dict[str, Any], later: dict[str, Any],
                build: Callable[[dict[str, Any]], Any]) -> Any:
        """Return what `build` makes of the parameters after the next reset; None if unchanged."""
        return build({**self._wanted, **live, **later}) if later else None

    def accept(self, live: dict[str, Any], later: dict[str, Any], prepared: Any,
               ) -> dict[str, Any]:
        """Apply the live changes, keep the others until the reset; return the values in force."""
        self._wanted = {**self._wanted, **live, **later}
        self._built = prepared if later else self._built
        self.values = {**self.values, **live}
        return self.values

    @property
    def waiting(self) -> list[str]:
        """Names of the parameters whose changes wait for the next reset."""
        return [name for name, value in self._wanted.items() if value != self.values[name]]

    @property
    def unused(self) -> list[str]:
        """What changes nothing beside the other parameters as they will be after the reset."""
        return [f'{name} changes nothing with {unmet}' for name, row in self._rows.items()
                if self._wanted[name] != row.default and (unmet := row.unmet(self._wanted))]

    def take(self) -> Any:
        """Put the waiting changes in force; return what was built for them, or None."""
        built, self._built = self._built, None
        self.values = dict(self._wanted)
        return built
