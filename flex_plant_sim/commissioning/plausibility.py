"""Hints: what a robot file may say, but hardly any arm is."""

from __future__ import annotations

from collections.abc import Iterator

from flex_plant_sim.arm.robot import Robot

# Here shear and rotary inertia, which Euler and Bernoulli's beam has not, lower the first three
# frequencies of a clamped link by 0.4, 2.4 and 5.5 % (finite elements of Timoshenko's beam).
SLENDER = 15.0
# Metals damp less, rubber and wood more; a decimal point or a percent sign is more likely.
DAMPED = 0.1
# With fewer a mode is hardly told from its alias; Nyquist's two are the least.
SAMPLES_A_PERIOD = 4.0
LINKS = ('upper', 'lower')


def hints(robot: Robot, frequencies: tuple[float, ...], deflection: float,
          strain: tuple[float, ...]) -> tuple[str, ...]:
    """
    Return one line for everything that deserves a second look.

    Parameters
    ----------
    robot : Robot
        As its file says.
    frequencies : tuple of float
        Natural frequencies with the joints held and the payload, ascending, Hz.
    deflection : float
        Of the tip under 1 N, m.
    strain : tuple of float
        At the gauges under 1 N across the tip.

    """
    return (*_links(robot), *_gauges(robot, strain), *_motion(robot, frequencies, deflection))


def _links(robot: Robot) -> Iterator[str]:
    for name, link in zip(LINKS, robot.links):
        if link.thickness > link.height:
            yield (f'links.{name}: thicker ({link.thickness:g} m) than high ({link.height:g} m), '
                   'and it bends across thickness_m: are the two exchanged?')
        if link.length < SLENDER * link.thickness:
            yield (f'links.{name}: {link.length / link.thickness:.1f} times as long as thick; '
                   f'beam theory wants {SLENDER:g}')
        if link.damping_ratio > DAMPED:
            yield (f'links.{name}.damping_ratio: {link.damping_ratio:g} is much for a link; 1 % '
                   'is 0.01')


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
    if second * SAMPLES_A_PERIOD * step > 1.0:
        yield (f'measurement.sample_time_s: {step:g} s, expected at most '
               f'{1.0 / (SAMPLES_A_PERIOD * second):.2g} s to see the second mode, '
               f'{second:.3g} Hz')
    reach = sum(link.hub_radius + link.length for link in robot.links)
    if deflection > 0.2 * reach:
        yield (f'1 N bends the tip by {deflection:.2g} m, the arm reaches {reach:.2g} m: large '
               'deflections are outside the model; are thickness and modulus right?')
    if deflection < 1e-5 * reach:
        yield f'1 N bends the tip by {1e6 * deflection:.2g} um: is this arm flexible at all?'
