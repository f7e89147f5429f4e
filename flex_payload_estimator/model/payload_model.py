"""
The arm model over theta_2 and payload m_p for estimators and controller, with any n modes.

A, B and their split (13) are taken at every sample, so all that does not depend on theta_2 and
m_p is tabulated once per robot. SF1 and the LQG controller build their predictors on it.
"""

from __future__ import annotations

from typing import Protocol

from flex_payload_estimator.model.tabulated import (
    compact_state,
    CompactTerms,
    second_order_state,
    Tables,
    terms_at,
)
from flex_plant_sim.arm.assumed_modes import assumed_modes, KinematicRows
from flex_plant_sim.arm.models import MODELS
from flex_plant_sim.arm.paper_model import CompactModel, paper_model
from flex_plant_sim.arm.ritz import RitzShapes
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array, SecondOrderForm, Shapes
from msg_config.errors import InputError
import numpy as np

# Stands for the tables that a second-order model does not have.
NO_TABLE = np.zeros((0, 0))


class PayloadModel(Protocol):
    """
    A(theta_2, m_p) and B(theta_2, m_p), and the output rows.

    Attributes
    ----------
    states : int
        n.
    output : Array
        C-bar, from the state to (theta_1, theta_2, gauges in V), (m, n).
    end_point : Array
        Row that gives theta_2e from the state, (n,).
    scale : Array
        Factors from (rad, rad, m/m…) to (rad, rad, V…), (m,).
    spread : Array
        Relative size of the states under a static load, (n,). Where there are fewer gauges than
        modes, the modes share a gauge's signal in this proportion.
    radius : float
        Largest spectral radius of A over cos(theta_2), 1/s: `halvings_for` halves T by it.
    tables : tuple of Array
        The tabulated model that `split.rates_at` evaluates.

    """

    tables: Tables
    spread: Array
    states: int
    output: Array
    end_point: Array
    scale: Array
    radius: float

    def matrices(self, cosine: float, mass: float) -> tuple[Array, Array]:
        """Return A (n, n) and B (n, 2) at cos(theta_2) and m_p, kg."""


def payload_model(robot: Robot, name: str, modes: int) -> PayloadModel:
    """
    Return a robot's model by name, with a number of modes per link.

    Raises
    ------
    InputError
        The name is not one of MODELS.

    """
    if name == 'paper_reduced':
        return ReducedModel(robot, modes)
    beams = robot.links[0].beam(modes), robot.links[1].beam(modes)
    if name == 'paper':
        return SecondOrderModel(robot, modes, paper_model(robot, modes), beams)
    if name == 'assumed_modes':
        shapes = RitzShapes.of(beams[0]), RitzShapes.of(beams[1])
        return SecondOrderModel(robot, modes, assumed_modes(robot, modes), shapes)
    raise InputError(f'model: expected one of {", ".join(MODELS)}, got {name!r}')


class ReducedModel:
    """
    The paper's reduced model (12)-(16): state (theta, q, q' - Lambda M_5 u), n_x = 2 + 4n.

    M_1…M_5 of Appendix F are polynomials of second degree in cos(theta_2). Their coefficients
    are computed once, from the compact form at three points.
    """

    def __init__(self, robot: Robot, modes: int):
        compact = CompactModel(robot, modes)
        self._size = 2 * modes
        self.states = 2 + 4 * modes
        points = np.array([-1.0, 0.0, 1.0])
        values = np.stack([self._term_row(compact, c) for c in points])
        table = np.linalg.solve(np.vander(points, increasing=True), values.reshape(3, -1))
        self.tables: Tables = (np.asarray(table, dtype=np.float64),
                               *CompactTerms.of(compact.at_cosine(1.0))[7:])
        beams = robot.links[0].beam(modes), robot.links[1].beam(modes)
        rows = KinematicRows.of(robot, beams, modes)
        self.spread = np.concatenate([_static_spread(beams), np.zeros(2 * modes)])
        self.scale, output = _output(robot, compact.form)
        self.output = np.hstack([output, np.zeros((len(output), 2 * modes))])
        self.end_point = np.concatenate([end_point_row(rows), np.zeros(2 * modes)])
        self.radius = _radius(self)

    def _term_row(self, compact: CompactModel, cosine: float) -> Array:
        """Return the terms that depend on cos(theta_2) in one row."""
        return np.concatenate([part.ravel()
                               for part in CompactTerms.of(compact.at_cosine(cosine))[:7]])

    def matrices(self, cosine: float, mass: float) -> tuple[Array, Array]:
        """Return A (n_x, n_x) and B (n_x, 2) at cos(theta_2) and m_p, kg."""
        return compact_state(terms_at(float(cosine), *self.tables), mass)


class SecondOrderModel:
    """A model in second-order form with state x = (p, p'), n_x = 4 + 4n."""

    def __init__(self, robot: Robot, modes: int, form: SecondOrderForm,
                 shapes: tuple[Shapes, Shapes]):
        order = form.order
        self.states = 2 * order
        fixed = np.zeros((3, order, order + 2))
        fixed[0] = np.hstack([-form.damping, form.input_matrix])
        table = np.concatenate(
            [form.mass, form.payload_mass, -form.stiffness, fixed], axis=2).reshape(3, -1)
        self.tables: Tables = (table, NO_TABLE, NO_TABLE, NO_TABLE)
        self._order = order
        rows = KinematicRows.of(robot, shapes, modes)
        self.spread = np.concatenate([_static_spread(shapes), np.zeros(order)])
        self.scale, output = _output(robot, form)
        self.output = np.hstack([output, np.zeros_like(output)])
        self.end_point = np.concatenate([end_point_row(rows), np.zeros(order)])
        self.radius = _radius(self)

    def matrices(self, cosine: float, mass: float) -> tuple[Array, Array]:
        """Return A (n_x, n_x) and B (n_x, 2) at cos(theta_2) and m_p, kg."""
        return second_order_state(self.tables[0], self._order, float(cosine), float(mass))


def end_point_row(rows: KinematicRows) -> Array:
    """
    Return the row that gives theta_2e, rad, the forearm's angle at its end-point, from p, (n,).

    The paper writes b and e for the beginning and end of a link: theta_1e = theta_b1 +
    sum phi_1'(L_1) q_1, theta_b2 = theta_1e + theta_2, (54). So theta_2e = theta_b2 +
    sum phi_2'(L_2) q_2.
    """
    return rows.tip_slope


def _output(robot: Robot, form: SecondOrderForm) -> tuple[Array, Array]:
    """Return `scale`, and the rows from p to (theta_1, theta_2, gauges in V), (m, N)."""
    gauges = len(form.strain)
    scale = np.concatenate([np.ones(2), np.full(gauges, robot.gauge_amplifier)])
    return scale, scale[:, None] * np.vstack([form.angle, form.strain])


def _static_spread(shapes: tuple[Shapes, Shapes]) -> Array:
    """Return 1 for the angles and (omega_1 / omega_i)^2 for each mode of the links."""
    ratios = [(shape.frequencies[0] / shape.frequencies)**2 for shape in shapes]
    return np.concatenate([np.ones(2), *ratios])


def _radius(model: ReducedModel | SecondOrderModel) -> float:
    """
    Return the spectral radius of A, 1/s, at its largest over cos(theta_2).

    That is without payload, which only slows the fastest mode down.
    """
    return max(float(np.max(np.abs(np.linalg.eigvals(model.matrices(c, 0.0)[0]))))
               for c in (-1.0, 0.0, 1.0))
