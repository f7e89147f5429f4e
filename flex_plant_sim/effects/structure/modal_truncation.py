"""Modal truncation: the model bends in too few shapes."""

from __future__ import annotations

from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import SecondOrderForm
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.kinematics import is_energy_form, link_columns
from flex_plant_sim.effects.parameter import Parameter


class ModalTruncation(Effect):
    """
    A least number of Ritz shapes per link.

    A few of the paper's clamped-free modes miss a good part of the shear under a tip load. The
    form is replaced by that of assumed modes, whose shapes represent tip loads exactly.
    """

    identifier = 'modal_truncation'
    family = 'links and structure'
    explanation = 'The model lets the links bend in too few shapes.'
    parameters = (Parameter('modes', 'modes a link', 1.0, 1.0, 12.0, (2.0, 3.0, 4.0), 0.5, 3.0,
                            discrete=True),)
    sites = 'arm'
    structural = True
    reshapes = True

    @property
    def modes(self) -> int:
        """Return the least number of shapes per link that the effect requires."""
        return int(round(self['modes']))

    def on_form(self, form: SecondOrderForm, robot: Robot) -> SecondOrderForm:
        """Return the form of assumed modes with Ritz shapes."""
        if self.modes <= 1 or is_energy_form(form):
            return form
        return assumed_modes(robot, int(link_columns(form, 0).sum()))
