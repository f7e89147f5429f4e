"""The cases of the bank: which effect is hidden, in which form, and what the right answer is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from truth.effects import CATALOGUE
from truth.records import draw_case, FINITE_ELEMENTS, MUJOCO, TruthCase
from truth.tolerances import GOOD, TOLD


@dataclass(frozen=True)
class Realisation:
    """
    A form in which nature may have an effect.

    Attributes
    ----------
    simulator : str
        The simulator that makes the record: finite_elements or mujoco.
    form : str
        A key of `truth.forms.FORMS`, empty for the simulator's plain one.
    calibration : bool
        Whether constants may be tuned on it; all are scored, on seeds of their own.

    """

    simulator: str
    form: str = ''
    calibration: bool = False

    @property
    def label(self) -> str:
        """Return simulator:form."""
        return f'{self.simulator}:{self.form}' if self.form else self.simulator


# Seeds and forms for tuning are kept apart from those that score. Tune only on seeds from 1000 on
# and on the forms marked `calibration`; score on seeds from 5000 on, with all forms. Clean arms of
# any other simulator may set the amplitudes of the model's discrepancy: they hide nothing.
FIRST_SEED = {'calibration': 1000, 'scoring': 5000}
ELEMENTS = Realisation(FINITE_ELEMENTS, calibration=True)
CHAIN = Realisation(MUJOCO, calibration=True)
PLAIN = (ELEMENTS, CHAIN)
# Forms of dry friction: a spring too short to be seen (elements), a constraint solver (chain),
# LuGre's bristles (chain).
DRY_FORMS = (*PLAIN, Realisation(MUJOCO, 'bristles'))
# Forms of a filter or delay of the gauges: on all, on the lower link's, on one.
LATE_FORMS = (*PLAIN, Realisation(MUJOCO, 'lower_gauges'),
              Realisation(FINITE_ELEMENTS, 'one_gauge'))
FORMS_OF: dict[str, tuple[Realisation, ...]] = {
    'coulomb_friction': (*DRY_FORMS, Realisation(FINITE_ELEMENTS, 'springs', True)),
    'asymmetric_friction': DRY_FORMS,
    'stribeck_friction': DRY_FORMS,
    'backlash': (*PLAIN, Realisation(FINITE_ELEMENTS, 'soft_contact', True),
                 Realisation(MUJOCO, 'soft_contact'), Realisation(MUJOCO, 'sensor_on_motor'),
                 Realisation(FINITE_ELEMENTS, 'heavy_output')),
    'gear_compliance': (*PLAIN, Realisation(FINITE_ELEMENTS, 'heavy_output'),
                        Realisation(MUJOCO, 'sensor_on_motor')),
    'motor_lag': (*PLAIN, Realisation(MUJOCO, 'inside_loop')),
    'input_delay': (*PLAIN, Realisation(MUJOCO, 'one_drive')),
    # Maxwell-slip (elements) or LuGre (chain): with bristles as short as `SHORT_TRAVEL` it is dry.
    'presliding_friction': PLAIN,
    'base_compliance': (*PLAIN, Realisation(FINITE_ELEMENTS, 'rubber'),
                        Realisation(MUJOCO, 'rubber')),
    'base_sliding': (CHAIN,),
    'payload_beside': (CHAIN,),
    # A gain that is right at first and creeps.
    'strain_gain': (*PLAIN, Realisation(MUJOCO, 'warming')),
    'strain_filter': (*LATE_FORMS, Realisation(FINITE_ELEMENTS, 'first_order', True),
                      Realisation(MUJOCO, 'first_order')),
    'strain_delay': LATE_FORMS,
    'payload_change': (*PLAIN, Realisation(FINITE_ELEMENTS, 'leak')),
    'loose_payload': (*PLAIN, Realisation(MUJOCO, 'half_loose')),
    'joint_spring': (*PLAIN, Realisation(MUJOCO, 'hose')),
}
# Effects added after rounds had been scored: they come last in a round and serve in no other kind
# of case, so that the earlier cases keep their records.
LATER = ('joint_spring', 'angle_delay', 'payload_offset', 'payload_beside', 'drive_integral')
# A second right name of an effect in a certain form.
ALSO_RIGHT: dict[tuple[str, str], str] = {
    ('coulomb_friction', 'bristles'): 'presliding_friction',
    ('coulomb_friction', 'springs'): 'presliding_friction'}
# Effects that a robot cannot have: a velocity loop where drives take a current; and Coriolis
# forces where drives are limited as in its file, so that the arm is too slow for them to show (0.7
# nats on a record at the limit).
IMPOSSIBLE: dict[str, tuple[str, ...]] = {
    'quanser_2dsfl': ('drive_bandwidth', 'drive_integral', 'coriolis_centripetal')}
# Sizes of hidden effects, in detection limits.
SIZES = (4.0, 2.0, 1.0)
# Effects that are always present in nature, and the options of flex_diagnose whose model leaves
# them out: that is what such a case hides.
MODEL_OPTIONS: dict[str, tuple[str, ...]] = {
    'coriolis_centripetal': ('--no-coriolis',),
    'modal_truncation': ('--model', 'paper', '--modes', '1')}
# Effects that such a model leaves out as well.
LEFT_OUT_TOO: dict[str, tuple[str, ...]] = {'modal_truncation': ('coriolis_centripetal',)}
PAIRS = (
    ('coulomb_friction', 'strain_filter'), ('input_delay', 'link_stiffness'),
    ('viscous_friction', 'strain_gain'), ('payload_mass', 'coulomb_friction'),
    ('base_tilt', 'strain_drift'), ('motor_lag', 'strain_delay'),
    ('actuator_gain', 'modal_damping'), ('backlash', 'strain_bias'),
    ('torque_ripple', 'payload_inertia'), ('angle_gain', 'clamp_compliance'),
    ('actuator_dead_zone', 'loose_payload'), ('stribeck_friction', 'payload_change'))
TAKEN_OUT = tuple(name for name in CATALOGUE
                  if name not in (*MODEL_OPTIONS, 'base_sliding', *LATER))
CONTROLS = ('noise_only', 'shuffled_residuals', 'swapped_strain_labels', 'swapped_joint_labels')
POOR = ('coulomb_friction', 'link_stiffness', 'payload_mass', 'strain_filter')
SEEDS_PER_ROUND = 100
# Cases of each kind in a round, beside one of every identifier; clean ones as (reference, other
# robot).
SECOND_ROBOT, CLEAN, MISSING, PAIRED = 6, (10, 2), 5, 4


@dataclass(frozen=True)
class BankCase:
    """
    One case of the bank.

    Attributes
    ----------
    kind : str
        one, clean, missing, pair, poor or control.
    names : tuple of str
        The hidden effects; the kind of a control.
    robot : str
    seed : int
    realisation : Realisation
    size : float
        Size of the hidden effects, in detection limits; 0 where they are not sized.
    seconds : float
        Length of the record, s.

    """

    kind: str
    names: tuple[str, ...]
    robot: str
    seed: int
    realisation: Realisation = ELEMENTS
    size: float = SIZES[0]
    seconds: float = 40.0

    @property
    def key(self) -> str:
        """Return a name of the case, without spaces."""
        size = f'x{self.size:g}/' if self.size else ''
        return (f'{self.kind}/{"+".join(self.names) or "nothing"}/{self.realisation.label}/{size}'
                f'{self.robot}/{self.seed}')

    def truth(self, severity: float = 1.0) -> TruthCase:
        """Return the true arm's case; `severity` scales what is hidden."""
        hidden = None if self.kind == 'control' or not self.names else self.names
        excitation = 'rich'
        if self.kind == 'poor':
            excitation = 'rest' if self.seed % 2 else 'one_joint'
        case = draw_case(hidden, self.seed, self.robot, severity, 0, self.seconds,
                         excitation)
        form = self.realisation.form
        return replace(case, simulator=self.realisation.simulator, spread=self.spread,
                       forms=(form,) if form else ())

    @property
    def spread(self) -> str:
        """Return how far parts are off: every other arm's as far as its file says."""
        # What has a fixed place in a round takes turns between rounds.
        return TOLD if (self.seed + self.seed // SEEDS_PER_ROUND) % 2 else GOOD

    @property
    def hidden(self) -> tuple[str, ...]:
        """Return all effects to be found; those that the told model leaves out, if they show."""
        besides = [other for name in self.names for other in LEFT_OUT_TOO.get(name, ())
                   if other not in IMPOSSIBLE.get(self.robot, ())]
        return (*self.names, *besides)

    @property
    def options(self) -> tuple[str, ...]:
        """Return the options that flex_diagnose gets beside the record."""
        options = [option for name in self.names for option in MODEL_OPTIONS.get(name, ())]
        if self.kind == 'missing':
            options += [f'--exclude={name}' for name in self.names]
        return tuple(options)


def realisations(name: str, use: str = 'scoring') -> tuple[Realisation, ...]:
    """Return the forms of an effect that may be used for calibration or for scoring."""
    forms = FORMS_OF.get(name, PLAIN)
    return forms if use == 'scoring' else tuple(form for form in forms if form.calibration)


def possible(robot: str) -> list[str]:
    """Return the effects that can be hidden in a robot in any simulator's plain form."""
    return [name for name in CATALOGUE if name not in (*LATER, *IMPOSSIBLE.get(robot, ()))
            and set(PLAIN) <= set(realisations(name))]


def all_cases(use: str = 'scoring', rounds: int = 9) -> Iterator[BankCase]:
    """
    Return the bank: rounds of every identifier once and some cases of each other kind.

    Each round is shuffled, so that its first cases are a sample of all kinds. Every case has a
    seed of its own.

    Parameters
    ----------
    use : str
        calibration or scoring: which seeds and which forms.
    rounds : int
        Cases of every identifier.

    """
    for number in range(rounds):
        cases = [*_singles(number, use), *_clean(use), *_others(number, use)]
        first_seed = FIRST_SEED[use] + SEEDS_PER_ROUND * number
        for seed, k in enumerate(np.random.default_rng(first_seed).permutation(len(cases)),
                                 start=first_seed):
            yield replace(cases[k], seed=seed)
        for seed, case in enumerate(_later(number, use), start=first_seed + len(cases)):
            yield replace(case, seed=seed)


def _singles(number: int, use: str) -> Iterator[BankCase]:
    for place, name in enumerate(name for name in CATALOGUE if name not in LATER):
        if realisations(name, use):
            yield _in_turn(name, place, number, use)
    names = possible('quanser_2dsfl')
    for k in range(number * SECOND_ROBOT, (number + 1) * SECOND_ROBOT):
        name = names[k % len(names)]
        forms = realisations(name, use)
        yield BankCase('one', (name,), 'quanser_2dsfl', 0, forms[number % len(forms)])


def _in_turn(name: str, place: int, number: int, use: str) -> BankCase:
    """Return a case; rounds go through forms and sizes in an order that `place` decides."""
    pairs = [(form, size) for form in realisations(name, use) for size in SIZES]
    order = np.random.default_rng([place, 19]).permutation(len(pairs))
    form, size = pairs[order[number % len(pairs)]]
    return BankCase('one', (name,), 'reference', 0, form, size)


def _later(number: int, use: str) -> Iterator[BankCase]:
    for place, name in enumerate(LATER, start=len(CATALOGUE) - len(LATER)):
        yield _in_turn(name, place, number, use)
        if name in IMPOSSIBLE['quanser_2dsfl']:
            continue
        forms = [form for form in _plain(use) if form in realisations(name)]
        yield BankCase('one', (name,), 'quanser_2dsfl', 0, forms[number % len(forms)])


def _plain(use: str) -> list[Realisation]:
    return [form for form in PLAIN if form.calibration or use == 'scoring']


def _clean(use: str) -> Iterator[BankCase]:
    for robot, count in zip(('reference', 'quanser_2dsfl'), CLEAN):
        for k in range(count):
            yield BankCase('clean', (), robot, 0, _plain(use)[k % len(_plain(use))], 0.0)


def _others(number: int, use: str) -> Iterator[BankCase]:
    plain = _plain(use)
    # 7 and 5 share no factor with the lists' lengths (34 and 12), so every entry has its turn.
    for k in range(number * MISSING, (number + 1) * MISSING):
        turn, place = divmod(k, len(TAKEN_OUT))
        # The next turn through the list takes the other simulator.
        yield BankCase('missing', (TAKEN_OUT[7 * place % len(TAKEN_OUT)],), 'reference', 0,
                       plain[(place + turn) % len(plain)])
    for k in range(number * PAIRED, (number + 1) * PAIRED):
        yield BankCase('pair', PAIRS[5 * k % len(PAIRS)], 'reference', 0, plain[k % len(plain)])
    yield BankCase('poor', (POOR[number % len(POOR)],), 'reference', 0, size=0.0)
    yield BankCase('control', (CONTROLS[number % len(CONTROLS)],), 'reference', 0, size=0.0)


def first(cases: Iterator[BankCase], only: str, count: int | None) -> list[BankCase]:
    """Return the cases whose key contains `only`, at most `count`."""
    return list(islice((case for case in cases if only in case.key), count))
