"""
Estimate the payload of arms whose angle sensor of joint 2 has another zero than told.

Clean finite-element arms, parts drawn from their tolerances; the zero is off from the start, in
the controller's loop as well, or slips during the record, in what the estimator reads alone.
Printed, for each size: the share of the samples from 2 s on (after the slip) that are `ok`, that
are `ok` and yet beyond three stated deviations, root mean square and worst of the errors where
`ok`, and at the end the RMSE and the mean half width of the 95 % interval, in % of the payload.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import _truths  # noqa: F401
from flex_payload_estimator.estimators.rpe.estimator import RecursivePredictionError
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
from model_error import rows_of
import numpy as np
from truth.records import draw_case, make_record, Record

# Samples count from here on, s, or from the slip on.
FIRST_S = 2.0
# Deviations beyond which a sample that is `ok` was too sure: 0.3 % of a normal law.
BEYOND = 3.0


def off(seed: int, zero: float, until: float) -> tuple[Record, float]:
    """Return the record, to a time, s, of an arm whose zero is off, rad, and its payload, kg."""
    case = draw_case(None, seed, duration_s=until + 0.05)
    offset = (('angle_offset', {'joint': 2, 'offset': zero}),)
    return make_record(replace(case, effects=offset if zero else ())), case.payload_true


def slipped(record: Record, size: float, at: float) -> Record:
    """Return the record with joint 2's readings shifted, rad, from a time on, s."""
    shift = size * (record.time >= at)
    return replace(record, joint=record.joint + np.outer(shift, (0.0, 1.0)))


def run(seed: int, zero: float, slip: float, at: float, until: float, modes: int) -> Array:
    """Return relative error, relative deviation and whether `ok`, of each sample, (3, N)."""
    record, payload = off(seed, zero, until)
    estimator = RecursivePredictionError(load_robot('reference'), 'assumed_modes', modes)
    answers = [estimator.update(*row) for row in rows_of(slipped(record, slip, at))]
    first = at if slip else FIRST_S
    return np.array([[a.mass / payload - 1.0, a.variance**0.5 / payload, a.status == 'ok']
                     for a in answers if a.time >= first]).T


def report(name: str, found: list[Array], each: bool) -> None:
    """Print a line of runs, (3, N) each."""
    error, deviation, ok = (np.array([one[k] for one in found]) for k in range(3))
    ok = ok > 0.0
    wrong = ok & (np.abs(error) > BEYOND * deviation)
    of_ok = 100.0 * error[ok] if ok.any() else np.full(1, np.nan)
    print(f'{name:18s}{len(found):4d} | ok {100 * ok.mean():5.1f} %, ok and beyond '
          f'{100 * wrong.mean():5.2f} %, worst run {100 * wrong.mean(axis=1).max():5.1f} % | '
          f'RMSE {np.sqrt(np.mean(of_ok**2)):5.2f}, worst {np.abs(of_ok).max():5.2f} % | '
          f'end RMSE {100 * np.sqrt(np.mean(error[:, -1]**2)):5.2f}, '
          f'+- {100 * Z95 * deviation[:, -1].mean():5.2f} %', flush=True)
    if each:
        for e, d, good, bad in zip(error, deviation, ok, wrong):
            print(f'    ok {100 * good.mean():5.1f} beyond {100 * bad.mean():5.1f} %; end '
                  f'{100 * e[-1]:6.2f} +- {100 * d[-1]:5.2f} %')


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--zero', type=float, nargs='*', default=(0.0, 0.05, 0.1, 0.2),
                        help='rad, from the start')
    parser.add_argument('--slip', type=float, nargs='*', default=(0.2,), help='rad')
    parser.add_argument('--at', type=float, default=10.0, help='time of the slip, s')
    parser.add_argument('--until', type=float, default=20.0, help='s')
    parser.add_argument('--runs', type=int, default=10)
    parser.add_argument('--seed', type=int, default=21000, help='first; 64000 judges')
    parser.add_argument('--modes', type=int, default=3)
    parser.add_argument('--jobs', type=int, default=1)
    parser.add_argument('--each', action='store_true')
    options = parser.parse_args()
    cases = [('off by', size, size, 0.0) for size in options.zero] \
        + [('slips by', size, 0.0, size) for size in options.slip]
    seeds = range(options.seed, options.seed + options.runs)
    with get_context('spawn').Pool(options.jobs) as pool:
        for how, size, zero, slip in cases:
            one = partial(run, zero=zero, slip=slip, at=options.at, until=options.until,
                          modes=options.modes)
            report(f'{how} {size:g} rad', list(pool.imap(one, seeds)), options.each)


if __name__ == '__main__':
    main()
