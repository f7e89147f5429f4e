"""The three estimators on the samples of flex_demo: `sf1_paper`, `sf1` and `rpe` side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flex_payload_estimator.colours import BLUE, GREY
from flex_payload_estimator.control.loop import LoopRecord
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.tools.estimate import TIMES
from flex_payload_estimator.tools.experiment import RPE_MODES
from flex_payload_estimator.tools.words import with_uncertainty
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
from matplotlib.figure import Figure
from msg_config.errors import InputError
import numpy as np

DESCRIPTIONS = {
    'sf1_paper': 'SF1 as the paper prints it', 'sf1': 'SF1 with its errors carried along',
    'rpe': 'recursive prediction error, the default'}


@dataclass(frozen=True)
class EstimatorRun:
    """
    The estimates of one estimator over a record.

    Attributes
    ----------
    name, model : str
        Of the estimator.
    modes : int
        Modes per link.
    mass, std : Array
        Payload and its standard deviation, kg, (N,).
    status : tuple of str
        The estimator's status, N.

    """

    name: str
    model: str
    modes: int
    mass: Array
    std: Array
    status: tuple[str, ...]


def run_estimators(record: LoopRecord, robot: Robot, chosen: Mapping[str, tuple[str, int]]
                   ) -> tuple[list[EstimatorRun], list[str]]:
    """
    Return the estimates of all three estimators on a record; and why any is left out.

    `rpe` has RPE_MODES per link, SF1 as many as there are gauges on a link; `sf1_paper` has the
    paper's reduced model.

    Parameters
    ----------
    record : LoopRecord
        The recorded samples.
    robot : Robot
        The estimators' robot, which need not be the plant's.
    chosen : Mapping
        Model and modes per link of estimators, by name, that are to differ from these.

    """
    gauges = max(1, min(len(link.gauge_positions) for link in robot.links))
    usual = {'sf1_paper': ('paper_reduced', gauges), 'sf1': ('assumed_modes', gauges),
             'rpe': ('assumed_modes', RPE_MODES)}
    runs, left_out = list[EstimatorRun](), list[str]()
    for name in DESCRIPTIONS:
        try:
            runs.append(_run(record, robot, name, *chosen.get(name, usual[name])))
        except InputError as error:
            left_out.append(f'{name} is left out: {error}')
    return runs, left_out


def _run(record: LoopRecord, robot: Robot, name: str, model: str, modes: int) -> EstimatorRun:
    """Return the estimates of one estimator on a record."""
    estimator, sent = make_estimator(name, robot, model, modes), np.zeros(2)
    found = []
    for time, output, command in zip(record.time, record.output, record.command):
        found.append(estimator.update(float(time), output, sent))
        sent = command
    return EstimatorRun(name, model, modes, np.array([e.mass for e in found]),
                        np.sqrt([e.variance for e in found]), tuple(e.status for e in found))


def runs_table(record: LoopRecord, runs: Sequence[EstimatorRun]) -> str:
    """Return a table of the estimates at TIMES and at the end, kg."""
    marks = [int(k) for t in TIMES for k in np.flatnonzero(np.abs(record.time - t) < 1e-6)]
    marks += [] if marks and marks[-1] == len(record.time) - 1 else [len(record.time) - 1]
    lines = ['payload ± one standard deviation']
    for run in runs:
        lines.append(f'{run.name:10s} {DESCRIPTIONS[run.name]} ({run.model}, '
                     f'n = {run.modes})')
        lines += [f'    {record.time[k]:5g} s   '
                  f'{with_uncertainty(run.mass[k], run.std[k])} kg   {run.status[k]}'
                  f'{_overconfidence(run, k, record.true_mass[k])}' for k in marks]
    return '\n'.join(lines)


def _overconfidence(run: EstimatorRun, k: int, true: float) -> str:
    """Return a note where an estimate is `ok` but its 95 % interval misses the truth, kg."""
    off = abs(run.mass[k] - true)
    wrong = run.status[k] == 'ok' and off > Z95 * run.std[k]
    return f'   outside its 95 % interval, {off:.2g} kg off' if wrong else ''


def draw_runs(record: LoopRecord, runs: Sequence[EstimatorRun], path: Path) -> None:
    """Write a picture: per estimator estimate, 95 % interval and truth; dotted where not `ok`."""
    figure = Figure(figsize=(10.0, 3.6), layout='constrained')
    panels = figure.subplots(1, len(runs), sharex=True, sharey=True, squeeze=False)[0]
    top = 2.5 * max(float(record.true_mass.max()), 1e-3)
    for axes, run in zip(panels, runs):
        half = Z95 * run.std
        axes.fill_between(record.time, np.maximum(run.mass - half, 0.0), run.mass + half,
                          color=BLUE, alpha=0.2, lw=0, label='95 % interval')
        sure = np.array([status == 'ok' for status in run.status])
        axes.plot(record.time, run.mass, ':', color=BLUE, lw=1.0, label='estimate, not `ok`')
        axes.plot(record.time, np.where(sure, run.mass, np.nan), color=BLUE, lw=1.6,
                  label='estimate, `ok`')
        axes.plot(record.time, record.true_mass, '--', color=GREY, label='true payload')
        axes.set_title(f'{run.name}: {DESCRIPTIONS[run.name]}', loc='left', fontsize=9)
        axes.set_xlabel('time / s')
        axes.set_ylim(-0.05 * top, top)
        axes.margins(x=0.0)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel('payload / kg')
    panels[0].legend(fontsize=8, frameon=False, loc='upper right')
    figure.savefig(path, dpi=130)
