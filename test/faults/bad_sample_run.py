"""
One bad sample of each kind in the running loop, against the undisturbed run.

`python test/faults/bad_sample_run.py [KIND ...] [--page]`; the joints must stay within 0.1 rad of
the undisturbed run, and the payload be back within a standard deviation and 1 % after a second.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any

from faults.local_context import local_context
from faults.page import record
import numpy as np
from ros_loop import RosLoop
from test_nodes_bad_samples import (
    BAD_SAMPLES,
    BETWEEN,
    FIRST,
    spoiled_loop,
    STEP,
    undisturbed,
)

# Bound on the joints' deviation from the undisturbed run, rad.
ANGLE = 0.1


def main() -> int:
    """Print a line per kind; return 1 where a bound was broken."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument('kinds', nargs='*', metavar='KIND')
    options.add_argument('--domain', type=int, default=93)
    options.add_argument('--page', action='store_true', help='write it into docs/faults.md')
    chosen = options.parse_args()
    kinds = chosen.kinds or list(BAD_SAMPLES)
    context = local_context(chosen.domain)
    loop = RosLoop(context)
    joints, payload, _ = spoiled_loop(loop, kinds)
    loop.close()
    run = undisturbed(FIRST + BETWEEN * len(kinds))
    found = {kind: figures(number, joints, payload, run) for number, kind in enumerate(kinds)}
    for kind, (angle, off) in found.items():
        print(f'{kind:32s} joints {angle:.4f} rad, payload {off:.2f} of what is allowed')
    broken = sum(angle > ANGLE or off > 1.0 for angle, off in found.values())
    widest, worst = (max(found, key=lambda kind: found[kind][k]) for k in (0, 1))
    record('bad samples', [
        f'{len(kinds)} kinds: {broken} broke a bound. Joints within {found[widest][0]:.3f} rad of '
        f'the undisturbed run ({widest}); the payload after 1 s off by {found[worst][1]:.2f} of '
        f'what is allowed ({worst}).'], chosen.page)
    return int(broken > 0)


def figures(number: int, joints: dict[int, Any], payload: dict[int, Any], run: Any
            ) -> tuple[float, float]:
    """Return the joints' largest deviation, rad, and the payload's after a second / its bound."""
    rows = range(FIRST + BETWEEN * number, FIRST + BETWEEN * (number + 1))
    angle = max(float(np.abs(np.array(joints[k * STEP].position) - run.output[k, :2]).max())
                for k in rows)
    after, mass = payload[rows.stop * STEP], run.mass[rows.stop]
    allowed = np.sqrt(after.effort[0]) + 0.01 * mass
    return angle, float(abs(after.position[0] - mass) / allowed)


if __name__ == '__main__':
    sys.exit(main())
