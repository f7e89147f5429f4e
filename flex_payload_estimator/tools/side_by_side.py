"""The three estimators on the same samples: `sf1_paper`, `sf1` and `rpe` in one picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flex_payload_estimator.control.loop import LoopRecord
from flex_payload_estimator.estimators.factory import make_estimator
from flex_payload_estimator.tools.estimate import TIMES
from flex_payload_estimator.tools.words import with_uncertainty
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.interval import Z95
from matplotlib.figure import Figure
import numpy as np

WORDS = {'sf1_paper': 'SF1 as the paper prints it', 'sf1': 'SF1 with its errors carried along',
         'rpe': 'recursive prediction error, the default'}
BLUE, GREY = '#1f5fa8', '#707070'


@dataclass(frozen=True)
class Answer:
    """
    What one estimator said over a run.

    Attributes
    ----------
    name, model : str
    modes : int
        A link.
    mass, std : Array
        kg, (N,).
    status : tuple of str
        N.

    """

    name: str
    model: str
    modes: int
    mass: Array
    std: Array
    status: tuple[str, ...]


def answers_on(record: LoopRecord, robot: Robot, chosen: Mapping[str, tuple[str, int]]
               ) -> list[Answer]:
    """
    Return what each estimator says of the samples that the topics carried.

    `rpe` bends in five modes, SF1 in as many as it has gauges on a link; as printed it has the
    paper's reduced model.

    Parameters
    ----------
    record : LoopRecord
        The run.
    robot : Robot
        The estimators', which the plant's need not be.
    chosen : Mapping
        Model and modes where they are to be others.

    """
    gauges = min(len(link.gauge_positions) for link in robot.links)
    usual = {'sf1_paper': ('paper_reduced', gauges), 'sf1': ('assumed_modes', gauges),
             'rpe': ('assumed_modes', 5)}
    return [_answer(record, robot, name, *chosen.get(name, usual[name])) for name in WORDS]


def _answer(record: LoopRecord, robot: Robot, name: str, model: str, modes: int) -> Answer:
    estimator, sent = make_estimator(name, robot, model, modes), np.zeros(2)
    found = []
    for time, output, command in zip(record.time, record.output, record.command):
        found.append(estimator.update(float(time), output, sent))
        sent = command
    return Answer(name, model, modes, np.array([e.mass for e in found]),
                  np.sqrt([e.variance for e in found]), tuple(e.status for e in found))


def table(record: LoopRecord, answers: Sequence[Answer]) -> str:
    """Return the estimates at TIMES and at the end, kg."""
    marks = [int(k) for t in TIMES for k in np.flatnonzero(np.abs(record.time - t) < 1e-6)]
    marks += [] if marks and marks[-1] == len(record.time) - 1 else [len(record.time) - 1]
    lines = ['payload ± one standard deviation']
    for answer in answers:
        lines.append(f'{answer.name:10s} {WORDS[answer.name]} ({answer.model}, '
                     f'n = {answer.modes})')
        lines += [f'    {record.time[k]:5g} s   '
                  f'{with_uncertainty(answer.mass[k], answer.std[k])} kg   {answer.status[k]}'
                  f'{_miss(answer, k, record.true_mass[k])}' for k in marks]
    return '\n'.join(lines)


def _miss(answer: Answer, k: int, true: float) -> str:
    """Say where an estimator is wrong and sure of it."""
    off = abs(answer.mass[k] - true)
    wrong = answer.status[k] == 'ok' and off > Z95 * answer.std[k]
    return f'   outside its 95 % interval, {off:.2g} kg off' if wrong else ''


def draw(record: LoopRecord, answers: Sequence[Answer], path: Path) -> None:
    """Write one panel an estimator: estimate, 95 % interval and truth; faint where not `ok`."""
    figure = Figure(figsize=(10.0, 3.6), layout='constrained')
    panels = figure.subplots(1, len(answers), sharex=True, sharey=True)
    top = 2.5 * max(float(record.true_mass.max()), 1e-3)
    for axes, answer in zip(panels, answers):
        half = Z95 * answer.std
        axes.fill_between(record.time, np.maximum(answer.mass - half, 0.0), answer.mass + half,
                          color=BLUE, alpha=0.2, lw=0, label='95 % interval')
        sure = np.array([status == 'ok' for status in answer.status])
        axes.plot(record.time, answer.mass, ':', color=BLUE, lw=1.0, label='estimate, not `ok`')
        axes.plot(record.time, np.where(sure, answer.mass, np.nan), color=BLUE, lw=1.6,
                  label='estimate, `ok`')
        axes.plot(record.time, record.true_mass, '--', color=GREY, label='true payload')
        axes.set_title(f'{answer.name}: {WORDS[answer.name]}', loc='left', fontsize=9)
        axes.set_xlabel('time / s')
        axes.set_ylim(-0.05 * top, top)
        axes.margins(x=0.0)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel('payload / kg')
    panels[0].legend(fontsize=8, frameon=False, loc='upper right')
    figure.savefig(path, dpi=130)
