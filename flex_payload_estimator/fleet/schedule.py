"""Distributes log tasks over a Dask cluster; the log of a worker that dies goes to another one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
from typing import Any

from flex_payload_estimator.fleet.log_task import diagnose_and_weigh, LogTask, Row
from flex_plant_sim.quiet_signals import held_back
from msg_config.errors import InputError, LONGEST

# How often a log is tried again after its worker died; Dask's own default.
RETRIES = 3
# Logs submitted per worker: enough that no worker waits, few enough where a hundred thousand logs
# are to be done.
LOGS_PER_WORKER = 2


@contextmanager
def cluster(scheduler: str | None, workers: int) -> Iterator[Any]:
    """
    Yield a client of the scheduler at an address, or of a new cluster on this machine.

    Raises
    ------
    InputError
        Dask is not installed, or no scheduler answers.

    """
    try:
        import dask
        # The table tells of a worker that died; the library's own log does not help the user. Nor
        # does its profiler, which samples every process a hundred times a second.
        dask.config.set({'logging.distributed': 'critical',
                         'distributed.worker.profile.enabled': False})
        from distributed import Client, LocalCluster
        # Workers read their own configuration as they start, this part from the environment.
        before = dask.config.get('distributed.nanny.pre-spawn-environ')
        dask.config.set({'distributed.nanny.pre-spawn-environ': {
            **before, 'DASK_LOGGING__DISTRIBUTED': 'critical'}})
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
        # Dask cannot close a cluster that has half begun, so signals wait.
        with held_back():
            # One thread per worker, because a worker only waits for one process. Any port: the
            # default one is taken where two clusters run, which Dask would warn of.
            local = opened.enter_context(LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address='127.0.0.1:0'))
            client = opened.enter_context(Client(local))
        yield client


def completed_rows(client: Any, tasks: Sequence[LogTask]) -> Iterator[tuple[LogTask, Row]]:
    """Yield every task with its row, in the order in which they are completed."""
    from distributed import as_completed
    waiting, running = iter(tasks), as_completed()
    task_of = {}

    def hand_out(count: int) -> None:
        for _, task in zip(range(count), waiting):
            future = client.submit(diagnose_and_weigh, task, pure=False, retries=RETRIES)
            task_of[future.key] = task
            running.add(future)

    hand_out(LOGS_PER_WORKER * max(1, len(client.scheduler_info()['workers'])))
    for future in running:
        task = task_of.pop(future.key)
        error = future.exception()
        yield task, future.result() if error is None else Row(
            task.arm, task.log, error=f'worker: {" ".join(str(error).split())}'[:LONGEST],
            again=True)
        hand_out(1)
