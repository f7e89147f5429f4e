"""
The prior of all hypotheses: the arm's parts, the odds of causes, and what no catalogue knows.

`Likelihood` takes the parts from here, the search and `Posterior` the odds. Priors of an effect's
parameters are in `Hypothesis.prior`. `flex_robot prior ROBOT` prints all of it.
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
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Prior probability that any effect of the catalogue is at work, and that something is which no
# catalogue knows. With the latter `imitation_odds` are those that benchmarks/stated.py finds where
# faults that no effect has are as frequent as in a whole bank: 0.15, to a factor of 1.4.
PROBABILITY_ANY_CAUSE, PROBABILITY_UNKNOWN = 0.5, 0.15
# Share of unknown effects that other effects of the catalogue explain fully. Of those taken out of
# it, 39 of 73 were (test/run_bank.py --use calibration --only missing).
IMITATION_SHARE = 0.53
# Factor on the odds of such an imitation for each further fault of a set, and faults that count
# at most, as calibration cases had no more. Fitted to those by benchmarks/stated.py.
FURTHER_FAULT_FACTOR, MAX_FURTHER_FAULTS = 12.0, 2
# Faults at once that are ordinary, if at different places; the place of what concerns all of it.
ORDINARY_FAULTS, WHOLE_ARM = 2, 'arm'
# Effects that stand for a deviation of these parts; of others, the effect of the same name does.
EFFECT_OF_PART = {'stiffness': 'link_stiffness', 'damping': 'modal_damping',
                  'drive_inertia': 'hub_inertia', 'elbow_inertia': 'hub_inertia',
                  'drive_gain': 'actuator_gain'}


@dataclass(frozen=True)
class PartPrior:
    """
    A part of the robot, its sensors or its payload, with a Gaussian prior around its file's value.

    Attributes
    ----------
    name : str
    tolerance : float
        Standard deviation of the deviation, in `unit`.
    unit : str
        Empty where the deviation is one of the logarithm.
    change : Callable
        (robot, deviation) -> robot.
    effect : Callable or None
        deviation -> Effect, where the parameter is not one of the robot's.
    in_robot : bool
        Whether an extended robot gets the estimated deviation; the payload is not the robot's.

    """

    name: str
    tolerance: float
    unit: str
    change: Callable[[Robot, float], Robot]
    effect: Callable[[float], Effect] | None = None
    in_robot: bool = True


def part_priors(robot: Robot, payload: float) -> tuple[PartPrior, ...]:
    """Return all in which a healthy robot may differ from its file, payload (kg) included."""
    t = robot.tolerances
    found = [PartPrior(part.name, part.tolerance, part.unit, part.change)
             for part in robot_parts(robot)]
    found += [_effect_prior('strain_gain', gauge, t.strain_gain, 1.0, 1.0)
              for gauge in robot.gauge_names]
    found += [_effect_prior('strain_bias', gauge, t.strain_bias, 0.0, 1.0, unit='m/m')
              for gauge in robot.gauge_names]
    found.append(_effect_prior('angle_offset', 'joint_2', t.angle_zero_rad, 0.0, 1.0, unit='rad'))
    found.append(_effect_prior('payload_mass', 'arm', t.payload, 0.0, max(payload, 1e-3),
                               in_robot=False))
    return tuple(part for part in found if part.tolerance > 0.0)


def parts_without_effect(robot: Robot, parts: Sequence[PartPrior], considered: Collection[str]
                         ) -> tuple[str, ...]:
    """Return the names of the parts for whose deviation no effect considered stands."""
    return tuple(part.name for part in parts
                 if _effect_of_part(robot, part.name) not in considered)


def _effect_of_part(robot: Robot, part: str) -> str:
    kind, _, number = part.partition(':')[0].rpartition('_')
    if kind == 'drive_damping':
        loop = robot.drives[int(number) - 1].closed_loop
        return 'drive_bandwidth' if loop else 'viscous_friction'
    whole = part.partition(':')[0]
    return EFFECT_OF_PART.get(kind if number.isdigit() else whole, whole)


class FactorOnPart(NamedTuple):
    """A part, and the power p: the factor exp(p d) does the same as the part's deviation d."""

    part: Part
    power: float


def factors_on_parts(robot: Robot) -> dict[str, FactorOnPart]:
    """
    Return the effects that are a factor on a part of a robot: 'identifier:site' to that part.

    Such an effect and the part's deviation change the arm alike at any size, so that no record
    distinguishes them.
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
    """
    Return a robot with deviations (p,), and effects for those that are not the robot's.

    Raises
    ------
    LinAlgError
        A part is beyond all numbers: no finite prediction.

    """
    try:
        for part, value in zip(parts, deviations):
            if value != 0.0 and part.effect is None:
                robot = part.change(robot, float(value))
    except OverflowError:
        raise np.linalg.LinAlgError('no finite prediction') from None
    return robot, sensors_with_deviations(parts, deviations)


def sensors_with_deviations(parts: Sequence[PartPrior], deviations: Array) -> tuple[Effect, ...]:
    """Return the effects for the deviations, (p,), that are not the robot's."""
    return tuple(part.effect(float(value)) for part, value in zip(parts, deviations)
                 if value != 0.0 and part.effect is not None)


def _effect_prior(identifier: str, site: str, tolerance: float, null: float, scale: float,
                  unit: str = '', in_robot: bool = True) -> PartPrior:
    return PartPrior(f'{identifier}:{site}', tolerance, unit, _unchanged,
                     partial(_effect_at, identifier, site, null, scale), in_robot)


def _unchanged(robot: Robot, deviation: float) -> Robot:
    return robot


def _effect_at(identifier: str, site: str, null: float, scale: float, deviation: float
               ) -> Effect:
    return catalogue()[identifier].of_size(site, null + scale * deviation)


def log_prior_odds(effect: type[Effect], robot: Robot) -> float:
    """
    Return the logarithm of an effect's prior odds at one site, nats; minus the price of a cause.

    All identifiers are equally probable, and so are the sites of each and its discrete values.
    The probability that no effect is at work is 1 - PROBABILITY_ANY_CAUSE.
    """
    each = 1.0 - (1.0 - PROBABILITY_ANY_CAUSE)**(1.0 / len(catalogue()))
    places = sites(effect, robot)
    kinds = math.prod(len(p.kinds) for p in effect.at(places[0], robot))
    return math.log(each / (1.0 - each) / len(places) / kinds)


def unknown_odds() -> float:
    """Return the prior odds of something unknown that no effect of the catalogue imitates."""
    return (1.0 - IMITATION_SHARE) * PROBABILITY_UNKNOWN / (1.0 - PROBABILITY_UNKNOWN)


def further_faults(labels: Collection[str], unknown: bool) -> int:
    """
    Return the faults of a set beyond one or two ordinary ones, at different places.

    What two causes do at one joint, link or gauge one unknown thing there does alone. Of three
    bank cases that named two at one joint none had both (753 cases; it hides no such pair).

    Parameters
    ----------
    labels : collection of str
        identifier:site of each cause.
    unknown : bool
        Whether something unknown belongs to the set.

    """
    places = {site if site != WHOLE_ARM else label
              for label in labels for site in [label.partition(':')[2]]}
    return len(labels) - min(len(places), ORDINARY_FAULTS) + unknown


def imitation_odds(further: int = 0) -> float:
    """
    Return the odds that something unknown imitates a set of causes, against the set being true.

    By definition no record distinguishes the two. The more faults the set assumes at once, the
    more probable is one unknown thing in their place.

    Parameters
    ----------
    further : int
        Faults beyond the ordinary, see `further_faults`.

    """
    count = len(catalogue())
    any_cause = count * ((1.0 - PROBABILITY_ANY_CAUSE)**(-1.0 / count) - 1.0)
    one_cause = IMITATION_SHARE * PROBABILITY_UNKNOWN / (1.0 - PROBABILITY_UNKNOWN) / any_cause
    return one_cause * FURTHER_FAULT_FACTOR**min(further, MAX_FURTHER_FAULTS)


def _typical(parameter: Parameter) -> str:
    if parameter.discrete:
        return f'1 of {len(parameter.starts)}'
    return f'{parameter.typical:.3g}'


def prior_table(robot: Robot) -> str:
    """Return the prior of a robot as text: a line for each part and each effect's parameter."""
    sizes = ((part.name, part.tolerance, part.unit) if part.unit else
             (part.name, 100.0 * part.tolerance, '%')
             for part in part_priors(robot, robot.payload_mass))
    lines = [f'{name:<24} ± {size:.3g} {unit}' for name, size, unit in sizes]
    lines += ['', f'{"effect":<30}{"parameter":<32}{"null":>8}{"typical":>10}  odds a site  unit']
    for name, effect in catalogue().items():
        known = {effect.at(site, robot): site for site in reversed(sites(effect, robot))}
        for found, site in reversed(known.items()):
            label = f'{name}:{site}' * (len(known) > 1) or name
            odds = log_prior_odds(effect, robot)
            lines += [f'{label:<30}{p.name:<32}{p.null:>8.3g}{_typical(p):>10}  '
                      f'{math.exp(odds):<11.2g}  {p.unit}' for p in found]
    return '\n'.join([*lines, f'something that no catalogue knows: {PROBABILITY_UNKNOWN:g}'])
