"""The cases of the bank: what is hidden, what the tool is told, what the right answer is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice, product

from truth.effects import CATALOGUE
from truth.records import draw_case, TruthCase

# What the best engineer could mistake for an effect when it is not in the catalogue.
DRY = ('coulomb_friction', 'asymmetric_friction', 'stribeck_friction', 'actuator_dead_zone')
ROOT = ('gear_compliance', 'clamp_compliance', 'link_stiffness', 'base_compliance')
LATE = ('input_delay', 'motor_lag', 'actuator_saturation')
OLD = ('strain_delay', 'strain_filter')
TIP = ('payload_mass', 'payload_inertia', 'hub_inertia', 'link_stiffness', 'loose_payload',
       'payload_change')
LOOK_ALIKES: tuple[tuple[str, ...], ...] = (
    DRY, ROOT, LATE, OLD, TIP,
    ('viscous_friction', 'actuator_gain', 'air_drag', 'coulomb_friction', 'angle_gain'),
    ('actuator_bias', 'base_tilt', 'asymmetric_friction', 'angle_offset'),
    ('strain_gain', 'strain_crosstalk', 'link_stiffness'),
    ('strain_bias', 'strain_drift'), ('backlash', 'gear_compliance', 'motor_lag'),
    ('modal_damping', 'air_drag', 'loose_payload', 'modal_truncation'),
    ('coriolis_centripetal', 'air_drag', 'payload_mass', 'angle_offset'))
# These are in nature always; what is hidden is that the model leaves them out.
MODEL_OPTIONS: dict[str, tuple[str, ...]] = {
    'coriolis_centripetal': ('--no-coriolis',),
    'modal_truncation': ('--model', 'paper', '--modes', '1')}
PAIRS = (
    ('coulomb_friction', 'strain_filter'), ('input_delay', 'link_stiffness'),
    ('viscous_friction', 'strain_gain'), ('payload_mass', 'coulomb_friction'),
    ('base_tilt', 'strain_drift'), ('motor_lag', 'strain_delay'),
    ('actuator_gain', 'modal_damping'), ('backlash', 'strain_bias'),
    ('torque_ripple', 'payload_inertia'), ('angle_gain', 'clamp_compliance'),
    ('actuator_dead_zone', 'loose_payload'), ('stribeck_friction', 'payload_change'))
HALF_SIZE = ('strain_filter', 'strain_delay', 'gear_compliance', 'clamp_compliance',
             'coulomb_friction', 'asymmetric_friction', 'stribeck_friction', 'input_delay',
             'motor_lag', 'payload_inertia', 'hub_inertia', 'link_stiffness')
TAKEN_OUT = tuple(name for name in CATALOGUE if name not in MODEL_OPTIONS)
CONTROLS = ('noise_only', 'shuffled_residuals', 'swapped_strain_labels', 'swapped_joint_labels')
FIRST_SEED = 1000


@dataclass(frozen=True)
class BankCase:
    """
    One case.

    Attributes
    ----------
    kind : str
        limits, one, clean, missing, pair, look_alike, poor or control.
    names : tuple of str
        What is hidden; of a control, its kind.
    robot : str
    seed : int

    """

    kind: str
    names: tuple[str, ...]
    robot: str
    seed: int

    @property
    def key(self) -> str:
        """Return the case in one word."""
        return f'{self.kind}/{"+".join(self.names) or "nothing"}/{self.robot}/{self.seed}'

    def truth(self, severity: float = 1.0) -> TruthCase:
        """Return the true arm's case; `severity` scales what is hidden."""
        hidden = None if self.kind == 'control' or not self.names else self.names
        if self.kind == 'poor':
            excitation = 'rest' if self.seed % 2 else 'one_joint'
            return draw_case(hidden, self.seed, self.robot, severity, 0, excitation=excitation)
        share = 0.5 if self.kind == 'look_alike' else 1.0
        return draw_case(hidden, self.seed, self.robot, share * severity)

    @property
    def options(self) -> tuple[str, ...]:
        """Return what flex_diagnose is told beside the record."""
        options = [option for name in self.names for option in MODEL_OPTIONS.get(name, ())]
        if self.kind == 'missing':
            options += [f'--exclude={name}' for name in self.names]
        return tuple(options)


def seeds(draws: int, offset: int = 0) -> range:
    """Return the seeds of so many draws."""
    return range(FIRST_SEED + offset, FIRST_SEED + offset + draws)


def limit_case(robot: str) -> BankCase:
    """Return the clean record that says how large an effect must be to be fair."""
    return BankCase('limits', (), robot, 1)


def all_cases(draws: int = 5, clean: int = 60) -> Iterator[BankCase]:
    """
    Return the full bank, in an order that is worth something when cut short.

    Parameters
    ----------
    draws : int
        Per identifier on the reference robot; the other robot gets a fifth, rounded up.
    clean : int
        Clean arms with tolerances on the reference robot; the other gets a fifth.

    """
    fifth = -(-draws // 5)
    for robot, count, healthy in (('reference', draws, clean),
                                  ('quanser_2dsfl', fifth, -(-clean // 5))):
        for seed, name in product(seeds(count), CATALOGUE):
            yield BankCase('one', (name,), robot, seed)
        for seed in seeds(healthy, 100):
            yield BankCase('clean', (), robot, seed)
    yield from _others(draws)


def _others(draws: int) -> Iterator[BankCase]:
    few = max(1, draws // 2)
    for seed, name in product(seeds(max(1, draws // 5), 300), TAKEN_OUT):
        yield BankCase('missing', (name,), 'reference', seed)
    for seed, pair in product(seeds(few, 400), PAIRS):
        yield BankCase('pair', pair, 'reference', seed)
    for seed, name in product(seeds(few, 500), HALF_SIZE):
        yield BankCase('look_alike', (name,), 'reference', seed)
    for seed, name in product(seeds(2, 600), ('coulomb_friction', 'link_stiffness',
                                              'payload_mass', 'strain_filter')):
        yield BankCase('poor', (name,), 'reference', seed)
    for seed, name in product(seeds(few, 700), CONTROLS):
        yield BankCase('control', (name,), 'reference', seed)


def quick_cases() -> list[BankCase]:
    """Return one clean arm and a few effects of different families."""
    names = ('coulomb_friction', 'strain_filter')
    return [BankCase('clean', (), 'reference', FIRST_SEED),
            *(BankCase('one', (name,), 'reference', FIRST_SEED) for name in names)]


def first(cases: Iterator[BankCase], only: str, count: int | None) -> list[BankCase]:
    """Return the cases whose key contains `only`, at most `count`."""
    return list(islice((case for case in cases if only in case.key), count))
