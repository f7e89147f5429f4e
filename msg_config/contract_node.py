"""The base class of all nodes: parameters, lifecycle, guarded topics, diagnostics."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from inspect import signature
from pathlib import Path
import time
from typing import Any, TypeVar

from diagnostic_msgs.msg import DiagnosticStatus
from msg_config.changes import Changes
from msg_config.clock_watch import ClockWatch
from msg_config.contract import load_topics
from msg_config.errors import InputError
from msg_config.first_publisher import FirstPublisher, SILENCE
from msg_config.input_mapping import Channels
from msg_config.messages import diagnostic_array, diagnostic_status
from msg_config.refusing_node import REFUSED, RefusingNode
from msg_config.ros import (
    create_publisher,
    create_service,
    create_sourced_subscription,
    declare_parameters,
    interface_class,
    unknown_overrides,
)
from msg_config.wire import MessageReader
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType, ROSClock
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer

# Interval of diagnostics, s, as in diagnostic_updater.
DIAGNOSTICS_INTERVAL = 1.0
# Interval of the markers of the arm, s: a film has 24 images per second.
MARKER_INTERVAL = 0.04
Configured = TypeVar('Configured')
SECOND = 'second publisher'
NO_ARGUMENT = signature(lambda: None)


class ContractNode(RefusingNode, ABC):
    """
    A node of the contract, which declares its table of parameters and survives any message.

    An invalid message is refused, counted by topic and kind, and reported by a warning at most
    once per second; so is a message of a second publisher, and a call of a timer that meets an
    error of arithmetic. Timers use the wall clock, even with simulated time. Parameters change as
    their table says: at once, at ~/reset, or not at all. As a lifecycle node it takes messages
    only while it is active, which it is from the start unless autostart is false.

    Subclasses define `build` and `install`, and `on_live` if a parameter is live.

    Attributes
    ----------
    values : Mapping
        The parameters in force, checked.
    waited : float
        Time that the present message has waited to be taken, s.
    interrupted : Future
        Done when the process is asked to end, and after a Ctrl-C inside a callback, where an
        EventsExecutor would print an exception.

    """

    def __init__(self, name: str, **options: Any):
        self.active = False
        super().__init__(name, **options)
        try:
            self.values: dict[str, Any] = declare_parameters(self, name)
        except InputError:
            self.destroy_node()
            raise
        self._heard, self.waited = FirstPublisher(), 0.0
        self.clock_watch = ClockWatch(DIAGNOSTICS_INTERVAL)
        self._parameter_changes = Changes(name, self.values)
        self._subscribed: dict[str, Subscription[Any]] = {}
        self._polled: set[str] = set()
        self.interrupted: Future[None] = Future()
        self._wall = Clock(clock_type=ClockType.STEADY_TIME)
        self._diagnostics = self.publisher('/diagnostics')
        self.hardware = Path(str(self.values['robot'])).stem
        self.configured(lambda: self.install(self.build(self.values)))
        self.add_on_set_parameters_callback(self._on_set)

    def destroy_node(self) -> None:
        """
        Destroy the node, which ceases first, and the services of its lifecycle.

        rclpy leaves them to the state machine, which lives on in cycles of references: until the
        garbage collector came by, the node would stay in the graph.
        """
        if self.context.ok():
            self._pause()
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def bring_up(self) -> None:
        """Name parameters that are none, and become active if autostart is true."""
        for line in unknown_overrides(self):
            self.get_logger().warning(line)
        if self.values['autostart']:
            self.trigger_configure()
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin as at the start, with the parameters as they were set."""
        self.start_over()
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start taking messages."""
        for topic in self._polled:
            self.take_waiting(topic)  # it is dropped, because it came before the activation
        self.active = True
        self.begin()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop taking messages."""
        self._pause()
        return super().on_deactivate(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop taking messages for good."""
        self._pause()
        return super().on_shutdown(state)

    def _pause(self) -> None:
        if self.active:
            self.active = False
            self.cease()

    def begin(self) -> None:
        """Act when the node becomes active; subclasses may override it."""

    def cease(self) -> None:
        """Act when the node becomes inactive; subclasses may override it."""

    @abstractmethod
    def build(self, values: dict[str, Any]) -> Any:
        """Return what the parameters describe, without side effects; raise InputError if bad."""

    @abstractmethod
    def install(self, built: Any) -> None:
        """Use from now on what `build` returned."""

    def on_live(self, changed: dict[str, Any]) -> None:
        """Apply changed live parameters; an InputError refuses them."""

    def start_over(self) -> None:
        """Be as at the start; subclasses forget what they know."""
        self.begin_again()

    def begin_again(self) -> None:
        """Put in force the changes that wait for a reset."""
        waiting = self._parameter_changes.take()
        if waiting is not None:
            self.values = self._parameter_changes.values
            self.install(waiting)

    def _on_set(self, parameters: Sequence[Any]) -> SetParametersResult:
        try:
            later, live = self._parameter_changes.sort(parameters)
            prepared = self._parameter_changes.prepare(live, later, self.build)
            if live:
                self.on_live(live)
        except REFUSED as error:
            return SetParametersResult(successful=False, reason=f'{self.get_name()}: {error}')
        self.values = self._parameter_changes.accept(live, later, prepared)
        if later:
            # ROS drops the reason of a success, so it is logged; the diagnostics report it too.
            self.get_logger().info('; '.join(self._parameter_texts()) or 'no change waits')
        return SetParametersResult(successful=True)

    def configured(self, make: Callable[[], Configured]) -> Configured:
        """Return what `make` makes of the parameters; an error names the node."""
        try:
            return make()
        except REFUSED as error:
            name = self.get_name()
            self.destroy_node()
            raise InputError(f'{name}: {error}') from None

    def publisher(self, topic: str) -> Publisher:
        """Return a publisher of a topic of the contract."""
        return create_publisher(self, topic)

    @property
    def subscriptions(self) -> Iterator[Subscription[Any]]:
        """Return the subscriptions whose messages wake the executor."""
        polled = [self._subscribed.get(topic) for topic in self._polled]
        return (each for each in super().subscriptions if each not in polled)

    def take_waiting(self, topic: str) -> None:
        """Take the messages that wait on a polled topic."""
        subscription = self._subscribed[topic]
        take, kind = subscription.handle.take_message, subscription.msg_type
        while (taken := take(kind, subscription.raw)) is not None:
            subscription.callback(taken)  # type: ignore[call-arg, arg-type]

    def subscribe(self, topic: str, callback: Callable[[Any], None], *, polled: bool = False,
                  names: Callable[[], Channels] | None = None) -> None:
        """
        Take messages of a topic of the contract; those for which InputError is raised are refused.

        With `polled`, messages wait for `take_waiting`, because waking up for each of them costs
        as much as sending it. With `names`, another publisher's messages that name none of these
        channels are of another device and ignored, as in bags, while one speaks that names some.
        """
        own = load_topics()[topic]
        # A publisher sends the same names with every sample, so only the numbers need be read.
        exclusive, kind = own.exclusive, interface_class(own.type)
        read, read_other = MessageReader(kind, topic), MessageReader(kind, topic)

        def guarded(message: Any, gid: bytes | None, waited: float) -> None:
            if not self.active:
                return
            self.waited, now = waited, time.monotonic()
            kept = self._heard.is_kept(topic, gid)
            reader = read if kept else read_other
            try:
                given = reader(message) if isinstance(message, bytes) else message
                ours = names is None or names().name_any(given.name)
                if not (ours or kept) and self._heard.speaks(topic, now):
                    return
                if ours and exclusive and not self._heard.hears(topic, gid, now):
                    self.reject(topic, f'{topic}: expected one publisher, got a message of a '
                                       'second one; the first is kept', SECOND)
                    return
                # What is not ours and of the one who is heard, or the only one, lacks our names.
                self._run(callback, given)
            except REFUSED as error:
                self.reject(topic, str(error))
        if polled:
            self._polled.add(topic)
        self._subscribed[topic] = create_sourced_subscription(self, topic, guarded, raw=exclusive)

    def offer(self, service: str, callback: Callable[[Any, Any], Any]) -> None:
        """Offer a service of the contract."""
        create_service(self, service, callback)

    def every(self, interval: float, callback: Callable[[], None], *, always: bool = False,
              ) -> Timer:
        """Call back at an interval of wall time, s, while the node is active, or `always`."""
        def due() -> None:
            try:
                if self.active or always:
                    self._run(callback)
            except REFUSED as error:
                self.reject('timer', f'timer: {error}')
        # rclpy inspects at every call whether the callback takes an argument; a stored signature
        # makes this fast.
        due.__signature__ = NO_ARGUMENT  # type: ignore[attr-defined]
        return self.create_timer(interval, due, clock=self._wall)

    def _run(self, callback: Callable[..., None], *arguments: Any) -> None:
        try:
            callback(*arguments)
        except (KeyboardInterrupt, Exception) as error:  # noqa: B902
            # On a Ctrl-C rclpy shuts its context down first; compiled code may wrap the exception.
            if self.context.ok() and not _by_ctrl_c(error):
                raise
            if not self.interrupted.done():
                self.interrupted.set_result(None)

    def wall_time(self) -> float:
        """Return the wall clock (monotonic), s."""
        return time.monotonic()

    def task(self, name: str) -> str:
        """Return a task's name as diagnostic tools expect it, with the namespace if any."""
        return f'{self.get_fully_qualified_name().lstrip("/")}: {name}'

    def status(self, task: str, level: str, text: str, values: dict[str, object],
               ) -> DiagnosticStatus:
        """Return the status of a task of this node."""
        return diagnostic_status(self.task(task), level, text, values, self.hardware)

    def input_status(self) -> DiagnosticStatus:
        """Return the recent refusals by topic and kind, and the last reason."""
        return self.status('input', *self._refusals.summary(time.monotonic()))

    def hear_for(self, silence: float) -> None:
        """Take another publisher of a topic after such a silence, s, at least SILENCE."""
        self._heard.silence = max(SILENCE, silence)

    def second_heard(self) -> set[str]:
        """Return the topics on which a second publisher has sent messages recently."""
        return self._refusals.recent_topics(SECOND, time.monotonic())

    def publisher_status(self) -> DiagnosticStatus:
        """Return whether each topic that is heard or published here has one publisher."""
        heard, names = self.second_heard(), {own.topic_name for own in self.publishers}
        exclusive = {topic: self.resolve_topic_name(topic)
                     for topic, own in load_topics().items() if own.exclusive}
        own = {topic for topic, name in exclusive.items() if name in names}
        counts = {topic: self.count_publishers(name) for topic, name in exclusive.items()
                  if topic in self._subscribed or topic in own}
        values: dict[str, object] = {f'publishers of {topic}': count
                                     for topic, count in counts.items()}
        crowded = {topic for topic, count in counts.items() if count > 1}
        if not heard and not crowded:
            return self.status('publishers', 'ok', 'ok', values)
        text = '; '.join(
            f'{counts[topic]} publishers of {topic}' + (
                ', this node and others' if topic in own
                else ', only the first is heard' if topic in heard else ', one speaks')
            for topic in counts if topic in heard | crowded)
        return self.status('publishers', 'error' if heard or own & crowded else 'warn', text,
                           values)

    def parameter_status(self) -> DiagnosticStatus:
        """Return the status of parameters that wait for a reset, or change nothing."""
        timeless = self._clock_text()
        level = 'warn' if timeless or self._parameter_changes.unused else 'ok'
        texts = [timeless, *self._parameter_texts()]
        return self.status('parameters', level, '; '.join(filter(None, texts)) or 'ok', {})

    def _clock_text(self) -> str:
        own = self.get_clock()
        if not (isinstance(own, ROSClock) and own.ros_time_is_active):
            return ''
        return self.clock_watch(own.now().nanoseconds, time.monotonic())

    def _parameter_texts(self) -> list[str]:
        changes = self._parameter_changes
        waiting = [f'{", ".join(changes.waiting)}: in force after ~/reset'] \
            if changes.waiting else []
        return [*waiting, *changes.unused]

    def publish_diagnostics(self, statuses: Sequence[DiagnosticStatus]) -> None:
        """Publish statuses together with those of input, publishers and parameters."""
        stamp = self.get_clock().now().nanoseconds
        self._diagnostics.publish(diagnostic_array(
            stamp, [*statuses, self.input_status(), self.publisher_status(),
                    self.parameter_status()]))


def _by_ctrl_c(error: BaseException | None) -> bool:
    return error is not None and (
        isinstance(error, KeyboardInterrupt) or _by_ctrl_c(error.__cause__))
