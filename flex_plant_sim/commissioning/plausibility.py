"""Hints on values of a robot file that are valid but unlikely for an arm (`flex_robot check`)."""

from __future__ import annotations

from collections.abc import Iterator
import math

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.units import GRAVITY

# Least ratio of length to thickness. At this ratio shear and rotary inertia, which the
# Euler-Bernoulli beam neglects, lower the first three frequencies of a clamped link by 0.4, 2.4
# and 5.5 % (finite elements of Timoshenko's beam).
MIN_SLENDERNESS = 15.0
# Largest usual damping ratio. Metals damp less, and only rubber and wood more; a wrong decimal
# point or a percentage is more likely.
MAX_DAMPING = 0.1
# Least number of samples per period of a mode. With fewer it is hardly distinguished from its
# alias; by Nyquist two are the limit.
SAMPLES_PER_PERIOD = 4.0
# Share of a link's length, hub included, from which the radius of gyration of what it carries is
# long: then the moment of inertia is mostly that of a mass somewhere else.
WIDE = 0.5
# Angle from which on a limit of a joint is more likely in degrees, rad.
MANY_TURNS = 4.0 * math.pi
LINKS = ('upper', 'lower')
DRIVES = ('shoulder', 'elbow')
# Densities of what links are made of, kg/m^3: from balsa to lead.
MATERIALS = (100.0, 11400.0)
# Noise of a joint's sensor, rad, and of a gauge, m/m, above which neither shows how an arm bends.
COARSE_ANGLE, COARSE_STRAIN = 0.005, 1e-4
# Longest usual time constant of a drive's velocity loop, s.
SLOW_LOOP = 1.0


def hints(robot: Robot, frequencies: tuple[float, ...], deflection: float,
          strain: tuple[float, ...]) -> tuple[str, ...]:
    """
    Return one line for every value that should be checked again.

    Parameters
    ----------
    robot : Robot
        The robot as in its file.
    frequencies : tuple of float
        Natural frequencies with the joints held and the payload, ascending, Hz.
    deflection : float
        Deflection of the tip under 1 N, m.
    strain : tuple of float
        Strain at the gauges under 1 N across the tip, m/m.

    """
    return (*_links(robot), *_gauges(robot, strain), *_motion(robot, frequencies, deflection),
            *_units(robot), *_inertias(robot))


def _inertias(robot: Robot) -> Iterator[str]:
    """Yield hints on moments of inertia that are about another axis."""
    for name, axis, mass, inertia, link in (
            ('elbow', 'the elbow axis', robot.elbow_mass, robot.elbow_inertia, robot.links[0]),
            ('payload', 'its centre', robot.payload_mass, robot.payload_inertia, robot.links[1])):
        radius = math.sqrt(inertia / mass) if mass > 0.0 else 0.0
        if radius > WIDE * (link.hub_radius + link.length):
            yield (f'{name}.inertia_kg_m2: {inertia:g} is {mass:g} kg at {radius:.2g} m from '
                   f'{axis}: is it about another axis?')


def _units(robot: Robot) -> Iterator[str]:
    """Yield hints on values that are usual in another unit."""
    for name, link in zip(LINKS, robot.links):
        if not MATERIALS[0] <= link.density <= MATERIALS[1]:
            yield (f'links.{name}.density_kg_per_m3: {link.density:g}: no usual material is so '
                   'light or heavy; steel is 7850')
    for name, drive in zip(DRIVES, robot.drives):
        if drive.closed_loop and drive.inertia > SLOW_LOOP * drive.damping:
            yield (f'drives.{name}: {drive.inertia / drive.damping:g} s to follow its command is '
                   'long; is it in ms?')
    for name, limits in zip(DRIVES, robot.angle_limits):
        widest = max(map(abs, limits))
        if math.isfinite(widest) and widest > MANY_TURNS:
            yield (f'drives.{name}.angle_limits_rad: {widest:g} rad is '
                   f'{widest / (2.0 * math.pi):.2g} turns; is it in degrees?')
    if robot.angle_noise > COARSE_ANGLE:
        yield f'measurement.angle_noise_rad: {robot.angle_noise:g} is much; is it in degrees?'
    if robot.strain_noise > COARSE_STRAIN:
        yield f'measurement.strain_noise: {robot.strain_noise:g} is much; 1 um/m is 1e-6'
    for name, value in vars(robot.tolerances).items():
        if value > 1.0:
            yield f'tolerances.{name}: {value:g} is {100.0 * value:g} %; 3 % is 0.03'


def _links(robot: Robot) -> Iterator[str]:
    for name, link in zip(LINKS, robot.links):
        if link.thickness > link.height:
            yield (f'links.{name}: thicker ({link.thickness:g} m) than high ({link.height:g} m), '
                   'and it bends across thickness_m: are the two exchanged?')
        if link.length < MIN_SLENDERNESS * link.thickness:
            yield (f'links.{name}: {link.length / link.thickness:.1f} times as long as thick; '
                   f'beam theory wants {MIN_SLENDERNESS:g}')
        if link.damping_ratio > MAX_DAMPING:
            yield (f'links.{name}.damping_ratio: {link.damping_ratio:g} is much for a link; 1 % '
                   'is 0.01')
        if link.damping_ratio == 0.0:
            # An arm told so, with 1 % in truth, was weighed 7 % too heavy, four deviations off.
            yield (f'links.{name}.damping_ratio: 0 is taken as exact, for tolerances are shares '
                   'of it; 1 %, 0.01, is usual')


def _gauges(robot: Robot, strain: tuple[float, ...]) -> Iterator[str]:
    named = iter(zip(robot.gauge_names, strain))
    for link_name, link in zip(LINKS, robot.links):
        own = [next(named) for _ in link.gauge_positions]
        if not own:
            yield f'links.{link_name}: no gauge; its load is told by the other channels alone'
        for name, value in own:
            if abs(value) < 0.1 * max(abs(other) for _, other in own):
                yield (f'{name}: strains only {1e6 * abs(value):.2g} um/m under 1 N across the '
                       'tip; nearer to the clamp it would see more')


def _motion(robot: Robot, frequencies: tuple[float, ...], deflection: float) -> Iterator[str]:
    step, second = robot.sample_time, frequencies[1]
    if second * SAMPLES_PER_PERIOD * step > 1.0:
        yield (f'measurement.sample_time_s: {step:g} s, expected at most '
               f'{1.0 / (SAMPLES_PER_PERIOD * second):.2g} s to see the second mode, '
               f'{second:.3g} Hz')
    reach = sum(link.hub_radius + link.length for link in robot.links)
    # A tip is seldom moved harder than gravity would bend it.
    force = GRAVITY * max(robot.payload_mass, robot.links[1].mass)
    if force * deflection > 0.2 * reach:
        yield (f'{force:.2g} N, the weight of payload or lower link, bends the tip by '
               f'{force * deflection:.2g} m, the arm reaches {reach:.2g} m: large deflections are '
               'outside the model; are thickness and modulus right?')
    if deflection < 1e-5 * reach:
        yield f'1 N bends the tip by {1e6 * deflection:.2g} um: is this arm flexible at all?'
