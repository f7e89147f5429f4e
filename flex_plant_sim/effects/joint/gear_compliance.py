"""Gear compliance: a gear or shaft twists between the rotor and the link."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import SecondOrderForm
from flex_plant_sim.effects.base import Effect, Parameter
from flex_plant_sim.effects.mechanics.elastic_root import root_moment, with_elastic_root
import numpy as np


class GearCompliance(Effect):
    """
    A massless torsion spring at the joint axis; drive, friction and tachometer are the rotor's.

    The joint's angle sensor (a potentiometer in the paper) sits behind the gear; with
    sensor_behind_gear = 0 it sits on the motor, and with no hub radius the gear is then the same
    as a clamp compliance. A hub_share of the joint's inertia sits behind the gear, where it turns
    with the twist; the torque that it takes itself is left out of the twist.
    """

    identifier = 'gear_compliance'
    family = 'joint and gear'
    explanation = 'The gear of {site} twists under load.'
    parameters = (
        # The reference links' own L / (3 E I) is 0.025 and 0.09 rad/(N m).
        Parameter('compliance_rad_per_n_m', 'rad/(N m)', 0.0, 0.0, 1.0,
                  (0.003, 0.01, 0.03, 0.08), 0.001, 0.04),
        Parameter('sensor_behind_gear', '', 1.0, -0.5, 1.5, (1.0, 0.0), np.inf, 0.5),
        Parameter('hub_share', '', 0.0, 0.0, 0.9, (0.0,), np.inf, 0.1, optional=True))
    sites = 'joint'
    structural = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the link's root turning by the gear's twist as well."""
        compliance, j = self['compliance_rad_per_n_m'], self.index
        moment = root_moment(form, robot, j, robot.links[j].hub_radius)
        twisted = with_elastic_root(form, robot, j, compliance, moment,
                                    carried=self['hub_share'])
        angle = twisted.angle.copy()
        angle[j] += self['sensor_behind_gear'] * compliance * moment
        return replace(twisted, angle=angle)
