"""Loose payload: the payload swings across the tip in a soft grip."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import SecondOrderForm
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.kinematics import (
    is_energy_form,
    link_columns,
    with_coordinates,
)
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Compliance, m/N, below which the grip counts as rigid and gets no coordinate.
RIGID_GRIP = 1e-7
# Mass of the grip, kg: its coordinate needs one if there is no payload.
GRIP_MASS = 1e-6


class LoosePayload(Effect):
    """
    A share of the payload on a spring and damper across the lower link's tip.

    z' is relative to the tip. The damping ratio is that of the loose part on the spring alone; the
    rest of the payload is held firmly.
    """

    identifier = 'loose_payload'
    family = 'payload'
    explanation = 'The payload is held loosely and swings across the tip.'
    parameters = (
        # 0.1 kg swings at 10/sqrt(0.1 c): 0.03 m/N at 18 rad/s, 0.003 m/N at 58 rad/s.
        Parameter('compliance_m_per_n', 'm/N', 0.0, 0.0, 5.0, (0.005, 0.02, 0.06), 0.002, 0.04),
        Parameter('share', '', 1.0, 0.05, 1.0, (1.0, 0.5), np.inf, 0.3, optional=True),
        Parameter('damping_ratio', '', 0.05, 0.0, 2.0, (0.05,), np.inf, 0.1))
    sites = 'arm'
    structural = True

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form with the payload's displacement, m, as its last coordinate."""
        if self['compliance_m_per_n'] < RIGID_GRIP:
            return form
        wide, stiffness = with_coordinates(form, ('z_payload',)), 1.0 / self['compliance_m_per_n']
        elbow, tip, share = wide.field[0, 1], wide.field[1, 1], self['share']
        energy, lower = is_energy_form(form), link_columns(wide, 1)
        wide.payload_mass[0, :, -1] += share * (tip if energy else tip * lower)
        wide.payload_mass[1, :, -1] += share * (elbow if energy else 0.0)
        wide.payload_mass[0, -1], wide.payload_mass[1, -1] = share * tip, share * elbow
        wide.payload_mass[0, -1, -1] = tip[-1] = share
        wide.mass[0, -1, -1] += GRIP_MASS
        wide.stiffness[0, -1, -1] += stiffness
        wide.damping[-1, -1] += 2.0 * self['damping_ratio'] * np.sqrt(
            stiffness * (share * robot.payload_mass + GRIP_MASS))
        return wide
