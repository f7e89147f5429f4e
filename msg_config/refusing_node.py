"""The part of all nodes that lets no message end them: what does not fit is refused and told."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
import math
import time
from typing import Any

from msg_config.errors import InputError
from msg_config.messages import checked_time
from msg_config.refusals import Refusals
from msg_config.ros import unknown_parameter
import numpy as np
from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter
from rclpy.service import Service
from rclpy.subscription import Subscription
from rosgraph_msgs.msg import Clock

# Least interval of equal warnings, s.
WARNING_INTERVAL = 1.0
# Errors that a message can cause in a computation; any other is an error of the program.
REFUSED = (InputError, ArithmeticError, np.linalg.LinAlgError)


class RefusingNode(LifecycleNode):
    """A lifecycle node that counts what it refuses, and whose parts of rclpy refuse it, too."""

    def __init__(self, name: str, **options: Any):
        self._refusals = Refusals()
        self._warned: dict[str, float] = {}
        super().__init__(name, **options)

    def set_parameters_atomically(self, parameter_list: list[Parameter[Any]],
                                  ) -> SetParametersResult:
        """Set parameters; a name that is none is told, which rclpy's own text leaves out."""
        for parameter in parameter_list:
            if not self.has_parameter(parameter.name):
                return SetParametersResult(successful=False, reason='; '.join(
                    unknown_parameter(self, parameter.name)))
        return super().set_parameters_atomically(parameter_list)

    def create_subscription(self, msg_type: Any, topic: str, callback: Callable[..., None],
                            *arguments: Any, **options: Any) -> Subscription[Any]:
        """
        Subscribe to a topic.

        rclpy's own callback, that of /clock, raises for what is no time: it does not get that.
        """
        def timed(message: Clock) -> None:
            try:
                checked_time(message.clock, '/clock: clock')
            except InputError as error:
                self.reject('/clock', str(error))
            else:
                callback(message)
        return super().create_subscription(
            msg_type, topic, timed if msg_type is Clock else callback, *arguments, **options)

    def create_service(self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any],
                       **options: Any) -> Service[Any, Any]:
        """
        Offer a service that survives any request.

        rclpy's own services, those of parameters, raise if a request holds unexpected values.
        """
        def guarded(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except (*REFUSED, LookupError, TypeError, ValueError) as error:
                self.get_logger().warning(f'{srv_name}: refused: {InputError(error)}')
                return response
        return super().create_service(srv_type, srv_name, guarded, **options)

    def reject(self, topic: str, reason: str, kind: str = 'malformed') -> None:
        """Count an invalid message, and warn."""
        self._refusals.add(topic, kind, reason, time.monotonic())
        self.warn_seldom('refused', f'refused {self.rejected[topic]}: {reason}')

    def warn_seldom(self, about: str, text: str, interval: float = WARNING_INTERVAL) -> None:
        """
        Warn about something at most once in an interval, s.

        rclpy's own throttle looks up the calling file before it counts. If a warning is due at
        every sample, that takes longer than the sample.
        """
        now = time.monotonic()
        if now - self._warned.get(about, -math.inf) >= interval:
            self._warned[about] = now
            self.get_logger().warning(text)

    @property
    def rejected(self) -> Counter[str]:
        """Return the number of messages refused, by topic."""
        return self._refusals.by_topic

    @property
    def last_rejection(self) -> str:
        """Return the reason of the last refusal."""
        return self._refusals.last
