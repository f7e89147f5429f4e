"""What latent forces propose: static causes with sizes read off them, the best first."""

from __future__ import annotations

from collections.abc import Iterator

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.latent_view import Finding, LatentView
import numpy as np

# Share of a force's power that a shape must explain to be proposed.
LEAST_SHARE = 0.1
STRIBECK_SPEEDS = (0.03, 0.1, 0.3)
RIPPLES = np.arange(2.0, 60.0, 0.5)
DEAD_SHARES = (0.02, 0.05, 0.1, 0.2, 0.4)

Proposal = tuple[str, tuple[float, ...], float]


def proposals(view: LatentView, robot: Robot) -> dict[str, tuple[float, ...]]:
    """
    Return start values of effects by 'identifier:site', those that explain most first.

    Only forces too large for a model error propose, and only static causes: a torque over speed,
    angle or command, a gauge's error over strain and time.
    """
    found: list[Proposal] = []
    for joint, finding in ((int(f.series.site[-1]) - 1, f) for f in view.torques if f.relevant):
        found += _of_torque(finding, robot.drives[joint].torque_gain)
    for finding in (f for f in view.gauges if f.relevant):
        found += _of_gauge(finding, robot)
    found.sort(key=lambda proposal: -proposal[2])
    return {label: values for label, values, share in found if share > LEAST_SHARE}


def _of_torque(finding: Finding, gain: float) -> Iterator[Proposal]:
    series, site = finding.series, finding.series.site
    judged, torque = series.judged, series.value[series.judged]
    speed, angle, command = (series.variables[name][1][judged]
                             for name in ('speed', 'angle', 'command'))
    sign, one = np.sign(speed), np.ones_like(speed)
    (level,), share = _fit(torque, sign)
    if level < 0.0:
        yield f'coulomb_friction:{site}', (-level,), share
    sides, share = _fit(torque, np.where(speed > 0.0, -1.0, 0.0), np.where(speed < 0.0, 1.0, 0.0))
    if min(sides) >= 0.0:
        yield f'asymmetric_friction:{site}', sides, share
    (size, extra), share, at = max(
        ((*_fit(torque, -sign, -sign * np.exp(-(speed / s)**2)), s) for s in STRIBECK_SPEEDS),
        key=lambda tried: tried[1])
    if size >= 0.0 and extra >= 0.0:
        yield f'stribeck_friction:{site}', (size, extra, at), share
    (slope,), share = _fit(torque, speed)
    yield f'viscous_friction:{site}', (-slope,), share
    (constant,), share = _fit(torque, one)
    yield f'actuator_bias:{site}', (constant / gain,), share
    (more,), share = _fit(torque, gain * command)
    yield f'actuator_gain:{site}', (1.0 + more,), share
    yield _dead_zone(site, torque, gain, command)
    wave, share, order = max(((*_fit(torque, np.sin(k * angle), np.cos(k * angle)), k)
                              for k in RIPPLES), key=lambda tried: tried[1])
    yield f'torque_ripple:{site}', (*wave, float(order)), share


def _dead_zone(site: str, torque: Array, gain: float, command: Array) -> Proposal:
    """Return the half width whose lost torque, -gain clip(u), is nearest."""
    widths = np.max(np.abs(command)) * np.array(DEAD_SHARES)
    left = [np.sum((torque + gain * np.clip(command, -w, w))**2) for w in widths]
    best = int(np.argmin(left))
    return (f'actuator_dead_zone:{site}', (float(widths[best]),),
            1.0 - float(left[best] / np.sum(torque**2)))


def _of_gauge(finding: Finding, robot: Robot) -> Iterator[Proposal]:
    series, site = finding.series, finding.series.site
    columns = {name: x[series.judged] for name, (_, x) in series.variables.items()}
    error = series.value[series.judged]
    (more,), share = _fit(error, columns['strain'])
    yield f'strain_gain:{site}', (1.0 + more,), share
    (constant,), share = _fit(error, np.ones_like(error))
    yield f'strain_bias:{site}', (constant,), share
    (slope,), share = _fit(error, columns['time'])
    yield f'strain_drift:{site}', (slope,), share
    others = [(*_fit(error, columns[name]), number)
              for number, name in enumerate(robot.gauge_names, start=1) if name in columns]
    if others:
        (picked,), share, number = max(others, key=lambda tried: tried[1])
        yield f'strain_crosstalk:{site}', (picked, float(number)), share


def _fit(value: Array, *columns: Array) -> tuple[tuple[float, ...], float]:
    """Return least squares coefficients, and the share of the power they explain."""
    design = np.stack(columns, axis=1)
    found = np.linalg.lstsq(design, value, rcond=None)[0]
    left = float(np.sum((value - design @ found)**2))
    return tuple(float(c) for c in found), 1.0 - left / float(np.sum(value**2))
