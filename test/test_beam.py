"""Frequency equation, mode shapes, beam constants (Appendices B, G, H) and Ritz shapes."""

from __future__ import annotations

from flex_plant_sim.arm.beam import Array, Beam, frequency_roots
from flex_plant_sim.arm.ritz import RitzShapes
from flex_plant_sim.arm.robot_file import load_robot
import numpy as np
import pytest

# R. D. Blevins, Formulas for Natural Frequency and Mode Shape (1979), table 8-1, clamped-free.
BLEVINS_ROOTS = [1.87510407, 4.69409113, 7.85475744, 10.99554073, 14.13716839]
# Design notes of this project, computed apart from this code.
BETA = [1.565984, 0.867872, 0.508851, 0.363796]
ALPHA_OVER_LENGTH = [1.137651, 0.181534, 0.064833, 0.033085]

MANY = 20


@pytest.fixture
def beam() -> Beam:
    """Return the reference robot's upper link with 20 modes."""
    return load_robot('reference').links[0].beam(MANY)


def quadrature(beam: Beam, count: int = 200) -> tuple[Array, Array]:
    """Return Gauss-Legendre points and weights over the beam."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * beam.length * (points + 1.0), 0.5 * beam.length * weights


def test_roots_of_the_literature() -> None:
    np.testing.assert_allclose(frequency_roots(5), BLEVINS_ROOTS, rtol=5e-9)


def test_roots_solve_the_frequency_equation() -> None:
    """Newton's step in extended precision, the distance to the true root, is below 1e-12."""
    x = frequency_roots(MANY).astype(np.longdouble)
    sech = 1.0 / np.cosh(x)
    distance = (np.cos(x) + sech) / (np.sin(x) + sech * np.tanh(x))
    assert np.all(np.abs(distance) <= 1e-12)
    # No root is left out: they stay within 0.31 of the roots of the cosine.
    assert np.all(np.abs(x - (np.arange(MANY) + 0.5) * np.pi) < 0.31)


def test_high_modes_do_not_overflow() -> None:
    with np.errstate(all='raise', under='ignore'):
        beam = Beam.with_modes(0.6, 0.4, 8.0, 400)
        tip = beam.shape(beam.length)
        derivative = beam.shape(np.linspace(0.0, beam.length, 7), 3)
    np.testing.assert_allclose(np.abs(tip), 1.0, rtol=1e-12)
    assert np.all(np.isfinite(derivative))


def test_section_of_equation_36() -> None:
    link = load_robot('reference').links[0]
    # a = b h, I = b^3 h / 12 for 3 mm x 50 mm.
    assert link.mass_per_length == pytest.approx(2700 * 1.5e-4, rel=1e-14)
    assert link.bending_stiffness == pytest.approx(70e9 * 1.125e-10, rel=1e-14)
    assert link.beam(1).modal_mass == pytest.approx(link.mass / 4.0, rel=1e-14)


def test_boundary_conditions_of_equation_39(beam: Beam) -> None:
    scale = beam.wave_numbers
    for x, derivative in ((0.0, 0), (0.0, 1), (beam.length, 2), (beam.length, 3)):
        value = beam.shape(x, derivative) / scale**derivative
        np.testing.assert_allclose(value, 0.0, atol=2e-13)


def test_tip_is_one(beam: Beam) -> None:
    np.testing.assert_allclose(np.abs(beam.shape(beam.length)), 1.0, rtol=1e-13)


def test_orthogonality(beam: Beam) -> None:
    x, weights = quadrature(beam)
    shape = beam.shape(x)
    gram = (shape.T * weights) @ shape
    np.testing.assert_allclose(gram, beam.length / 4.0 * np.eye(MANY), atol=1e-13)


def test_curvatures_are_orthogonal_with_the_frequencies(beam: Beam) -> None:
    x, weights = quadrature(beam)
    bend = beam.shape(x, 2)
    stiffness = beam.bending_stiffness * (bend.T * weights) @ bend
    expected = beam.modal_mass * beam.frequencies**2
    scale = np.sqrt(np.outer(expected, expected))
    np.testing.assert_allclose(stiffness / scale, np.eye(MANY), atol=1e-11)


@pytest.mark.parametrize('derivative', [1, 2, 3, 4])
def test_derivatives_against_finite_differences(beam: Beam, derivative: int) -> None:
    """Each derivative is that of the one below; the fourth is gamma^4 phi, the beam's ODE."""
    x = np.linspace(0.05, 0.95, 37) * beam.length
    h = 1e-3 / beam.wave_numbers[-1]

    def lower(offset: float) -> Array:
        return beam.shape(x + offset, derivative - 1)

    numeric = (8.0 * (lower(h) - lower(-h)) - lower(2.0 * h) + lower(-2.0 * h)) / (12.0 * h)
    exact = beam.shape(x, derivative) if derivative < 4 else beam.wave_numbers**4 * beam.shape(x)
    scale = beam.wave_numbers**derivative
    # Rounding of the differences: 1e-16 / 1e-3 for the highest mode, more for lower ones.
    tolerance = 2e-14 * beam.wave_numbers[-1] / (1e-3 * beam.wave_numbers)
    assert np.all(np.abs(numeric - exact) / scale < tolerance + 1e-11)


def test_low_modes_against_equation_38() -> None:
    """The textbook form cosh - cos - sigma (sinh - sin), safe for low modes only."""
    beam = Beam.with_modes(1.3, 0.4, 8.0, 4)
    g, x = beam.roots, np.linspace(0.0, beam.length, 50)
    z = np.multiply.outer(x, beam.wave_numbers)
    sigma = (np.cosh(g) + np.cos(g)) / (np.sinh(g) + np.sin(g))
    plain = 0.5 * (np.cosh(z) - np.cos(z) - sigma * (np.sinh(z) - np.sin(z)))
    np.testing.assert_allclose(beam.shape(x), plain, atol=1e-10)


def test_alpha_and_beta_against_quadrature(beam: Beam) -> None:
    x, weights = quadrature(beam)
    shape = beam.shape(x)
    np.testing.assert_allclose(beam.beta, -4.0 / beam.length * weights @ shape, atol=1e-13)
    np.testing.assert_allclose(beam.alpha, -4.0 / beam.length * (weights * x) @ shape, atol=1e-13)


def test_alpha_and_beta_of_the_design_notes(beam: Beam) -> None:
    np.testing.assert_allclose(np.abs(beam.beta[:4]), BETA, atol=5e-7)
    np.testing.assert_allclose(np.abs(beam.alpha[:4]) / beam.length, ALPHA_OVER_LENGTH, atol=5e-7)


def test_root_shear_is_the_inertia_of_the_mode(beam: Beam) -> None:
    """E I phi'''(0) = mu beta omega^2, with its sign: the clamp carries the mode's inertia."""
    shear = beam.bending_stiffness * beam.shape(0.0, 3)
    np.testing.assert_allclose(shear, beam.modal_mass * beam.beta * beam.frequencies**2,
                               rtol=1e-11)
    moment = beam.bending_stiffness * beam.shape(0.0, 2)
    np.testing.assert_allclose(moment, -beam.modal_mass * beam.alpha * beam.frequencies**2,
                               rtol=1e-11)


def beamc(n: int) -> tuple[Array, Array]:
    """
    Return alpha/L and beta by the listing of Appendix H, `~2` read as squared.

    In extended precision: it subtracts terms as large as cosh(g), 1.6e7 for the sixth mode.
    """
    inverse = np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1], [0, 0, -1, 0]],
                       dtype=np.longdouble)
    alpha, beta = np.zeros(n), np.zeros(n)
    for i, g in enumerate(frequency_roots(n).astype(np.longdouble)):
        sigma = (np.cosh(g) + np.cos(g)) / (np.sinh(g) + np.sin(g))
        c = 0.5 * np.array([1.0, -sigma, -1.0, sigma])
        end = np.array([np.cosh(g), np.sinh(g), np.cos(g), np.sin(g)])
        change = end - np.array([1.0, 0.0, 1.0, 0.0])
        beta[i] = -4.0 * c @ inverse @ change / g
        alpha[i] = c @ (4.0 * inverse @ inverse) @ change / g**2 - 4.0 * c @ inverse @ end / g
    return alpha, beta


def test_appendix_h_with_its_illegible_lines_restored(beam: Beam) -> None:
    """Misprint 10: with `^2` for `~2` and c = [1, -sigma, -1, sigma]/2 the listing agrees."""
    alpha, beta = beamc(6)
    np.testing.assert_allclose(alpha, beam.alpha[:6] / beam.length, rtol=1e-10)
    np.testing.assert_allclose(beta, beam.beta[:6], rtol=1e-10)


def test_equation_of_alpha_in_appendix_h_needs_length_squared(beam: Beam) -> None:
    """Misprint 13: alpha/L is -(4/L^2) int x phi dx, not -(4/L) int x phi dx."""
    x, weights = quadrature(beam)
    moment = (weights * x) @ beam.shape(x)
    listing, _ = beamc(4)
    np.testing.assert_allclose(-4.0 / beam.length**2 * moment[:4], listing, rtol=1e-8)
    assert not np.allclose(-4.0 / beam.length * moment[:4], listing, rtol=0.1)


def ritz(n: int) -> RitzShapes:
    return RitzShapes.of(load_robot('reference').links[1].beam(n))


@pytest.mark.parametrize('n', [1, 2, 3, 5, 10, MANY])
def test_ritz_shapes_diagonalise_mass_and_stiffness(n: int) -> None:
    shapes = ritz(n)
    x, weights = quadrature(shapes.beam)
    value, bend = shapes.shape(x), shapes.shape(x, 2)
    mass = shapes.beam.mass_per_length * (value.T * weights) @ value / shapes.modal_mass
    # At n = 20 the candidates' condition of 8e6 leaves 2e-9 in double precision.
    np.testing.assert_allclose(mass, np.eye(n), atol=5e-9)
    stiffness = shapes.beam.bending_stiffness * (bend.T * weights) @ bend / shapes.modal_mass
    scale = np.outer(shapes.frequencies, shapes.frequencies)
    np.testing.assert_allclose(stiffness / scale, np.eye(n), atol=1e-8)
    np.testing.assert_allclose(shapes.shape(np.zeros(1)), 0.0, atol=1e-9)


@pytest.mark.parametrize('n', [2, 3, 8])
def test_ritz_shapes_hold_the_static_deflections_exactly(n: int) -> None:
    """Tip force F: F x^2 (3L - x) / 6EI; tip moment M: M x^2 / 2EI, by virtual work."""
    shapes = ritz(n)
    beam, x = shapes.beam, np.linspace(0.0, shapes.beam.length, 9)
    modal_stiffness = shapes.modal_mass * shapes.frequencies**2
    by_force = shapes.shape(x) @ (shapes.shape(beam.length) / modal_stiffness)
    by_moment = shapes.shape(x) @ (shapes.shape(beam.length, 1) / modal_stiffness)
    np.testing.assert_allclose(by_force, x**2 * (3.0 * beam.length - x)
                               / (6.0 * beam.bending_stiffness), atol=1e-9 * by_force[-1])
    np.testing.assert_allclose(by_moment, x**2 / (2.0 * beam.bending_stiffness),
                               atol=1e-9 * by_moment[-1])


def test_ritz_frequencies_bound_the_exact_ones_from_above() -> None:
    """Rayleigh: every Ritz frequency lies above the exact one, and falls as shapes are added."""
    few, more = ritz(4), ritz(12)
    exact = few.beam.frequencies
    assert np.all(few.frequencies >= exact * (1.0 - 1e-12))
    assert np.all(more.frequencies[:4] <= few.frequencies * (1.0 + 1e-12))
    np.testing.assert_allclose(more.frequencies[:2], exact[:2], rtol=1e-5)


def test_moments_exhaust_the_rigid_motions() -> None:
    """
    Parseval: sum beta_i^2 tends to 4 and sum alpha_i^2 / L^2 to 4/3, from below.

    beta_i = 4 sigma_i / (gamma_i L), so 16 / (pi^2 n) is left of the first after n modes.
    """
    modes = load_robot('reference').links[1].beam(200)
    assert 4.0 - np.sum(modes.beta**2) == pytest.approx(16.0 / (np.pi**2 * 200), rel=1e-3)
    assert np.sum(modes.alpha**2) / modes.length**2 == pytest.approx(4.0 / 3.0, rel=1e-6)
    shapes = ritz(8)
    # Eight Ritz shapes span the first six modes and more.
    assert np.sum(modes.beta[:6]**2) < np.sum(shapes.beta**2) < 4.0
    assert np.sum(shapes.alpha**2) / modes.length**2 == pytest.approx(4.0 / 3.0, rel=1e-3)
