"""The set-points in force: those of the parameters until a trajectory comes."""

from __future__ import annotations

from collections.abc import Callable

from flex_payload_estimator.control.set_points import constant, SetPoints
from flex_plant_sim.arm.second_order import Array

# Set-points until now, rad, (2,), and the time of the measurements, s, None where none come,
# to the set-points that a message asks for; raises InputError where it asks for none.
Read = Callable[[Array, float | None], SetPoints]


class Reference:
    """
    Set-points that messages replace.

    Only measurements tell the time that a message is to be read by: one that comes while there are
    none is read again with the next of them, and may then be refused after all.

    Attributes
    ----------
    set_points : SetPoints
        In force.
    given : bool
        Whether they come from a message.

    """

    def __init__(self) -> None:
        self.given = False
        self.set_points: SetPoints = constant(0.0, 0.0)
        self._early: tuple[Read, SetPoints, bool] | None = None

    def default(self, set_points: SetPoints) -> None:
        """Put set-points in force where no message has given any."""
        if not self.given:
            self.set_points = set_points

    def take(self, read: Read, now: float | None) -> None:
        """
        Put in force what a message asks for.

        Parameters
        ----------
        read : Callable
            Reads the message.
        now : float or None
            Time of the last measurement, s; None where none come.

        Raises
        ------
        InputError
            As `read`; the set-points stay.

        """
        former = self._early[1:] if self._early else (self.set_points, self.given)
        self.set_points = read(self.set_points(now or 0.0), now)
        self.given, self._early = True, (read, *former) if now is None else None

    def begin(self, now: float) -> None:
        """
        Read again what came while there was no measurement; the next is of time `now`, s.

        Raises
        ------
        InputError
            As the message's `read`; the set-points are those before it.

        """
        if self._early is not None:
            (read, self.set_points, self.given), self._early = self._early, None
            self.take(read, now)

    def hold(self, asked: Array) -> None:
        """Ask for the same, rad, (2,), from now on, in place of a message that was obeyed."""
        # A trajectory has its times; where time has leapt it would be driven once more.
        if self._early is not None:
            read, former, given = self._early
            self._early = read, constant(*asked) if given else former, given
        elif self.given:
            self.set_points = constant(*asked)
