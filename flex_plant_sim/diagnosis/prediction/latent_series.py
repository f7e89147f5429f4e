"""
Latent forces with the variables that they may depend on, in the form in which laws are fitted.

It stands between `latent_forces` and `law`.
"""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.prediction.latent_forces import LatentForces
from flex_plant_sim.diagnosis.prediction.law import CONSTANT, LatentSeries, TIME
import numpy as np
from numpy.typing import NDArray

# Speed below which a joint counts as at rest, as a share of its rms speed. At rest, dry friction
# takes any value within its limits.
REST_SPEED_SHARE = 0.1
# Characters of a gauge's name that name its link.
LINK_PREFIX = len('strain_1')
# Unit of a command: rad/s, A or V, as its drive takes it.
COMMAND_UNIT = "drive's own unit"
# Names of the commands as variables of a gauge's error.
COMMANDS = ('command_1', 'command_2')
# Share of the record in which a joint has to move for a law to be fitted.
MIN_MOVING_SHARE = 0.1


def torque_series(found: Sequence[LatentForces], robot: Robot) -> tuple[LatentSeries, ...]:
    """Return the latent torque of each joint that moves, all records in sequence."""
    series = []
    for j in range(2):
        speed = _joined([f.speed[:, j] for f in found])
        scored = _scored(found) & (np.abs(speed) > REST_SPEED_SHARE * np.sqrt(np.mean(speed**2)))
        variables = {
            'speed': ('rad/s', speed), 'angle': ('rad', _joined([f.angle[:, j] for f in found])),
            'command': (COMMAND_UNIT, _joined([f.command[:, j] for f in found])),
            TIME: ('s', _joined([f.time for f in found]))}
        if robot.links[j].gauge_positions:
            variables['load'] = ('N m', _joined([f.load[:, j] for f in found]))
        drive = np.sqrt(np.mean([f.drive[j]**2 for f in found]))
        series.append(LatentSeries(
            f'joint_{j + 1}', 'N m', _joined([f.torque[:, j] for f in found]),
            _joined([f.torque_deviation[:, j] for f in found]), variables, scored,
            float(DiscrepancyModel.torque_share[j] * drive)))
    return tuple(s for s in series if s.scored.sum() > MIN_MOVING_SHARE * len(s.scored))


def gauge_series(found: Sequence[LatentForces], robot: Robot) -> tuple[LatentSeries, ...]:
    """Return the latent error of each gauge, all records in sequence."""
    names, series = robot.gauge_names, []
    strain = np.vstack([f.strain for f in found])
    rate = np.vstack([np.gradient(f.strain, f.time, axis=0) for f in found])
    # A drive's cable may reach a gauge's.
    commands = {name: (COMMAND_UNIT, _joined([f.command[:, j] for f in found]))
                for j, name in enumerate(COMMANDS)}
    for g, name in enumerate(names):
        # Gauges on the same link read nearly the same and are no separate variables.
        others = {other: ('m/m', strain[:, k]) for k, other in enumerate(names)
                  if other[:LINK_PREFIX] != name[:LINK_PREFIX]}
        variables = {'strain': ('m/m', strain[:, g]), 'strain rate': ('m/m/s', rate[:, g]),
                     **others, **commands, TIME: ('s', _joined([f.time for f in found]))}
        series.append(LatentSeries(
            name, 'm/m', _joined([f.gauge[:, g] for f in found]),
            _joined([f.gauge_deviation[:, g] for f in found]), variables, _scored(found),
            float(DiscrepancyModel.gauge_share * np.std(strain[:, g])), (CONSTANT, 'strain'),
            found[0].gauge_time / float(found[0].time[1] - found[0].time[0])))
    return tuple(series)


def _joined(parts: Sequence[Array]) -> Array:
    return np.concatenate(parts)


def _scored(found: Sequence[LatentForces]) -> NDArray[np.bool_]:
    """Return True in the samples of each record that laws are fitted to, (N,)."""
    rows = [np.arange(len(f.time)) for f in found]
    return np.concatenate([(r >= f.first) & (r < f.stop) for r, f in zip(rows, found)])
