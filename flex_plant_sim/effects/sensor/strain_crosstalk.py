"""Strain crosstalk: a gauge's amplifier picks up another gauge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.gauge import gauge_row
from flex_plant_sim.effects.parameter import Parameter
from msg_config.errors import InputError
import numpy as np


class StrainCrosstalk(Effect):
    """One gauge also reads a share of the strain of another."""

    identifier = 'strain_crosstalk'
    family = 'sensors'
    explanation = 'The gauge {site} picks up a share of another gauge, the source.'
    parameters = (
        Parameter('share', '', 0.0, -1.0, 1.0, (-0.12, 0.12), 0.03, 0.1),
        Parameter('source', '', 1.0, 1.0, 64.0, (1.0, 2.0, 3.0, 4.0), np.inf, 1.5, discrete=True,
                  meaning='the number of a gauge, counted from 1 as the robot file lists them'))
    sites = 'gauge'
    linear = True

    @classmethod
    def at(cls, site: str, robot: Robot) -> tuple[Parameter, ...]:
        """Return the parameters; a gauge picks up one of the robot's others."""
        share, source = super().at(site, robot)
        others = tuple(float(number) for number, name in enumerate(robot.gauge_names, start=1)
                       if name != site)
        names = tuple(name for name in robot.gauge_names if name != site)
        return share, replace(source, starts=others, high=float(len(robot.gauge_names)),
                              value_names=names)

    @classmethod
    def read(cls, values: Mapping[str, Any], parameters: Sequence[Parameter]) -> tuple[Any, ...]:
        """Return the values; the source is another gauge."""
        share, source = super().read(values, parameters)
        others = parameters[1].starts
        # Without a robot the parameters are those of any, whose gauges are not known.
        if parameters is not cls.parameters and source not in others:
            raise InputError(f'effects: {cls.identifier}: source: expected another gauge, one of '
                             f'{", ".join(f"{n:g}" for n in others)}, got {source:g}, the gauge '
                             'itself')
        return share, source

    def on_output(self, output: Array, time: Any, robot: Robot) -> Array:
        """Return the readings with the share added; a gauge does not pick up its own strain."""
        own = gauge_row(robot, self.site)
        number = np.arange(output.shape[-1]) - 1
        picked = (number == np.round(self['source'])) & (own == 0.0)
        source = np.sum(output * picked, axis=-1, keepdims=True)
        return output + self['share'] * source * own
