"""
The arm in second-order form: M(theta_2, m_p) p'' + D p' + K(theta_2) p = B u + f.

Every arm model returns it, and the state space is built from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from flex_plant_sim.arm.robot import Link, Robot
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SecondOrderForm:
    """
    The equations of motion as polynomials in c = cos(theta_2), affine in the payload.

    The N coordinates are p = (theta_1, theta_2, q_11…q_1n, q_21…q_2n, extra…).

    Attributes
    ----------
    mass, payload_mass : Array
        M = sum_k c^k (mass[k] + m_p payload_mass[k]); shapes (3, N, N).
    damping : Array
        D, shape (N, N).
    stiffness : Array
        K = sum_k c^k stiffness[k], shape (3, N, N).
    input_matrix : Array
        B: generalised force per unit of command, shape (N, 2).
    force : Array
        Generalised force of a unit torque on joint 1 and on joint 2, shape (N, 2).
    angle : Array
        Measured joint angles over p, shape (2, N).
    strain : Array
        Surface strain at the gauges over p, shape (gauges, N).
    names : tuple of str
        Coordinate names.
    elbow_angle : Array
        Angle between the links over p: theta_2 plus the upper link's tip slope; shape (N,).
    field : Array
        Generalised force of a uniform acceleration field of 1 m/s^2 across the upper and across
        the lower link (axis 0): field[:, 0] + m_p field[:, 1]; shape (2, 2, N).

    """

    mass: Array
    payload_mass: Array
    damping: Array
    stiffness: Array
    input_matrix: Array
    force: Array
    angle: Array
    strain: Array
    names: tuple[str, ...]
    elbow_angle: Array
    field: Array

    @property
    def order(self) -> int:
        """Return the number N of coordinates."""
        return len(self.names)

    def mass_at(self, cosine: ArrayLike, payload: ArrayLike) -> Array:
        """Return M for c (…,) and m_p in kg (…,); shape (…, N, N)."""
        powers = _powers(cosine)
        load = np.asarray(payload, dtype=float)[..., None, None]
        return _combine(powers, self.mass) + load * _combine(powers, self.payload_mass)

    def payload_mass_at(self, cosine: ArrayLike) -> Array:
        """Return dM/dm_p for c (…,); shape (…, N, N)."""
        return _combine(_powers(cosine), self.payload_mass)

    def stiffness_at(self, cosine: ArrayLike) -> Array:
        """Return K for c (…,); shape (…, N, N)."""
        return _combine(_powers(cosine), self.stiffness)


def _powers(cosine: ArrayLike) -> Array:
    c = np.asarray(cosine, dtype=float)
    return np.stack([np.ones_like(c), c, c * c], axis=-1)


def _combine(powers: Array, terms: Array) -> Array:
    return np.tensordot(powers, terms, axes=1)


class ArmModel(Protocol):
    """A model that turns robot parameters into a second-order form."""

    def __call__(self, robot: Robot, modes: int) -> SecondOrderForm:
        """Return the form with `modes` modes per link."""


def coordinate_names(modes: int) -> tuple[str, ...]:
    """Return theta_1, theta_2, q_11…, q_21…."""
    flexible = [f'q_{link}{i}' for link in (1, 2) for i in range(1, modes + 1)]
    return ('theta_1', 'theta_2', *flexible)


def angle_rows(modes: int) -> Array:
    """Return the rows that select the joint angles from p, shape (2, 2 + 2 modes)."""
    return np.eye(2, 2 + 2 * modes)


class Shapes(Protocol):
    """n shapes of a clamped link that diagonalise its mass (mu for each) and its stiffness."""

    @property
    def frequencies(self) -> Array:
        """Return omega_i, rad/s, shape (n,)."""

    @property
    def modal_mass(self) -> float:
        """Return mu, kg."""

    @property
    def alpha(self) -> Array:
        """Return -(4/L) int x phi_i dx, m, shape (n,)."""

    @property
    def beta(self) -> Array:
        """Return -(4/L) int phi_i dx, shape (n,)."""

    def shape(self, x: ArrayLike, derivative: int = 0) -> Array:
        """Return phi_i(x) or a derivative, shape x.shape + (n,)."""


def link_slice(index: int, modes: int) -> slice:
    """Return the slice of p that holds q of link `index` (0 or 1)."""
    return slice(2 + index * modes, 2 + (index + 1) * modes)


def strain_rows(robot: Robot, shapes: tuple[Shapes, Shapes], modes: int) -> Array:
    """Return surface strain b/2 w'' at the gauges over p, (17); shape (gauges, 2 + 2 modes)."""
    rows = []
    for j, link in enumerate(robot.links):
        block = np.zeros((len(link.gauge_positions), 2 + 2 * modes))
        curvature = shapes[j].shape(np.asarray(link.gauge_positions), 2)
        block[:, link_slice(j, modes)] = 0.5 * link.thickness * curvature
        rows.append(block)
    return np.vstack(rows)


def modal_damping(link: Link, shapes: Shapes) -> Array:
    """Return 2 zeta_i omega_i, 1/s, zeta_i = zeta omega_i / omega_1 (Kelvin-Voigt), (n,)."""
    return 2.0 * link.damping_ratio * shapes.frequencies**2 / link.beam(1).frequencies[0]
