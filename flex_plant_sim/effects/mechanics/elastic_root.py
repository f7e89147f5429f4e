"""
A massless torsion spring at a link's root, without a coordinate of its own.

The effects of clamp and gear compliance and of backlash use it.
"""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm
from flex_plant_sim.effects.mechanics.kinematics import (
    is_energy_form,
    link_columns,
    shapes_of,
    with_root_turn,
)
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Compliance, rad/(N m), below which a spring is rigid and gets no coordinate of its own, which
# would be stiff and unobservable.
RIGID_RAD_PER_N_M = 1e-7

# Damping over stiffness: a rubber coupling with a loss factor of 0.3 has 10 ms at 5 Hz.
RETARDATION = Parameter('retardation_s', 's', 0.0, 0.0, 0.2, (0.0,), np.inf, 0.01, optional=True)

# Which side of a gear the joint's angle is read at.
SENSOR_BEHIND_GEAR = Parameter(
    'sensor_behind_gear', '', 1.0, 0.0, 1.0, (1.0, 0.0), np.inf, 0.5, discrete=True,
    meaning='1 where the angle sensor turns with the link, 0 where it turns with the motor',
    value_names=('yes, on the link', 'no, on the motor'))


def root_moment(form: SecondOrderForm, robot: Robot, index: int, radius: float) -> Array:
    """Return the row of E I (w'' - radius w''') at a link's clamp, N m, (N,)."""
    link, shapes = robot.links[index], shapes_of(form, robot, index)
    row = np.zeros(form.order)
    row[link_columns(form, index)] = link.bending_stiffness * (
        shapes.shape(0.0, 2) - radius * shapes.shape(0.0, 3))
    return row


def with_elastic_root(form: SecondOrderForm, robot: Robot, index: int, compliance: float,
                      moment: Array, lever: float = 1.0, carried: float = 0.0,
                      retardation: float = 0.0) -> SecondOrderForm:
    """
    Return the form with psi = compliance * moment p between rotor and link root.

    There is no mass between rotor and link, so the spring carries the link's root moment and psi
    follows from the bending. This needs no stiff extra state at any compliance, and has a smooth
    limit at zero. The spring's energy is moment^2 compliance / 2; its loss is that of the link's
    material and, with a retardation, one of its own (Kelvin and Voigt). (The paper's rows of the
    rotors already hold the root moment and do not change.)

    Parameters
    ----------
    form : SecondOrderForm
        The arm's equations.
    robot : Robot
        Robot with the parameter effects applied.
    index : int
        Joint and link, 0 or 1.
    compliance : float
        Compliance of the spring, rad/(N m).
    moment : Array
        Row of the moment in the spring over p, (N,).
    lever : float
        Rotation about the joint axis per rotation of the spring.
    carried : float
        Share of the rotor's inertia behind the spring, 0 to 1.
    retardation : float
        Damping of the spring over its stiffness, beyond the link's own, s.

    """
    turned = with_root_turn(form, robot, index, lever * compliance * moment, carried)
    if not is_energy_form(form):
        return turned
    link = robot.links[index]
    own = 2.0 * link.damping_ratio / link.beam(1).frequencies[0]
    spring = compliance * np.outer(moment, moment)
    stiffness = turned.stiffness.copy()
    stiffness[0] += spring
    damping = turned.damping + (own + retardation) * spring
    return replace(turned, stiffness=stiffness, damping=damping)
