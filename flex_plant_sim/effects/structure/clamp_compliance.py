"""Clamp compliance: a link's root turns in its clamp."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import SecondOrderForm
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.elastic_root import (
    RETARDATION,
    root_moment,
    with_elastic_root,
)
from flex_plant_sim.effects.parameter import Parameter


class ClampCompliance(Effect):
    """
    A massless torsion spring between a hub and the beam; the joint's sensor measures the hub.

    A clamp with rubber or loose screws loses energy, too: retardation_s is damping over stiffness.
    If the clamp is off the joint axis, the rotation about the axis is scaled so that the link's
    tip moves as it would for a rotation about the clamp.
    """

    identifier = 'clamp_compliance'
    family = 'links and structure'
    explanation = 'The clamp of {site} gives way under bending.'
    parameters = (
        Parameter('compliance_rad_per_n_m', 'rad/(N m)', 0.0, 0.0, 1.0,
                  (0.003, 0.01, 0.03, 0.08), 0.001, 0.04),
        RETARDATION)
    sites = 'link'
    structural = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form in which the beam's root also turns by the clamp's deflection."""
        link = robot.links[self.index]
        return with_elastic_root(form, robot, self.index, self['compliance_rad_per_n_m'],
                                 root_moment(form, robot, self.index, 0.0),
                                 link.length / (link.hub_radius + link.length),
                                 retardation=self['retardation_s'])
