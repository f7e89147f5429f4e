"""Air drag: the links push air aside."""

from __future__ import annotations

from functools import lru_cache

from flex_plant_sim.arm.robot import Link, Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.base import Effect, Motion
from flex_plant_sim.effects.mechanics.kinematics import (
    elbow_state,
    is_energy_form,
    link_columns,
    link_shapes,
    root_row,
)
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Number of Gauss points per link, exact up to degree 11: the square of a cubic speed times a cubic
# shape has degree 9.
POINTS = 6


class AirDrag(Effect):
    """
    The force -rho C_d h v |v| / 2 per length of both links, v the speed across the link.

    Its one coefficient is density times drag coefficient. It is integrated with Gauss points.
    """

    identifier = 'air_drag'
    family = 'links and structure'
    explanation = 'Air resistance brakes the links, growing with the square of their speed.'
    parameters = (
        # Bare links in air: about 1.2 kg/m^3 times 2.
        Parameter('density_times_drag_kg_per_m3', 'kg/m^3', 0.0, 0.0, 200.0,
                  (3.0, 12.0, 40.0, 150.0), 2.0, 20.0),)
    sites = 'arm'

    def force(self, motion: Motion) -> Array:
        """Return the generalised force, (…, N)."""
        form, rate = motion.form, motion.velocity
        upper, lower = (_strips(form, motion.robot, index) for index in (0, 1))
        elbow = form.field[0, 1]
        cosine, _ = elbow_state(form, motion.position)
        push_1 = _push(rate @ upper[0].T, upper[1])
        push_2 = _push(rate @ lower[0].T + cosine * (rate @ elbow)[..., None], lower[1])
        if is_energy_form(form):
            load = (push_1 @ upper[0] + push_2 @ lower[0]
                    + cosine * push_2.sum(axis=-1, keepdims=True) * elbow)
        else:
            load = (push_1 @ (upper[0] * link_columns(form, 0))
                    + push_2 @ (lower[0] * link_columns(form, 1)))
        return -0.5 * self['density_times_drag_kg_per_m3'] * load


def _push(speed: Array, area: Array) -> Array:
    return area * speed * np.abs(speed)


def _strips(form: SecondOrderForm, robot: Robot, index: int) -> tuple[Array, Array]:
    """Return rows of the speed across a link less the elbow's, (points, N), and areas, m^2."""
    columns = link_columns(form, index)
    x, bend, area = _points(robot.links[index], int(columns.sum()), is_energy_form(form))
    rows = np.outer(robot.links[index].hub_radius + x, root_row(form, index))
    rows[:, columns] += bend
    return rows, area


@lru_cache(maxsize=16)
def _points(link: Link, modes: int, energy: bool) -> tuple[Array, Array, Array]:
    """Return Gauss points x, m, the shapes there, (points, n), and the area of each, m^2."""
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    x = 0.5 * link.length * (points + 1.0)
    return x, link_shapes(link, modes, energy).shape(x), 0.5 * link.length * weights * link.height
