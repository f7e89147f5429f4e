"""
Check rpe's 95 % band in the demo's closed loop, on arms that bend in more modes than it knows.

Each arm has its parts drawn from the robot file's tolerances. The LQG controller moves it by small
steps, and rpe, told the file's parts and fewer modes, weighs it. Prints error over stated standard
deviation at each time. Seeds 10 to 15 set the model error of `rough` in estimators/rpe/modes.py;
10 to 22 may set PERSISTENT_ERROR in estimators/rpe/filter_step.py; from 24 on they score.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import tempfile

from flex_payload_estimator.control.loop import run_loop
from flex_payload_estimator.nodes.node_setup import controller_of, estimator_of, set_points_of
from flex_payload_estimator.tools import demo
from flex_payload_estimator.tools.experiment import drawn_arm, Experiment
from flex_plant_sim.interval import Z95
from flex_plant_sim.simulation.plant_setup import simulator_of
import numpy as np


def weighed(seed: int, modes: int, told: int, times: Sequence[float], folder: Path
            ) -> list[tuple[float, float]]:
    """Return error and standard deviation at some times, s, relative to the payload."""
    options = demo.options_of(['--seed', str(seed), '--duration', str(times[-1])])
    experiment = Experiment.of(options, drawn_arm(options, folder / 'arm.yaml'))
    record = run_loop(simulator_of({**experiment.plant, 'modes': modes}),
                      estimator_of({**experiment.estimator, 'modes': told}),
                      controller_of(experiment.controller), set_points_of(experiment.controller),
                      experiment.duration)
    rows = np.searchsorted(record.time, np.array(times) - 1e-9)
    return [(record.mass[k] / record.true_mass[k] - 1.0,
             record.variance[k]**0.5 / record.true_mass[k]) for k in rows]


def main() -> None:
    """Print a line per seed, and the root mean square of error over deviation."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--first', type=int, default=20, help='first seed')
    parser.add_argument('--runs', type=int, default=4)
    parser.add_argument('--modes', type=int, default=8, help='of the arm')
    parser.add_argument('--told', type=int, default=3, help='modes that rpe is told')
    parser.add_argument('--times', type=float, nargs='+', default=[1.0, 3.0, 6.0, 10.0], help='s')
    arguments = parser.parse_args()
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(arguments.first, arguments.first + arguments.runs):
            found.append(weighed(seed, arguments.modes, arguments.told,
                                 arguments.times, Path(folder)))
            print(seed, *(f'{t:g} s: {100 * e:+.1f} ± {100 * s:.1f} %'
                          for t, (e, s) in zip(arguments.times, found[-1])), flush=True)
    error, deviation = np.moveaxis(np.array(found), -1, 0)
    z = error / deviation
    print('rms of error over deviation', np.round(np.sqrt((z**2).mean(axis=0)), 2),
          'covered', (np.abs(z) < Z95).mean(axis=0))


if __name__ == '__main__':
    main()
