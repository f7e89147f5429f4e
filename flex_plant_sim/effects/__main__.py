"""Print the catalogue as the page docs/effects.md: `python -m flex_plant_sim.effects`."""

from __future__ import annotations

import math

from flex_plant_sim.effects import catalogue, GAUGE_SITES, SITES
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.parameter import Parameter

HEAD = """# Effects

Made by `python -m flex_plant_sim.effects`; each effect is one file in its family's
folder of `flex_plant_sim/effects/`.

The same object extends the simulator, the predictor and the diagnosis. A robot file names effects
under `effects:` (a list of `name`, `site` and the parameters), and `plant_sim` takes them as
`identifier:site:parameter=number,…`. A null value means that the effect is absent. `smallest` is
the deviation from null that matters in practice; where it is empty, the
parameter only shapes the effect. `typical` is the standard deviation of the prior around null,
known to a factor of two but for the sizes of events; a
time may be anywhere in the record, `one of them` stands where nature has one of the starts, and
`or null` where null is as probable as all else.

All numbers are those of the reference robot (0.98 kg, 1.1 m of reach). On another they are
multiplied by what their unit is worth there, at the same pace (`robot_scale.py`): kg by the mass m
of links and elbow, kg m^2, N m and N m/rad by m times the reach squared, rad/(N m) and m/N by the
inverses; N m s/rad by that torque with the drive's own damping, commands by what asks the drive
for as much, or its limit. So an arm three times as long and twenty times as heavy gets the same
answers.
`flex_robot prior ROBOT` prints what holds for a robot.
"""
TABLE = """
| effect | acts on | parameter | unit | null | bounds | fits start at | smallest | typical |
|---|---|---|---|---|---|---|---|---|
"""


def page() -> str:
    """Return the page, with one section for each family."""
    families = dict.fromkeys(effect.family for effect in catalogue().values())
    return HEAD + ''.join(_section(family) for family in families)


def _section(family: str) -> str:
    effects = [effect for effect in catalogue().values() if effect.family == family]
    rows = ''.join(_row(effect, k) for effect in effects for k in range(len(effect.parameters)))
    meaning = ''.join(f'- `{effect.identifier}`: {_sentence(effect)}\n' for effect in effects)
    return f'\n## {family[0].upper()}{family[1:]}\n\n{meaning}{TABLE}{rows}'


def _sentence(effect: type[Effect]) -> str:
    place = {'amplifier': 'gauges', 'velocity_loop': 'joint', 'hub': 'joint'}.get(
        effect.sites, effect.sites)
    text = effect.explanation.format(site=f'the {place}')
    meanings = ''.join(f' `{p.name}`: {p.meaning}.' for p in effect.parameters if p.meaning)
    return text.replace(f'{place} the {place}', place).replace('the the', 'the') + meanings


def _row(effect: type[Effect], k: int) -> str:
    parameter = effect.parameters[k]
    name = f'`{effect.identifier}`' if k == 0 else ''
    sites = _sites(effect) if k == 0 else ''
    smallest = f'{parameter.smallest:g}' if math.isfinite(parameter.smallest) else ''
    typical = f'{parameter.typical:g}' if math.isfinite(parameter.typical) else ''
    typical = 'one of them' if parameter.discrete else typical + ' or null' * parameter.switched
    return (f'| {name} | {sites} | `{parameter.name}` | {parameter.unit} | {parameter.null:g} '
            f'| {parameter.low:g} to {parameter.high:g} | {_starts(parameter)} | {smallest} '
            f'| {typical} |\n')


def _sites(effect: type[Effect]) -> str:
    places = [*SITES[effect.sites], *(['each gauge'] if effect.sites in GAUGE_SITES else [])]
    where = ' with a velocity loop' if effect.sites == 'velocity_loop' else ''
    return ', '.join(places) + where


def _starts(parameter: Parameter) -> str:
    values = [f'{value:g}' for value in parameter.starts]
    return ', '.join(values) if len(values) < 8 else f'{values[0]}, {values[1]}, …, {values[-1]}'


if __name__ == '__main__':
    print(page(), end='')
