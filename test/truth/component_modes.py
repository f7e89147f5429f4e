"""Component modes of one link: static tip-load shapes and clamped modes of its finite elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from truth.beam_elements import Array, BeamMesh
from truth.configuration import Link


@dataclass(frozen=True)
class ComponentModes:
    """
    Shapes of one link and their integrals, with n shapes; body axes at the joint.

    With X = hub radius + x, shapes phi (n,), transverse mass density dm:

    - mass m kg, first moment m1 = int X dm, second moment m2 = int X^2 dm;
    - a = int phi dm, b = int X phi dm, mass_matrix = int phi phi^T dm;
    - s(x) = 1/2 q^T S(x) q, S = int_0^x phi' phi'^T, is the foreshortening:
      shortening = int S dm, centrifugal = int phi phi^T dm - int X S dm;
    - tip, tip_slope (n,), tip_shortening (n, n) at x = L;
    - stiffness, damping (n, n); curvature rows (gauges, n);
    - at five Gauss points: point_arm X m, point_weight m, point_rows phi, phi', phi'' (3, 5, n)
      and point_shortening S (5, n, n).
    """

    mass: float
    first_moment: float
    second_moment: float
    a: Array
    b: Array
    mass_matrix: Array
    shortening: Array
    centrifugal: Array
    tip: Array
    tip_slope: Array
    tip_shortening: Array
    stiffness: Array
    damping: Array
    curvature: Array
    point_arm: Array
    point_weight: Array
    point_rows: Array
    point_shortening: Array

    @property
    def size(self) -> int:
        """Number of shapes."""
        return self.a.size


def link_shapes(mesh: BeamMesh, count: int, root_stiffness: float, tip_mass: float,
                tip_inertia: float) -> Array:
    """
    Return `count` mass-orthonormal shapes (mesh.size, count), lowest frequencies first.

    Candidates are the two static tip-load shapes and the lowest clamped-free modes; the Ritz
    vectors of the link with its tip body are kept. `root_stiffness` N m/rad ties the root's slope
    (inf: clamped).
    """
    first = 2 if np.isinf(root_stiffness) else 1
    stiffness, mass = mesh.stiffness(), mesh.mass()
    if first == 1:
        stiffness[1, 1] += root_stiffness
    inner = slice(first, mesh.size)
    k_inner, m_inner = stiffness[inner, inner], mass[inner, inner]
    loads = np.eye(mesh.size)[inner, -2:]
    modes = eigh(k_inner, m_inner, subset_by_index=[0, count - 1])[1]
    trial = np.linalg.qr(np.hstack([np.linalg.solve(k_inner, loads) * 1e3, modes]))[0]
    m_tip = m_inner + np.diag(np.r_[np.zeros(m_inner.shape[0] - 2), tip_mass, tip_inertia])
    ritz = eigh(trial.T @ k_inner @ trial, trial.T @ m_tip @ trial)[1][:, :count]
    shapes = np.zeros((mesh.size, count))
    shapes[inner] = trial @ ritz
    return shapes


def rigid_rotation(mesh: BeamMesh, hub_radius: float) -> Array:
    """Return the nodal values (mesh.size, 1) of a unit rotation about the joint axis."""
    rigid = np.ones((mesh.size, 1))
    rigid[0::2, 0] = hub_radius + np.linspace(0.0, mesh.length, mesh.elements + 1)
    return rigid


def shortening_to(mesh: BeamMesh, shapes: Array, position: float) -> Array:
    """Return S(x) (n, n) at x = `position`, m: the integral of phi' phi'^T from the root."""
    points, weights = np.polynomial.legendre.leggauss(24)
    slope = np.array([mesh.row(0.5 * position * (s + 1.0), 1) @ shapes for s in points])
    return slope.T @ (0.5 * position * weights[:, None] * slope)


def link_modes(link: Link, count: int, tip_mass: float = 0.0, tip_inertia: float = 0.0,
               twist: bool = False, elements: int = 40) -> ComponentModes:
    """
    Return the component modes of `link`; the tip body only shapes the basis.

    With `twist` a rigid rotation about the joint (gear twist or backlash, rad) comes last.
    """
    mesh = link.mesh(elements)
    shapes = link_shapes(mesh, count, link.clamp_stiffness, tip_mass, tip_inertia)
    if twist:
        shapes = np.hstack([shapes, rigid_rotation(mesh, link.hub_radius)])
    x, weight, rows, slopes = mesh.quadrature()
    arm, dm = link.hub_radius + x, link.mass_per_length * weight
    phi, slope = rows @ shapes, slopes @ shapes
    outer_mass = link.mass_per_length * (link.length - x)
    outer_moment = 0.5 * link.mass_per_length * ((link.hub_radius + link.length)**2 - arm**2)
    stiffness = shapes.T @ mesh.stiffness() @ shapes
    if np.isfinite(link.clamp_stiffness):
        root = np.r_[shapes[1, :count], np.zeros(int(twist))]
        stiffness += link.clamp_stiffness * np.outer(root, root)
    # The hub's own foreshortening when it turns against the rotor.
    hub = np.zeros_like(stiffness)
    hub[-1, -1] = link.hub_radius * twist
    mass_matrix = shapes.T @ mesh.mass() @ shapes
    points, weights = np.polynomial.legendre.leggauss(5)
    positions = 0.5 * link.length * (points + 1.0)
    return ComponentModes(
        mass=dm.sum(), first_moment=float(dm @ arm), second_moment=float(dm @ arm**2),
        a=dm @ phi, b=(dm * arm) @ phi, mass_matrix=mass_matrix,
        shortening=slope.T @ ((weight * outer_mass)[:, None] * slope) + dm.sum() * hub,
        centrifugal=(mass_matrix - slope.T @ ((weight * outer_moment)[:, None] * slope)
                     - (dm @ arm) * hub),
        tip=shapes[-2], tip_slope=shapes[-1],
        tip_shortening=slope.T @ (weight[:, None] * slope) + hub,
        stiffness=stiffness,
        damping=2.0 * link.damping_ratio / link.first_frequency * stiffness,
        curvature=np.array([mesh.row(g, 2) @ shapes for g in link.gauges]),
        point_arm=link.hub_radius + positions, point_weight=0.5 * link.length * weights,
        point_rows=np.array([[mesh.row(xi, order) @ shapes for xi in positions]
                             for order in range(3)]),
        point_shortening=np.array([
            shortening_to(mesh, shapes, xi) + hub for xi in positions]))
