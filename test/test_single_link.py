"""The single link (Appendices C, D) against closed forms, finite elements and its energy."""

from __future__ import annotations

from dataclasses import replace

from finite_elements import mesh
from flex_plant_sim.arm.drive import Drive
from flex_plant_sim.arm.paper_model import paper_model, Sign
from flex_plant_sim.arm.robot_file import load_robot
import numpy as np
from numpy.typing import NDArray
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh, expm
from scipy.optimize import brentq
from single_link import ExternalLoads, NO_LOADS, SingleLink

Array = NDArray[np.float64]

ROBOT = load_robot('reference')
LINK = replace(ROBOT.links[1], damping_ratio=0.0)
HELD = Drive(inertia=1e12, torque_gain=1.0, damping=0.0)
FREE = Drive(inertia=0.05, torque_gain=1.0, damping=0.0)
PAYLOAD = 0.1
EI = LINK.bending_stiffness
LENGTH = LINK.length
SIGNS: tuple[Sign, ...] = ('corrected', 'as_printed')


def single(modes: int, drive: Drive = HELD, payload: float = PAYLOAD, gravity: float = 0.0,
           sign: Sign = 'corrected') -> SingleLink:
    return SingleLink(LINK, drive, modes, payload, gravity, sign)


def jacobian(link: SingleLink) -> Array:
    """Return A of the link about hanging at rest, exact up to rounding: it is nearly linear."""
    size, step = 2 * link.modes + 2, 1e-6
    columns = [(link.derivative(step * row) - link.derivative(-step * row)) / (2.0 * step)
               for row in np.eye(size)]
    return np.array(columns).T


def frequencies(link: SingleLink) -> Array:
    """Return the natural frequencies above zero, rad/s, ascending."""
    found = np.abs(np.linalg.eigvals(jacobian(link)).imag)
    return np.unique(found[found > 0.1].round(9))


def static_tip(link: SingleLink, loads: ExternalLoads = NO_LOADS,
               angle: float = 0.0, turning: float = 0.0) -> float:
    """Return the tip's deflection, m, at rest under constant loads."""
    n = link.modes
    state = np.zeros(2 * n + 2)
    state[0] = angle
    pushed = link.acceleration(state, turning * link.drive.inertia, loads)[1:]
    force = (np.eye(n) - link.kappa) @ pushed
    return float(link.tip @ (force / link.beam.frequencies**2))


def tip_mass_roots(ratio: float, count: int) -> Array:
    """Return gamma L of 1 + cos cosh = ratio x (sin cosh - cos sinh), a beam with a tip mass."""
    def equation(x: float) -> float:
        return float(1.0 / np.cosh(x) + np.cos(x)
                     - ratio * x * (np.sin(x) - np.cos(x) * np.tanh(x)))
    grid = np.linspace(0.1, (count + 1) * np.pi, 4000)
    values = [equation(x) for x in grid]
    return np.array([brentq(equation, a, b, xtol=1e-14) for a, b, u, v in
                     zip(grid, grid[1:], values, values[1:]) if u * v < 0][:count])


def test_cantilever_with_tip_mass_against_its_frequency_equation() -> None:
    """From above, as Rayleigh demands, and with an error that falls with the cube of n."""
    beam = LINK.beam(1)
    exact = tip_mass_roots(PAYLOAD / LINK.mass, 3)**2 / LENGTH**2 * np.sqrt(
        beam.bending_stiffness / beam.mass_per_length)
    errors = []
    for modes in (5, 10, 20):
        found = frequencies(single(modes))[:3]
        errors.append(found / exact - 1.0)
        assert np.all(errors[-1] > 0.0)
    assert np.all(errors[-1] < 2e-3)
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > 2.5)


def test_free_hub_against_finite_elements() -> None:
    """Hub, beam and payload turning freely: the drive's M_b of (49) closes the loop."""
    elements = mesh(ROBOT, 1)
    mass, stiffness = elements.mass()[1:, 1:], elements.stiffness()[1:, 1:]
    mass[0, 0] += FREE.inertia
    mass[-2, -2] += PAYLOAD
    exact = np.sqrt(eigh(stiffness, mass, eigvals_only=True)[1:3])
    coarse, fine = (frequencies(single(modes, FREE))[:2] for modes in (5, 20))
    np.testing.assert_allclose(fine, exact, rtol=5e-3)
    assert np.all(np.abs(fine - exact) < 0.3 * np.abs(coarse - exact))


def test_gravity_pulls_the_link_down_as_a_loaded_cantilever_bends() -> None:
    """Misprint 4's neighbour, beta*: w(L) = -g sin (rho a L^4 / 8 + m_p L^3 / 3) / EI."""
    load = LINK.mass_per_length * LENGTH**4 / 8.0 + PAYLOAD * LENGTH**3 / 3.0
    sag = static_tip(single(20, gravity=9.81), angle=0.6)
    assert sag == pytest.approx(-9.81 * np.sin(0.6) * load / EI, rel=1e-4)


def test_alpha_needs_the_length() -> None:
    """
    Misprint 4: alpha* = alpha - (m_p/mu) L phi(L), (48).

    Turning with a constant angular acceleration is a triangular load and a tip force:
    w(L) = -(11 rho a L^5 / 120 + m_p L^4 / 3) theta'' / EI.
    """
    load = 11.0 * LINK.mass_per_length * LENGTH**5 / 120.0 + PAYLOAD * LENGTH**4 / 3.0
    assert static_tip(single(20), turning=2.0) == pytest.approx(-2.0 * load / EI, rel=1e-4)
    printed = static_tip(single(20, sign='as_printed'), turning=2.0)
    assert abs(printed + 2.0 * load / EI) > 0.5 * 2.0 * load / EI


def test_alpha_of_the_single_link_is_that_of_equation_5() -> None:
    """Misprint 4: (5) has the L that (48) lacks; the two-link model's row says the same."""
    link = single(3)
    mu, lower = link.beam.modal_mass, LINK.beam(3)
    np.testing.assert_allclose(
        link.alpha, lower.alpha - PAYLOAD / mu * LENGTH * lower.shape(LENGTH), rtol=1e-14)


def test_reaction_of_the_payload_needs_its_acceleration() -> None:
    """
    Misprint 4: the last term of (47) is kappa* q'', not a constant.

    F_e of (46) from the accelerations, fed back as an external force on the bare beam, gives
    the same motion as the link with its payload.
    """
    rng = np.random.default_rng(4)
    loaded, bare = single(4, FREE, gravity=9.81), single(4, FREE, 0.0, gravity=9.81)
    state = 0.01 * rng.standard_normal(10)
    moved = loaded.acceleration(state, 0.3)
    tip = LENGTH * moved[0] + loaded.tip @ moved[1:]
    force = PAYLOAD * (tip + 9.81 * np.sin(state[0]))
    np.testing.assert_allclose(
        bare.acceleration(state, 0.3, ExternalLoads(tip_force=force)), moved, rtol=1e-10)


def test_tip_torque_bends_the_link_its_own_way() -> None:
    """
    Misprint 1: + phi'(L) M_e / mu in (43): a moment M lifts the tip by M L^2 / 2EI.

    As printed the moment bends the link against itself.
    """
    loads = ExternalLoads(tip_torque=0.5)
    expected = 0.5 * LENGTH**2 / (2.0 * EI)
    assert static_tip(single(20), loads) == pytest.approx(expected, rel=1e-2)
    assert static_tip(single(20, sign='as_printed'), loads) == pytest.approx(-expected, rel=1e-2)


def test_tip_force_is_the_link_s_reaction() -> None:
    loads = ExternalLoads(tip_force=0.5)
    assert static_tip(single(20), loads) == pytest.approx(-0.5 * LENGTH**3 / (3.0 * EI), rel=1e-4)


def squared_frequencies_with_tip_inertia(link: SingleLink, inertia: float) -> Array:
    """Return omega^2, ascending, where M_e = -J (phi'(L) q'') as of a hub at the tip."""
    n, rest = link.modes, np.zeros(2 * link.modes + 2)
    torque = link.acceleration(rest, 0.0, ExternalLoads(tip_torque=1.0))[1:]
    stiffness = -jacobian(link)[n + 2:, 1:n + 1]
    mass = np.eye(n) + inertia * np.outer(torque, link.tip_slope)
    return np.sort(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real)


def test_hub_at_the_tip_has_positive_inertia() -> None:
    """
    Misprint 1: with + phi'(L) M_e / mu a hub slows the beam, as finite elements say.

    As printed its rotary inertia is negative: a squared frequency turns negative.
    """
    inertia, elements = 6e-4, mesh(ROBOT, 1)
    mass, stiffness = elements.mass()[2:, 2:], elements.stiffness()[2:, 2:]
    mass[-1, -1] += inertia
    exact = eigh(stiffness, mass, eigvals_only=True)[:2]
    found = squared_frequencies_with_tip_inertia(single(20, payload=0.0), inertia)
    np.testing.assert_allclose(np.sqrt(found[:2]), np.sqrt(exact), rtol=0.02)
    printed = single(20, payload=0.0, sign='as_printed')
    assert squared_frequencies_with_tip_inertia(printed, inertia)[0] < 0.0


def test_payload_rides_on_a_moving_base() -> None:
    """
    Misprint 14: base acceleration acts through beta*, not beta as in (50).

    Equivalence principle: a base that accelerates with g is a link lying flat in gravity.
    """
    rng = np.random.default_rng(0)
    state = 0.01 * rng.standard_normal(10)
    moving = ExternalLoads(base_acceleration=9.81)
    lying = state.copy()
    lying[0] = np.pi / 2.0
    heavy = single(4, gravity=9.81).acceleration(lying)[1:]
    np.testing.assert_allclose(single(4).acceleration(state, 0.0, moving)[1:], heavy, rtol=1e-9)
    own, load = LINK.mass_per_length * LENGTH**4 / 8.0, PAYLOAD * LENGTH**3 / 3.0
    bent = {sign: static_tip(single(20, sign=sign), moving) for sign in SIGNS}
    assert bent['corrected'] == pytest.approx(-9.81 * (own + load) / EI, rel=1e-4)
    assert bent['as_printed'] == pytest.approx(-9.81 * own / EI, rel=1e-4)


def test_equation_4_moves_the_lower_link_by_beta_star() -> None:
    """Misprint 14: (4) has beta*_2 cos(theta_2) for the elbow's acceleration, as corrected."""
    form = paper_model(ROBOT, 3)
    row = (form.mass[1] + PAYLOAD * form.payload_mass[1])[5:, 2:5]
    expected = -single(3).beam.modal_mass * np.outer(
        single(3).beta, ROBOT.links[0].beam(3).shape(ROBOT.links[0].length))
    np.testing.assert_allclose(row, expected, rtol=1e-12)


def centripetal_by_energy(w: float, x: float, rate: float) -> float:
    """Return (d/dt dT/dw' - dT/dw) / m - w'' - x theta'' of a mass at (x, w) on a turning beam."""
    def kinetic(deflection: float) -> float:
        return 0.5 * ((x * rate)**2 + (deflection * rate)**2)
    step = 1e-4
    return -(kinetic(w + step) - kinetic(w - step)) / (2.0 * step)


def test_centripetal_term_of_42_is_squared_and_negative() -> None:
    """Misprint 9: in the bracket of (42) stands -w theta'^2, not + w theta'."""
    for rate in (-3.0, 0.5, 2.0):
        assert centripetal_by_energy(0.02, 0.4, rate) == pytest.approx(-0.02 * rate**2, rel=1e-9)


def spread(link: SingleLink, states: Array) -> float:
    """Return the largest change of energy over states (N, 2 + 2n), relative to its largest."""
    energy = np.array([link.energy(state) for state in states])
    return float(np.ptp(energy) / np.max(np.abs(energy)))


def test_energy_of_a_held_link_is_constant() -> None:
    """With the joint held the modal equations are Lagrange's: energy stays."""
    link = single(2, gravity=9.81)
    run = solve_ivp(lambda _, x: link.derivative(x), (0.0, 0.4), [0.4, 0.02, -0.003, 0, 0, 0],
                    method='DOP853', rtol=1e-11, atol=1e-13, t_eval=np.linspace(0.0, 0.4, 60))
    assert spread(link, run.y.T) < 1e-8


def test_energy_of_a_free_link_is_constant_as_modes_are_added() -> None:
    """M_b of (49) is the root moment of the bending alone: energy is exact only in the limit."""
    spreads = []
    for modes in (2, 6, 18):
        link = single(modes, FREE)
        state = np.zeros(2 * modes + 2)
        state[1] = 0.02
        step = expm(0.02 * jacobian(link))
        states = [state]
        for _ in range(50):
            states.append(step @ states[-1])
        spreads.append(spread(link, np.array(states)))
    assert spreads[0] > 2.0 * spreads[1] > 4.0 * spreads[2]
    assert spreads[2] < 0.05


def test_stiff_link_swings_as_a_rigid_pendulum() -> None:
    stiff = replace(LINK, youngs_modulus=1e4 * LINK.youngs_modulus)
    link = SingleLink(stiff, FREE, 20, PAYLOAD, 9.81)
    inertia = FREE.inertia + LINK.mass * LENGTH**2 / 3.0 + PAYLOAD * LENGTH**2
    moment = LINK.mass * LENGTH / 2.0 + PAYLOAD * LENGTH
    assert frequencies(link)[0] == pytest.approx(np.sqrt(9.81 * moment / inertia), rel=5e-3)


def test_hub_radius_lengthens_the_levers() -> None:
    """With a hub the held link bends as before, and a turn loads it with r + x."""
    radius = 0.08
    link = SingleLink(replace(LINK, hub_radius=radius), HELD, 20, PAYLOAD)
    np.testing.assert_allclose(frequencies(link)[:3], frequencies(single(20))[:3], rtol=1e-9)
    load = (11.0 * LINK.mass_per_length * LENGTH**5 / 120.0
            + radius * LINK.mass_per_length * LENGTH**4 / 8.0
            + PAYLOAD * (LENGTH + radius) * LENGTH**3 / 3.0)
    assert static_tip(link, turning=1.0) == pytest.approx(-load / EI, rel=1e-4)
