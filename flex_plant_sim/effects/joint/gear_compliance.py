"""Gear compliance: a gear or shaft twists between the rotor and the link."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import SecondOrderForm
from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.mechanics.elastic_root import root_moment, with_elastic_root
from flex_plant_sim.effects.mechanics.kinematics import (
    extended,
    is_energy_form,
    with_root_turn,
)
import numpy as np

# Below these the twist has no coordinate: it would be a stiff one that nobody sees.
RIGID, LEAST_SHARE = 1e-7, 1e-3
# Of the hub alone on the gear: steel gears with backlash-free preload lose a few per cent.
DAMPING_RATIO = 0.05


class GearCompliance(Effect):
    """
    A massless torsion spring at the joint axis; drive, friction and tachometer are the rotor's.

    The joint's angle sensor (a potentiometer in the paper) sits behind the gear; with
    sensor_behind_gear = 0 it sits on the motor, and with no hub radius the gear is then the same
    as a clamp compliance. A hub_share of the joint's inertia sits behind the gear; the twist
    is then a coordinate of its own (in the paper's form, whose rows are no balance of a hub, it
    stays without one and the torque that the hub takes is left out).
    """

    identifier = 'gear_compliance'
    family = 'joint and gear'
    explanation = 'The gear of {site} twists under load.'
    parameters = (
        # The reference links' own L / (3 E I) is 0.025 and 0.09 rad/(N m).
        Parameter('compliance_rad_per_n_m', 'rad/(N m)', 0.0, 0.0, 1.0,
                  (0.003, 0.01, 0.03, 0.08), 0.001, 0.04),
        Parameter('sensor_behind_gear', '', 1.0, 0.0, 1.0, (1.0, 0.0), np.inf, 0.5, discrete=True),
        Parameter('hub_share', '', 0.0, 0.0, 0.9, (0.0,), np.inf, 0.1, optional=True))
    sites = 'joint'
    structural = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the link's root turning by the gear's twist as well."""
        compliance, j = self['compliance_rad_per_n_m'], self.index
        if self['hub_share'] > LEAST_SHARE and compliance > RIGID and is_energy_form(form):
            return self._with_hub(form, robot)
        moment = root_moment(form, robot, j, robot.links[j].hub_radius)
        twisted = with_elastic_root(form, robot, j, compliance, moment,
                                    carried=self['hub_share'])
        angle = twisted.angle.copy()
        angle[j] += self['sensor_behind_gear'] * compliance * moment
        return replace(twisted, angle=angle)

    def _with_hub(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the twist as its last coordinate: the hub turns with it."""
        j, share, stiffness = self.index, self['hub_share'], 1.0 / self['compliance_rad_per_n_m']
        wide = extended(form, (f'twist_{self.site}',))
        wide = with_root_turn(wide, robot, j, np.eye(wide.order)[-1], share)
        hub = share * robot.drives[j].inertia
        wide.stiffness[0, -1, -1] += stiffness
        wide.damping[-1, -1] += 2.0 * DAMPING_RATIO * np.sqrt(stiffness * hub)
        wide.angle[j, -1] = self['sensor_behind_gear']
        return wide
