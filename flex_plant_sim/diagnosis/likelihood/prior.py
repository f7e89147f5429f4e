"""
The prior: parts of the arm, sizes of effects, and how likely a cause is before any data.

`flex_robot prior ROBOT` prints it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import partial
import math
from typing import NamedTuple

from flex_plant_sim.arm.parts import Part, robot_parts
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import catalogue, sites
from flex_plant_sim.effects.base import Effect

# As likely as not, something of the catalogue is wrong with a simulation; one time in ten
# something is that no catalogue knows.
PROBABILITY_ANY_CAUSE, PROBABILITY_UNKNOWN = 0.5, 0.1
# Of effects taken out of the catalogue others explained such a share so that nothing unnamed was
# left (test/run_bank.py --use calibration --only missing; 21 of 33): what is unknown may look like
# a cause.
IMITATION_SHARE = 0.65
# By what each fault beyond two that a set asks for raises the odds that it is something unknown
# that looks like it: the likeliest on calibration cases (benchmarks/stated.py). They asked for no
# more than two of those: what more would do is not known.
FURTHER_FAULT_FACTOR, MAX_FURTHER_FAULTS = 12.0, 2
# Such a thing may be a part that is not as its file says: off by an order of magnitude more than
# its tolerance (twice that costs 0.7 nats). Effects say so of these parts, where they are asked.
FAR_PART_FACTOR = 10.0
EFFECT_OF_PART = {'stiffness': 'link_stiffness', 'damping': 'modal_damping',
           'drive_inertia': 'hub_inertia', 'elbow_inertia': 'hub_inertia',
           'drive_gain': 'actuator_gain'}


@dataclass(frozen=True)
class PartPrior:
    """
    A part of the robot, its sensors or its payload, with a Gaussian prior around the file.

    Attributes
    ----------
    name : str
    tolerance : float
        Standard deviation of the deviation, in `unit`; of a logarithm where that is empty.
    unit : str
    change : Callable
        (robot, deviation) -> robot.
    effect : Callable or None
        deviation -> Effect, where the parameter is not the robot's.
    settles : bool
        Whether an extended robot is taken to have it; the payload is not the robot's.

    """

    name: str
    tolerance: float
    unit: str
    change: Callable[[Robot, float], Robot]
    effect: Callable[[float], Effect] | None = None
    in_robot: bool = True


def part_priors(robot: Robot, payload: float) -> tuple[PartPrior, ...]:
    """Return all that a healthy robot of this make may differ in, payload, kg, included."""
    t = robot.tolerances
    found = [PartPrior(part.name, part.tolerance, part.unit, part.change)
             for part in robot_parts(robot)]
    found += [_effect_prior('strain_gain', gauge, t.strain_gain, 1.0, 1.0)
              for gauge in robot.gauge_names]
    found += [_effect_prior('strain_bias', gauge, t.strain_bias, 0.0, 1.0, unit='m/m')
              for gauge in robot.gauge_names]
    found.append(_effect_prior('payload_mass', 'arm', t.payload, 0.0, max(payload, 1e-3),
                            in_robot=False))
    return tuple(part for part in found if part.tolerance > 0.0)


def parts_without_effect(robot: Robot, parts: Sequence[PartPrior], considered: Collection[str]
              ) -> tuple[str, ...]:
    """Return the parts of which no effect asked says that they are far off, by name."""
    return tuple(part.name for part in parts if _effect_of_part(robot, part.name) not in considered)


def _effect_of_part(robot: Robot, part: str) -> str:
    kind, _, number = part.partition(':')[0].rpartition('_')
    if kind == 'drive_damping':
        loop = robot.drives[int(number) - 1].closed_loop
        return 'drive_bandwidth' if loop else 'viscous_friction'
    whole = part.partition(':')[0]
    return EFFECT_OF_PART.get(kind if number.isdigit() else whole, whole)


class FactorOnPart(NamedTuple):
    """A part, and the power of a factor that does what the part's deviation d does: exp(p d)."""

    part: Part
    power: float


def factors_on_parts(robot: Robot) -> dict[str, FactorOnPart]:
    """
    Return 'identifier:site' of what is a factor on a part of a robot, to that part.

    What such an effect does the part does as well, at any size: no record parts the two.
    """
    found = {}
    for part in robot_parts(robot):
        effect = catalogue().get(_effect_of_part(robot, part.name))
        if effect is not None and effect.parameters[0].null == 1.0:
            site, = (site for site in sites(effect, robot) if site[-1] == part.name[-1])
            # A velocity loop that is slower by a factor damps less by it.
            power = -1.0 if effect.identifier == 'drive_bandwidth' else 1.0
            found[f'{effect.identifier}:{site}'] = FactorOnPart(part, power)
    return found


def with_deviations(robot: Robot, parts: Sequence[PartPrior], deviations: Array
             ) -> tuple[Robot, tuple[Effect, ...]]:
    """Return a robot with deviations (p,), and the effects that stand for the others of them."""
    effects = []
    for part, value in zip(parts, deviations):
        if value != 0.0 and part.effect is not None:
            effects.append(part.effect(float(value)))
        elif value != 0.0:
            robot = part.change(robot, float(value))
    return robot, tuple(effects)


def _effect_prior(identifier: str, site: str, tolerance: float, null: float, scale: float,
               unit: str = '', in_robot: bool = True) -> PartPrior:
    return PartPrior(f'{identifier}:{site}', tolerance, unit, _unchanged,
                     partial(_effect_at, identifier, site, null, scale), in_robot)


def _unchanged(robot: Robot, deviation: float) -> Robot:
    return robot


def _effect_at(identifier: str, site: str, null: float, scale: float, deviation: float
                ) -> Effect:
    return catalogue()[identifier](site, (null + scale * deviation,))


def log_prior_odds(effect: type[Effect], robot: Robot) -> float:
    """
    Return the logarithm of an effect's prior odds at one site, nats: the price of a cause.

    All identifiers are alike, and so are the sites of each and what it is one of few of: with
    the odds of n identifiers the chance of none is 1 - ANY_CAUSE.
    """
    each = 1.0 - (1.0 - PROBABILITY_ANY_CAUSE)**(1.0 / len(catalogue()))
    kinds = math.prod(len(p.starts) for p in effect.parameters if p.discrete)
    return math.log(each / (1.0 - each) / len(sites(effect, robot)) / kinds)


def unknown_odds() -> float:
    """Return the prior odds of something unknown that looks like nothing in the catalogue."""
    return (1.0 - IMITATION_SHARE) * PROBABILITY_UNKNOWN / (1.0 - PROBABILITY_UNKNOWN)


def imitation_odds(further: int = 0) -> float:
    """
    Return the odds that what looks like a set of causes is something unknown that looks like it.

    By definition no record parts the two. But the more has to be wrong at once, the less likely
    it is before any data, and one thing that is not known explains it all.

    Parameters
    ----------
    further : int
        Faults that the set asks for beyond one or two causes: more causes, something unnamed.

    """
    count = len(catalogue())
    some = count * ((1.0 - PROBABILITY_ANY_CAUSE)**(-1.0 / count) - 1.0)
    return IMITATION_SHARE * PROBABILITY_UNKNOWN / (1.0 - PROBABILITY_UNKNOWN) / some * FURTHER_FAULT_FACTOR**min(further, MAX_FURTHER_FAULTS)


def prior_table(robot: Robot) -> str:
    """Return the prior of a robot as text, a line a part, then one a parameter of an effect."""
    sizes = ((part.name, part.tolerance, part.unit) if part.unit else
             (part.name, 100.0 * part.tolerance, '%')
             for part in part_priors(robot, robot.payload_mass))
    lines = [f'{name:<24} ± {size:.3g} {unit}' for name, size, unit in sizes]
    lines += ['', f'{"effect":<30}{"parameter":<32}{"null":>8}{"typical":>10}  odds a site  unit']
    for name, effect in catalogue().items():
        known = {effect.at(site, robot): site for site in reversed(sites(effect, robot))}
        for found, site in reversed(known.items()):
            label, odds = f'{name}:{site}' * (len(known) > 1) or name, log_prior_odds(effect, robot)
            lines += [f'{label:<30}{p.name:<32}{p.null:>8.3g}{p.typical:>10.3g}  '
                      f'{math.exp(odds):<11.2g}  {p.unit}' for p in found]
    return '\n'.join([*lines, f'something that no catalogue knows: {PROBABILITY_UNKNOWN:g}'])
