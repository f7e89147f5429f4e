"""The cluster of flex_fleet: what the library says of itself does not reach the user."""

from __future__ import annotations

import logging
import socket
import subprocess
import sys

CLUSTER = """
import logging
from flex_payload_estimator.fleet.schedule import cluster


def level():
    return logging.getLogger('distributed.worker').getEffectiveLevel()


if __name__ == '__main__':
    with cluster(None, 1) as client:
        print(*client.run(level).values())
"""


def test_a_worker_that_loses_its_scheduler_and_a_second_cluster_are_silent() -> None:
    # A worker may look for its scheduler once more while that closes: a traceback of the library.
    with socket.socket() as busy:
        try:
            busy.bind(('127.0.0.1', 8787))
            busy.listen()
        except OSError:
            pass  # Another cluster has Dask's own port: so much the better.
        done = subprocess.run([sys.executable, '-c', CLUSTER], capture_output=True, text=True,
                              timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, '')
    assert int(done.stdout) == logging.CRITICAL
