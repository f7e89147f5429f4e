"""
One bad sample of each kind in the running loop, against the undisturbed run.

`python test/faults/bad_sample_run.py [KIND ...]`; the joints must stay within 0.1 rad of the
undisturbed run, and the payload be back within a standard deviation and 1 % after a second.
"""

from __future__ import annotations

import os
import sys

import numpy as np
import rclpy
from rclpy.context import Context
from ros_loop import RosLoop
from test_nodes_bad_samples import (
    BAD_SAMPLES,
    BETWEEN,
    FIRST,
    spoiled_loop,
    STEP,
    undisturbed,
)


def main() -> int:
    """Print a line a kind; return 1 where a bound was broken."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = Context()
    rclpy.init(context=context, domain_id=93)
    kinds = sys.argv[1:] or list(BAD_SAMPLES)
    loop = RosLoop(context)
    joints, payload, _ = spoiled_loop(loop, kinds)
    loop.close()
    record = undisturbed(FIRST + BETWEEN * len(kinds))
    broken = 0
    for number, kind in enumerate(kinds):
        rows = range(FIRST + BETWEEN * number, FIRST + BETWEEN * (number + 1))
        angle = max(np.abs(np.array(joints[k * STEP].position) - record.output[k, :2]).max()
                    for k in rows)
        after = payload[(rows[-1] + 1) * STEP]
        off = abs(after.position[0] - record.mass[rows[-1] + 1])
        bad = angle > 0.1 or off > np.sqrt(after.effort[0]) + 0.01 * record.mass[rows[-1] + 1]
        broken += bad
        print(f'{kind:32s} joints {angle:.4f} rad, payload {off:.5f} kg '
              f'(sigma {np.sqrt(after.effort[0]):.5f}){"  BROKEN" if bad else ""}')
    print(f'{broken} of {len(kinds)} broke a bound')
    return int(broken > 0)


if __name__ == '__main__':
    sys.exit(main())
