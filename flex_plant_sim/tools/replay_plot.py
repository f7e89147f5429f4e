"""The plot of flex_replay: measured and simulated channels, and their difference."""

from __future__ import annotations

import math
from pathlib import Path

from flex_plant_sim.arm.units import CHANNEL_SHOWN
from flex_plant_sim.atomic_file import image_metadata, whole_file
from flex_plant_sim.simulation.replay import Replay


def fit_text(fit: float) -> str:
    """Return a fit as text; a channel that does not move has none."""
    return 'channel at rest' if math.isnan(fit) else f'fit {fit:.1f} %'


def write_plot(path: str | Path, result: Replay) -> None:
    """
    Plot every channel, measured and simulated on the left, their difference on the right.

    Raises
    ------
    InputError
        Nothing can be written there.

    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    log, count = result.log, len(result.units)
    figure = Figure(figsize=(14.0, 2.0 * count + 0.8), layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.subplots(count, 2, sharex=True, width_ratios=(3, 2))
    columns = zip(log.output_names, result.units, result.fit_percent, result.rmse,
                  log.output.T, result.simulated.T, axes)
    for name, unit, fit, error, measured, simulated, (left, right) in columns:
        scale, shown = CHANNEL_SHOWN[unit]
        left.plot(log.time, scale * measured, color='tab:blue', linewidth=1.4, label='measured')
        left.plot(log.time, scale * simulated, color='tab:orange', linewidth=0.8,
                  label='simulated')
        right.plot(log.time, scale * (measured - simulated), color='tab:red', linewidth=0.8)
        left.set_ylabel(f'{name}, {shown}')
        left.set_title(fit_text(fit), loc='right', fontsize='small')
        right.set_title(f'residual, RMSE {scale * error:.3g} {shown}', loc='right',
                        fontsize='small')
        for axis in (left, right):
            axis.grid(alpha=0.3)
            axis.margins(x=0.01)
    axes[0, 0].legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize='small')
    for axis in axes[-1]:
        axis.set_xlabel('time, s')
    arm = result.arm
    figure.suptitle(f'{Path(log.source).name}: {arm.robot.name}, {arm.model_name}, '
                    f'{arm.modes} modes, {arm.payload:.4g} kg')
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=100, metadata=image_metadata(path))
