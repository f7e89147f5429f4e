"""The logs over the workers of a Dask cluster; a worker may die, its log is done by another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
from typing import Any

from flex_payload_estimator.fleet.log_task import answer, LogTask, Row
from flex_plant_sim.quiet_signals import held_back
from msg_config.errors import InputError

# So many workers may die over a log before it is given up: dask's own default.
DEATHS = 3
# Logs handed out for each worker: enough that none waits, few enough for a hundred thousand.
AHEAD = 2


@contextmanager
def cluster(scheduler: str | None, workers: int) -> Iterator[Any]:
    """
    Yield a client of the scheduler at an address, or of a cluster on this machine.

    Raises
    ------
    InputError
        Dask is not installed, or no scheduler answers.

    """
    try:
        import dask
        # A worker that dies is told in the table; the library's own account helps nobody.
        # Nor does its profile, which looks at every process a hundred times a second.
        dask.config.set({'logging.distributed': 'critical',
                         'distributed.worker.profile.enabled': False})
        from distributed import Client, LocalCluster
    except ImportError:
        raise InputError('flex_fleet: expected Dask distributed, not installed: '
                         "pip install 'flex_payload[fleet]'") from None
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout='10s')
        except (OSError, ValueError) as error:
            raise InputError(f'--scheduler: expected a Dask scheduler at {scheduler}, got: '
                             f'{error}') from None
        with client:
            yield client
        return
    with ExitStack() as opened:
        # Dask cannot close what has half begun.
        with held_back():
            # One thread a worker: what a worker does is wait for one process.
            local = opened.enter_context(LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address=None))
            client = opened.enter_context(Client(local))
        yield client


def answers(client: Any, tasks: Sequence[LogTask]) -> Iterator[tuple[LogTask, Row]]:
    """Yield every task with its row, as they come."""
    from distributed import as_completed
    waiting, running = iter(tasks), as_completed()
    task_of = {}

    def hand_out(count: int) -> None:
        for _, task in zip(range(count), waiting):
            future = client.submit(answer, task, pure=False, retries=DEATHS)
            task_of[future.key] = task
            running.add(future)

    hand_out(AHEAD * max(1, len(client.scheduler_info()['workers'])))
    for future in running:
        task = task_of.pop(future.key)
        error = future.exception()
        yield task, future.result() if error is None else Row(
            task.arm, task.log, error=f'worker: {" ".join(str(error).split())}'[:300])
        hand_out(1)
