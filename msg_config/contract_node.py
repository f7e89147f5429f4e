"""What every node of the suite does alike: parameters, guarded topics, diagnostics, main()."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
import gc
import sys
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from msg_config.errors import InputError
from msg_config.messages import diagnostic_array, diagnostic_status
from msg_config.ros import (
    create_publisher,
    create_service,
    create_subscription,
    declare_parameters,
)
import numpy as np
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.context import Context
from rclpy.exceptions import ROSInterruptException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future
from rclpy.timer import Timer

WARNING_INTERVAL = 1.0
DIAGNOSTICS_INTERVAL = 1.0
# What a message can cause in a computation; anything else is a mistake in the program.
Configured = TypeVar('Configured')
REFUSED = (InputError, ArithmeticError, np.linalg.LinAlgError)


class ContractNode(Node):
    """
    A node of the contract: it declares its table, and no message ends it.

    A message that does not fit is rejected, counted by topic, and warned of at most once a
    second. Timers run on the wall clock, simulated time or not.

    Attributes
    ----------
    values : dict
        The parameters, checked.
    rejected : Counter
        Messages rejected, by topic.
    interrupted : Future
        Done after a Ctrl-C inside a callback: raised there, an EventsExecutor would print it.

    """

    def __init__(self, name: str, **options: Any):
        super().__init__(name, **options)
        try:
            self.values: dict[str, Any] = declare_parameters(self, name)
        except InputError:
            self.destroy_node()
            raise
        self.rejected: Counter[str] = Counter()
        self.last_rejection = ''
        self.interrupted: Future[None] = Future()
        self._wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics = self.publisher('diagnostics')

    def configured(self, make: Callable[[], Configured]) -> Configured:
        """Return what the parameters describe; bad ones are named with the node."""
        try:
            return make()
        except InputError as error:
            name = self.get_name()
            self.destroy_node()
            raise InputError(f'{name}: {error}') from None

    def publisher(self, topic: str) -> Publisher:
        """Return a publisher of a topic of the contract."""
        return create_publisher(self, topic)

    def subscribe(self, topic: str, callback: Callable[[Any], None]) -> None:
        """Take messages of a topic of the contract; what raises InputError is rejected."""
        def guarded(message: Any) -> None:
            try:
                self._run(callback, message)
            except REFUSED as error:
                self.reject(topic, str(error))
        create_subscription(self, topic, guarded)

    def offer(self, service: str, callback: Callable[[Any, Any], Any]) -> None:
        """Offer a service of the contract."""
        create_service(self, service, callback)

    def every(self, interval: float, callback: Callable[[], None]) -> Timer:
        """Call back at an interval of wall time, s."""
        return self.create_timer(interval, lambda: self._run(callback), clock=self._wall)

    def _run(self, callback: Callable[..., None], *arguments: Any) -> None:
        try:
            callback(*arguments)
        except (KeyboardInterrupt, Exception) as error:  # noqa: B902
            # rclpy shuts its context down first; compiled code may wrap the Ctrl-C.
            if self.context.ok() and not _by_ctrl_c(error):
                raise
            if not self.interrupted.done():
                self.interrupted.set_result(None)

    def wall_time(self) -> float:
        """Return the wall clock (monotonic), s."""
        return self._wall.now().nanoseconds * 1e-9

    def reject(self, topic: str, reason: str) -> None:
        """Count a message that does not fit, and warn."""
        self.rejected[topic] += 1
        self.last_rejection = reason
        self.get_logger().warning(
            f'rejected {self.rejected[topic]}: {reason}', throttle_duration_sec=WARNING_INTERVAL)

    def input_status(self) -> DiagnosticStatus:
        """Return how many messages were rejected, and the last reason."""
        total = sum(self.rejected.values())
        values = {f'rejected {topic}': count for topic, count in sorted(self.rejected.items())}
        text = f'{total} messages rejected, last: {self.last_rejection}' if total else 'ok'
        return diagnostic_status(f'{self.get_name()}: input', 'warn' if total else 'ok', text,
                                 {'rejected': total, **values})

    def publish_diagnostics(self, stamp: int, statuses: Sequence[DiagnosticStatus]) -> None:
        """Publish statuses, and the one of the input, at a stamp, ns."""
        self._diagnostics.publish(diagnostic_array(stamp, [*statuses, self.input_status()]))


def make_executor(context: Context | None = None) -> Executor:
    """Return an EventsExecutor, or before ROS 2 Kilted the single-threaded one."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def spin(executor: Executor, stop: Future[Any]) -> None:
    """Run until `stop` is done; without a time-out an EventsExecutor would never rest."""
    while not stop.done():
        executor.spin_until_future_complete(stop, timeout_sec=1e6)


def run(make: Callable[[], ContractNode], arguments: Sequence[str] | None = None) -> int:
    """
    Run one node until Ctrl-C or SIGTERM.

    Parameters
    ----------
    make : callable
        Returns the node.
    arguments : sequence of str, optional
        By default those of the process.

    Returns
    -------
    int
        0 after SIGTERM or shutdown, 130 after Ctrl-C (0 where rclpy shuts down before Python
        sees the signal), 2 for a bad parameter, which is named in one line.

    """
    try:
        rclpy.init(args=list(sys.argv if arguments is None else arguments))
    except Exception as error:  # noqa: B902  rclpy's argument errors share no base class
        return _refuse(error)
    node = None
    try:
        node = make()
        executor = make_executor()
        executor.add_node(node)
        # What is there stays: the collector need not look at it again and again.
        gc.collect()
        gc.freeze()
        spin(executor, node.interrupted)
    except InputError as error:
        return _refuse(error)
    except KeyboardInterrupt:
        return 130
    except (ExternalShutdownException, ROSInterruptException):
        return 0
    except Exception:  # noqa: B902
        # A signal before the node was whole.
        if rclpy.ok():
            raise
        return 130
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 130


def _by_ctrl_c(error: BaseException | None) -> bool:
    return error is not None and (
        isinstance(error, KeyboardInterrupt) or _by_ctrl_c(error.__cause__))


def _refuse(error: Exception) -> int:
    print(' '.join(str(error).split()), file=sys.stderr)
    return 2
