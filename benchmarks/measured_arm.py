"""
Diagnose a measured record and draw what the extended model gains on the part that no fit saw.

`python benchmarks/measured_arm.py --log LOG --robot quanser_2dsfl --picture FILE` makes the
README's picture of the measured arm. Above: the unseen torque of each joint over its speed, with
the law that the extended robot carries. Below: the locked part as measured and as simulated by
commands alone, from one start, before and after.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import sys

from flex_payload_estimator.tools.diagnose import Findings, run
from flex_payload_estimator.tools.diagnose import options as diagnose_options
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.units import CHANNEL_SHOWN
from flex_plant_sim.diagnosis.prediction.free_run import free_run, window_rows
from flex_plant_sim.diagnosis.prediction.latent_view import Finding
from flex_plant_sim.diagnosis.report.figures import AFTER, BEFORE, MEASURED
from flex_plant_sim.tools.log_input import read_logs
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

RECORD = Path(__file__).resolve().parents[2] / 'shared/data/quanser_2dsfl/square_10s.csv'
# Length of the locked part that is drawn, and horizon of the errors in the titles, s. Drawn are
# both joints and the first two gauges.
SECONDS, HORIZON = 5.0, 2.0


def options() -> argparse.Namespace:
    """Return the parsed options."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--log', type=Path, default=RECORD, help='measured record')
    parser.add_argument('--robot', default='quanser_2dsfl', help='robot it is simulated with')
    parser.add_argument('--picture', default=None, help='file to draw to')
    return parser.parse_args()


def diagnosed(log: Path, name: str) -> Findings:
    """Return what flex_diagnose finds in a record."""
    arguments = diagnose_options().parse_args([str(log), '--robot', name])
    robot = load_robot(name)
    logs = read_logs([str(log)], robot, arguments.model, arguments.modes, True)
    return run(logs, replace(robot, sample_time=logs[0].sample_time), arguments,
               lambda label, share: None)


def draw_torque(axis: Axes, finding: Finding) -> None:
    """Draw an unseen torque over the speed of its joint, and its law."""
    series = finding.series
    speed, torque = series.variables['speed'][1], series.value
    every = max(1, speed.size // 3000)
    axis.plot(speed[::every], torque[::every], '.', color=MEASURED, markersize=1, alpha=0.4)
    if finding.law.stated and finding.law.variable == 'speed':
        axis.plot(finding.law.knots, finding.law.values, color=AFTER, linewidth=2)
    axis.set_title(f'{series.site.replace("_", " ")}: torque that the nominal model lacks',
                   loc='left')
    axis.set_xlabel('speed, rad/s')
    axis.set_ylabel('N·m')


def draw_channels(axes: Sequence[Axes], found: Findings) -> None:
    """Draw each channel of the locked part as measured, and as both models run freely."""
    before, after = (models[0] for models in found.predictors)
    first, stop = window_rows(before)
    step = before.base.robot.sample_time
    rows = np.arange(first, min(stop, first + round(SECONDS / step)))
    runs = [free_run(model, np.array([first]), rows.size)[:, 0] for model in (before, after)]
    gains = {g.channel: g.ratio for g in found.gains if g.horizon == HORIZON}
    robot = before.base.robot
    for k, (axis, name, si_unit) in enumerate(zip(axes, robot.output_names, robot.output_units)):
        scale, unit = CHANNEL_SHOWN[si_unit]
        for values, colour, label in zip(runs, (BEFORE, AFTER), ('before', 'after')):
            axis.plot(step * rows, scale * values[:, k], color=colour, label=label)
        axis.plot(step * rows, scale * before.record.output[rows, k], color=MEASURED,
                  linewidth=0.8, linestyle=(0, (3, 1)), label='measured')
        axis.set_title(f'{name.replace("_", " ")}: errors after {HORIZON:g} s '
                       f'{1.0 / gains[name]:.2g} times smaller', loc='left')
        axis.set_xlabel('time, s')
        axis.set_ylabel(unit)
    axes[0].legend(frameon=False, ncols=3)


def draw(path: str, found: Findings) -> None:
    """Draw the picture."""
    figure = Figure(figsize=(11, 8.5), layout='constrained')
    axes = figure.subplots(3, 2)
    for axis, finding in zip(axes[0], found.latent['before'].torques):
        draw_torque(axis, finding)
    draw_channels(axes[1:].ravel(), found)
    for axis in axes.ravel():
        axis.spines[['top', 'right']].set_visible(False)
    figure.savefig(path, dpi=100)


def main() -> int:
    """Print the answer and, if asked, draw the picture."""
    chosen = options()
    if not chosen.log.is_file():
        print(f'{chosen.log.name}: no such record; name one with --log')
        return 0
    found = diagnosed(chosen.log, chosen.robot)
    print(found.diagnosis.sentence)
    for gain in found.gains:
        if gain.horizon == HORIZON:
            print(f'{gain.channel}: errors after {HORIZON:g} s of free run are '
                  f'{1.0 / gain.ratio:.2g} times smaller')
    if chosen.picture:
        draw(chosen.picture, found)
    return 0


if __name__ == '__main__':
    sys.exit(main())
