"""One flexible link with payload and gravity, on a moving base (Appendices C and D)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from flex_plant_sim.arm.beam import Beam
from flex_plant_sim.arm.drive import Drive
from flex_plant_sim.arm.paper_model import Sign
from flex_plant_sim.arm.robot import Link
from flex_plant_sim.arm.second_order import Array, modal_damping
import numpy as np
from paper_equations import constants_33


@dataclass(frozen=True)
class ExternalLoads:
    """The joint's acceleration across the link; F_e, which the link exerts; M_e, on the link."""

    base_acceleration: float = 0.0  # m/s^2
    tip_force: float = 0.0  # N
    tip_torque: float = 0.0  # N m


NO_LOADS = ExternalLoads()


@dataclass(frozen=True)
class SingleLink:
    """
    A link with a point payload, moved by a drive: (43), (47)-(50), corrected.

    Coordinates p = (theta_b, q_1…q_n), state (p, p'); theta_b is 0 where the link hangs down.
    The hub radius r lengthens the lever arms: x becomes r + x. 'as_printed' keeps the sign of M_e
    in (43), alpha* without its L in (48), and the base acceleration without the payload in (50).
    """

    link: Link
    drive: Drive
    modes: int
    payload: float = 0.0  # kg
    gravity: float = 0.0  # m/s^2
    sign: Sign = 'corrected'

    @cached_property
    def beam(self) -> Beam:
        """Return the beam with its modes."""
        return self.link.beam(self.modes)

    @cached_property
    def tip(self) -> Array:
        """Return phi_i(L), (n,)."""
        return self.beam.shape(self.link.length)

    @cached_property
    def tip_slope(self) -> Array:
        """Return phi_i'(L), 1/m, (n,)."""
        return self.beam.shape(self.link.length, 1)

    @property
    def lever(self) -> float:
        """Return the payload's distance from the joint axis, m."""
        return self.link.hub_radius + self.link.length

    @property
    def alpha(self) -> Array:
        """Return alpha*, (48): alpha - (m_p / mu) L phi(L), m, (n,)."""
        lever = self.lever if self.sign == 'corrected' else 1.0
        own = self.beam.alpha + self.link.hub_radius * self.beam.beta
        return own - self.payload / self.beam.modal_mass * lever * self.tip

    @property
    def beta(self) -> Array:
        """Return beta*, (48): beta - (m_p / mu) phi(L), (n,)."""
        return self.beam.beta - self.payload / self.beam.modal_mass * self.tip

    @property
    def kappa(self) -> Array:
        """Return kappa*, (48): -(m_p / mu) phi_i(L) phi_j(L), (n, n)."""
        return -self.payload / self.beam.modal_mass * np.outer(self.tip, self.tip)

    @property
    def root_moment(self) -> Array:
        """Return M_b over q, (49), about the joint axis, N m, (n,)."""
        shear = self.beam.shape(0.0, 3)
        curvature = self.beam.shape(0.0, 2)
        return self.link.bending_stiffness * (curvature - self.link.hub_radius * shear)

    def acceleration(self, state: Array, command: float = 0.0,
                     loads: ExternalLoads = NO_LOADS) -> Array:
        """Return p'', (1 + n,): theta_b'' by (49); (I - kappa*) q'' = alpha* theta_b'' + …."""
        n, drive = self.modes, constants_33(self.drive)
        angle, q, rate, q_rate = state[0], state[1:n + 1], state[n + 1], state[n + 2:]
        turning = (drive.k_1 * command + drive.k_2 * float(self.root_moment @ q)
                   + drive.k_3 * rate)
        right = (self.alpha * turning + self.beta * self.gravity * np.sin(angle)
                 - self.beam.frequencies**2 * q - modal_damping(self.link, self.beam) * q_rate
                 + self._external_terms(loads))
        return np.concatenate([[turning], np.linalg.solve(np.eye(n) - self.kappa, right)])

    def _external_terms(self, loads: ExternalLoads) -> Array:
        """Return the terms of (50) due to external loads, unit of q / s^2, (n,)."""
        corrected = self.sign == 'corrected'
        beta = self.beta if corrected else self.beam.beta
        torque = self.tip_slope * loads.tip_torque * (1.0 if corrected else -1.0)
        return (beta * loads.base_acceleration
                + (torque - self.tip * loads.tip_force) / self.beam.modal_mass)

    def derivative(self, state: Array) -> Array:
        """Return the state's rate of change without command and loads, (2 + 2n,)."""
        return np.concatenate([state[self.modes + 1:], self.acceleration(state, 0.0, NO_LOADS)])

    def energy(self, state: Array) -> float:
        """Return the energy with the drive's, J, to second order in q; 0 hanging at rest."""
        n, mu = self.modes, self.beam.modal_mass
        angle, q, rate, q_rate = state[0], state[1:n + 1], state[n + 1], state[n + 2:]
        kinetic = 0.5 * mu * float(q_rate @ (np.eye(n) - self.kappa) @ q_rate)
        kinetic -= mu * rate * float(self.alpha @ q_rate)
        kinetic += 0.5 * (self._inertia + self.drive.inertia) * rate**2
        elastic = 0.5 * mu * float(self.beam.frequencies**2 @ q**2)
        weight = self._static_moment * (1.0 - np.cos(angle)) \
            - mu * float(self.beta @ q) * np.sin(angle)
        return float(kinetic + elastic + self.gravity * weight)

    @property
    def _inertia(self) -> float:
        radius, length = self.link.hub_radius, self.link.length
        own = self.link.mass * (radius**2 + radius * length + length**2 / 3.0)
        return own + self.payload * self.lever**2

    @property
    def _static_moment(self) -> float:
        centre = self.link.hub_radius + 0.5 * self.link.length
        return self.link.mass * centre + self.payload * self.lever
