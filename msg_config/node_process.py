"""Runs a node as a process: its executor, its end, and the error of a failed start."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import gc
from pathlib import Path
import sys
from typing import Any

from msg_config.contract_node import ContractNode
from msg_config.end_signals import end_on_signal
from msg_config.errors import InputError
from msg_config.quiet_start import CODES, end_at_once
from msg_config.transport import avoid_shared_memory
import rclpy
from rclpy.context import Context
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ROSInterruptException,
)
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import remove_ros_args


def make_executor(context: Context | None = None) -> Executor:
    """Return an EventsExecutor, or the single-threaded executor before ROS 2 Kilted."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


def spin(executor: Executor, stop: Future[Any]) -> None:
    """Run until `stop` is done, with a time-out, without which an EventsExecutor never rests."""
    while not stop.done():
        executor.spin_until_future_complete(stop, timeout_sec=1e6)


def run(make: Callable[[], ContractNode], arguments: Sequence[str] | None = None) -> int:
    """
    Run one node until Ctrl-C, SIGTERM or SIGHUP.

    Parameters
    ----------
    make : callable
        Returns the node.
    arguments : sequence of str, optional
        Command-line arguments, by default those of the process.

    Returns
    -------
    int
        0 after SIGTERM or shutdown, 130 after Ctrl-C, 129 after SIGHUP, 2 for a bad parameter,
        which is named in one line.

    """
    avoid_shared_memory()
    given = list(sys.argv if arguments is None else arguments)
    try:
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # noqa: B902  rclpy's argument errors share no base class
        return _print_error(error)
    interrupts: list[int] = []
    try:
        if _asks_for_help(given):
            return 0
        _spin_one(make, interrupts)
        if interrupts:
            return CODES[interrupts[0]]
    except InputError as error:
        return _print_error(error)
    except (ExternalShutdownException, ROSInterruptException):
        return 0
    except Exception:  # noqa: B902
        # A signal came before the node was complete.
        if rclpy.ok():
            raise
    finally:
        end_at_once()
        rclpy.try_shutdown()
    return 130


def _asks_for_help(given: list[str]) -> bool:
    """
    Print how a node is called if that is asked for; return whether it is.

    Raises
    ------
    InputError
        There is an argument that is not one of ROS, which would change nothing.

    """
    name, *others = remove_ros_args(given) or ['node']
    name = Path(name).name
    if others and others[0] in ('-h', '--help'):
        print(f'usage: {name} [--ros-args [-p PARAMETER:=VALUE ...] [-r FROM:=TO ...]]\n'
              'docs/parameters.md lists the parameters.')
        return True
    if others:
        raise InputError(f'{name}: {others[0]}: expected arguments of ROS alone, as --ros-args '
                         '-p robot:=FILE')
    return False


def _spin_one(make: Callable[[], ContractNode], interrupts: list[int]) -> None:
    """Create a node, run it until it is interrupted, and destroy it."""
    node = _created(make)
    executor = make_executor()
    try:
        executor.add_node(node)
        # The present objects are permanent, so the garbage collector need not visit them again.
        gc.collect()
        gc.freeze()
        end_on_signal(lambda number: _end(number, interrupts, node, executor))
        spin(executor, node.interrupted)
    finally:
        end_at_once()
        # First the executor: the middleware calls it for entities that the node then destroys.
        executor.shutdown()
        node.destroy_node()


def _created(make: Callable[[], ContractNode]) -> ContractNode:
    try:
        return make()
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        # A parameter of rclpy itself, such as use_sim_time.
        raise InputError(str(error)) from None
    except Exception as error:  # noqa: B902
        # The middleware has no security files, or no room for another node; rclpy does not export
        # the class of this error.
        if rclpy.ok() and type(error).__name__ == 'RCLError':
            raise InputError(str(error)) from None
        raise


def _end(number: int, interrupts: list[int], node: ContractNode, executor: Executor) -> None:
    """Note a signal and let the executor return; the node lives on until it is destroyed."""
    interrupts.append(number)
    if not node.interrupted.done():
        node.interrupted.set_result(None)
    executor.wake()


def _print_error(error: Exception) -> int:
    print(' '.join(str(error).split()), file=sys.stderr)
    return 2
