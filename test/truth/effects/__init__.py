"""The catalogue of hidden effects, by identifier."""

from truth.effects import drive, joint, payload, sensor, structure
from truth.effects.hidden_effect import HiddenEffect

CATALOGUE: dict[str, HiddenEffect] = {
    effect.identifier: effect
    for family in (joint, drive, sensor, structure, payload)
    for effect in family.EFFECTS}
