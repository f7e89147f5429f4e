"""Gear compliance: a gear or shaft twists between the rotor and the link."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import SecondOrderForm
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.elastic_root import (
    RETARDATION,
    RIGID_RAD_PER_N_M,
    root_moment,
    SENSOR_BEHIND_GEAR,
    with_elastic_root,
)
from flex_plant_sim.effects.mechanics.kinematics import (
    is_energy_form,
    with_coordinates,
    with_root_turn,
)
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Hub share below which the twist has no coordinate of its own.
LEAST_SHARE = 1e-3
# Damping ratio of the hub alone on the gear: preloaded steel gears without backlash lose a few
# per cent.
DAMPING_RATIO = 0.05


class GearCompliance(Effect):
    """
    A massless torsion spring at the joint axis; drive, friction and tachometer act on the rotor.

    The joint's angle sensor (a potentiometer in the paper) is behind the gear. With
    sensor_behind_gear = 0 it is on the motor; without a hub radius the gear is then the same as a
    clamp compliance. With a hub_share of the joint's inertia behind the gear, the twist becomes a
    coordinate of its own. In the paper's form, whose rows do not balance a hub, it does not, and
    the torque that accelerates the hub is left out. Belts and couplings of rubber lose energy as
    they twist: retardation_s is damping over stiffness.
    """

    identifier = 'gear_compliance'
    family = 'joint and gear'
    explanation = 'The gear of {site} twists under load.'
    parameters = (
        # The reference links' own L / (3 E I) is 0.025 and 0.09 rad/(N m).
        Parameter('compliance_rad_per_n_m', 'rad/(N m)', 0.0, 0.0, 1.0,
                  (0.003, 0.01, 0.03, 0.08), 0.001, 0.04),
        SENSOR_BEHIND_GEAR,
        Parameter('hub_share', '', 0.0, 0.0, 0.9, (0.0, 0.1), np.inf, 0.3, optional=True),
        RETARDATION)
    sites = 'joint'
    structural = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form in which the link's root also turns by the gear's twist."""
        compliance, j = self['compliance_rad_per_n_m'], self.index
        if self['hub_share'] > LEAST_SHARE and compliance > RIGID_RAD_PER_N_M \
                and is_energy_form(form):
            return self._with_hub(form, robot)
        moment = root_moment(form, robot, j, robot.links[j].hub_radius)
        twisted = with_elastic_root(form, robot, j, compliance, moment,
                                    carried=self['hub_share'],
                                    retardation=self['retardation_s'])
        angle = twisted.angle.copy()
        angle[j] += self['sensor_behind_gear'] * compliance * moment
        return replace(twisted, angle=angle)

    def _with_hub(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the twist as its last coordinate, by which the hub turns."""
        j, share, stiffness = self.index, self['hub_share'], 1.0 / self['compliance_rad_per_n_m']
        wide = with_coordinates(form, (f'twist_{self.site}',))
        wide = with_root_turn(wide, robot, j, np.eye(wide.order)[-1], share)
        hub = share * robot.drives[j].inertia
        wide.stiffness[0, -1, -1] += stiffness
        wide.damping[-1, -1] += (2.0 * DAMPING_RATIO * np.sqrt(stiffness * hub)
                                 + self['retardation_s'] * stiffness)
        wide.angle[j, -1] = self['sensor_behind_gear']
        return wide
