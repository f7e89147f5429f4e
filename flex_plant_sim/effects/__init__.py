"""
The catalogue of effects, which collects every effect defined in a module of this package.

Effects extend the arm model to the plant; the diagnosis proposes them as causes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
import importlib
import pkgutil
from types import MappingProxyType

from flex_plant_sim.arm.robot import EffectSpec, Robot
from flex_plant_sim.effects.base import Effect
from msg_config.errors import InputError

# Sites by the value of an effect's `sites`. The gauges depend on the robot and are added to those
# of GAUGE_SITES.
SITES: Mapping[str, tuple[str, ...]] = MappingProxyType({
    'joint': ('joint_1', 'joint_2'), 'link': ('link_1', 'link_2'), 'arm': ('arm',),
    'hub': ('joint_1', 'joint_2', 'elbow'), 'velocity_loop': ('joint_1', 'joint_2'),
    'drive': ('arm', 'joint_1', 'joint_2'), 'gauge': (),
    'amplifier': ('arm', 'link_1', 'link_2')})
GAUGE_SITES = ('gauge', 'amplifier')


@lru_cache(maxsize=1)
def kinds() -> Mapping[str, type[Effect]]:
    """Return all effects that a robot file may name, by identifier, in the order of families."""
    found = []
    for module in pkgutil.walk_packages(__path__, f'{__name__}.'):
        if module.ispkg or module.name == f'{__name__}.__main__':
            continue
        content = vars(importlib.import_module(module.name)).values()
        found += [item for item in content if isinstance(item, type) and issubclass(item, Effect)
                  and hasattr(item, 'identifier') and item.__module__ == module.name]
    found.sort(key=lambda item: (item.family, item.identifier))
    return MappingProxyType({item.identifier: item for item in found})


@lru_cache(maxsize=1)
def catalogue() -> Mapping[str, type[Effect]]:
    """Return the effects that are causes with a name; tables of measured forces are not."""
    return MappingProxyType({name: kind for name, kind in kinds().items() if kind.named})


def sites(effect: type[Effect], robot: Robot) -> tuple[str, ...]:
    """
    Return the sites at which an effect can act on a robot: joints, links, gauges or the arm.

    Effects of a velocity loop apply only to drives that have one. The amplifier of a link is a
    site only if it serves more than one gauge. Where a parameter has no value, there is no site.
    """
    fixed = SITES[effect.sites]
    if effect.sites == 'velocity_loop':
        return tuple(site for site, drive in zip(fixed, robot.drives) if drive.closed_loop)
    if effect.sites == 'amplifier':
        shared = [len(link.gauge_positions) > 1 for link in robot.links]
        fixed = ('arm', *(site for site, several in zip(SITES['link'], shared) if several))
        fixed = fixed if robot.gauge_names else ()
    found = (*fixed, *robot.gauge_names) if effect.sites in GAUGE_SITES else fixed
    if not any(p.discrete for p in effect.parameters):
        return found
    return tuple(site for site in found if all(p.starts for p in effect.at(site, robot)))


def build(spec: EffectSpec, robot: Robot | None = None) -> Effect:
    """
    Return the effect that a robot file specifies.

    Parameters
    ----------
    spec : EffectSpec
        Name, site and values.
    robot : Robot, optional
        Needed to check the name of a gauge and the bounds on this robot.

    Raises
    ------
    InputError
        Unknown identifier or site; a parameter that is missing, unknown or out of bounds.

    """
    if spec.name not in kinds():
        raise InputError(f'effects: expected one of {", ".join(kinds())}, got {spec.name!r}')
    effect = kinds()[spec.name]
    _check_site(effect, spec, robot)
    allowed = effect.parameters if robot is None else effect.at(spec.site, robot)
    return effect(spec.site, effect.read(spec.values, allowed))


def _check_site(effect: type[Effect], spec: EffectSpec, robot: Robot | None) -> None:
    allowed = SITES[effect.sites] if robot is None else sites(effect, robot)
    if spec.site in allowed:
        return
    at_gauges = robot is None and effect.sites in GAUGE_SITES
    if at_gauges and spec.site.startswith('strain_'):
        return
    names = [*(allowed if robot is None or allowed else ['none: this robot has no such place']),
             *(['a gauge'] if at_gauges else [])]
    raise InputError(f'effects: {spec.name}: site: expected {"one of " * (len(names) > 1)}'
                     f'{", ".join(names)}, got {spec.site!r}')


def parse(text: str) -> EffectSpec:
    """
    Return the effect that a text such as coulomb_friction:joint_2:level_n_m=0.4 specifies.

    Several parameters are separated by commas.

    Raises
    ------
    InputError
        The text has another form.

    """
    parts = text.split(':')
    pairs = [pair.partition('=') for pair in parts[2].split(',')] if len(parts) == 3 else []
    try:
        values = {name.strip(): float(value) for name, _, value in pairs}
    except ValueError:
        values = {}
    if not values:
        raise InputError(f'effect: expected identifier:site:parameter=number,…, got {text!r}')
    return EffectSpec(parts[0].strip(), parts[1].strip(), values)


def effects_of(robot: Robot) -> tuple[Effect, ...]:
    """
    Return the effects in a robot's file, ready for an ExtendedArm.

    Raises
    ------
    InputError
        See `build`; the message names the robot's file.

    """
    try:
        return tuple(build(spec, robot) for spec in robot.effects)
    except InputError as error:
        raise InputError(f'{robot.source}: {error}') from None


def as_built(robot: Robot, effects: Sequence[Effect]) -> Robot:
    """Return the robot with its parameters changed as effects say, one after the other."""
    for effect in effects:
        robot = effect.on_robot(robot)
    return robot


def explanation_at(effect: type[Effect], site: str) -> str:
    """Return the explanation of a kind of effect at a site, with the site's name in words."""
    words = site.replace('_', ' ')
    if effect.sites == 'amplifier':
        words = {'arm': 'all gauges'}.get(site, f'gauge {words}' if 'strain' in site else words)
    return effect.explanation.format(site=words)
