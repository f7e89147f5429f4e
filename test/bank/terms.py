"""A hidden effect in the catalogue's terms: site, and parameters where they can be compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from truth.effects.hidden_effect import Parameters
from truth.records import COLUMNS, TruthCase

# Effective height of the links in the air, m.
HEIGHT = 0.052


@dataclass(frozen=True)
class Term:
    """
    An effect in the terms of the catalogue.

    Attributes
    ----------
    name, site : str
    values : dict
        True value of each parameter; empty where truth and catalogue describe the effect in
        quantities that cannot be compared (a coefficient per height against one per area).
    size : float
        Deviation from null of the quantity in which the detection limit is stated; NaN where
        unknown.

    """

    name: str
    site: str
    values: dict[str, float] = field(default_factory=dict)
    size: float = float('nan')


def hidden_terms(case: TruthCase) -> tuple[Term, ...]:
    """Return the hidden effects of a case in the catalogue's terms."""
    return tuple(_term(case, name, parameters) for name, parameters in case.effects)


def _term(case: TruthCase, name: str, size: Parameters) -> Term:
    site, values, deviation = _SAID[name](case, size)
    return Term(name, site, values, deviation)


def _joint(size: Parameters) -> str:
    return f'joint_{int(size["joint"])}'


def _link(size: Parameters) -> str:
    return f'link_{int(size["link"])}'


def _gauge(case: TruthCase, size: Parameters, key: str = 'gauge') -> str:
    return COLUMNS[case.robot][4 + int(size[key])]


Said = Callable[[TruthCase, Parameters], tuple[str, dict[str, float], float]]


def _at_joint(ours: str, theirs: str, null: float = 0.0) -> Said:
    return lambda case, p: (_joint(p), {theirs: p[ours]}, abs(p[ours] - null))


def _at_link(ours: str, theirs: str, null: float = 0.0) -> Said:
    return lambda case, p: (_link(p), {theirs: p[ours]}, abs(p[ours] - null))


def _at_gauge(ours: str, theirs: str, null: float = 0.0) -> Said:
    return lambda case, p: (_gauge(case, p), {theirs: p[ours]}, abs(p[ours] - null))


def _for_arm(ours: str, theirs: str) -> Said:
    return lambda case, p: ('arm', {theirs: p[ours]}, abs(p[ours]))


def _late_commands(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    site = 'joint_2' if 'one_drive' in case.forms else 'arm'
    return site, {'delay_s': p['delay']}, p['delay']


def _late_site(case: TruthCase) -> str:
    """Return the site of a filter or delay: the gauges that it acts on."""
    if 'one_gauge' in case.forms:
        return COLUMNS[case.robot][5]
    return 'link_2' if 'lower_gauges' in case.forms else 'arm'


def _late(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    return _late_site(case), {'delay_s': p['delay']}, p['delay']


def _lag(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    inside = 'inside_loop' in case.forms
    lag = p['time_constant']
    return _joint(p), {} if inside else {'time_constant_s': lag}, lag


def _flexible(site: Callable[[Parameters], str]) -> Said:
    return lambda case, p: (site(p), {'compliance_rad_per_n_m': 1.0 / p['stiffness']},
                            1.0 / p['stiffness'])


def _asymmetric(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    values = {'forward_n_m': p['forward'], 'backward_n_m': p['backward']}
    return _joint(p), values, max(values.values())


# The size is the whole level near rest, where joints reverse and dry friction shows.
def _stribeck(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    return _joint(p), {'level_n_m': p['sliding'], 'extra_n_m': p['extra'],
                       'speed_rad_per_s': p['speed']}, p['sliding'] + p['extra']


def _presliding(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    # LuGre's bristles and a slipping spring have the same level, but reach it in another way.
    return _joint(p), {'level_n_m': p['torque']}, p['torque']


def _ripple(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    return _joint(p), {'sine_n_m': p['torque'] * np.cos(p['phase']),
                       'cosine_n_m': p['torque'] * np.sin(p['phase']),
                       'periods_per_turn': p['order']}, p['torque']


def _spring(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    # The torque of a hose across the elbow is not linear in the angle.
    hose = 'hose' in case.forms
    values = {} if hose else {'stiffness_n_m_per_rad': p['stiffness'], 'rest_rad': p['rest']}
    return 'joint_2' if hose else _joint(p), values, p['stiffness']


def _saturation(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    return _joint(p), {'inverse_limit': 1.0 / p['limit']}, 1.0 / p['limit']


def _crosstalk(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    return _gauge(case, p, 'to_gauge'), {'share': p['share'], 'source': p['from_gauge']}, abs(
        p['share'])


def _gauge_gain(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    # A gain that warms up creeps less and less, and not as the catalogue has it.
    values = {} if 'warming' in case.forms else {'factor': p['factor']}
    return _gauge(case, p), values, abs(p['factor'] - 1.0)


def _filter(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    # A first-order filter is one of second order with two real poles, one of them far away.
    values = {} if 'first_order' in case.forms else {
        'time_constant_s': 1.0 / p['cutoff'], 'damping': p['damping']}
    return _late_site(case), values, 1.0 / p['cutoff']


def _tilt(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    return 'arm', {'tilt_x_rad': p['tilt_x'], 'tilt_y_rad': p['tilt_y']}, max(
        abs(p['tilt_x']), abs(p['tilt_y']))


def _base(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    return 'arm', {'compliance_rad_per_n_m': 1.0 / p['stiffness'],
                   'inertia_kg_m2': p['stiffness'] / p['frequency']**2}, 1.0 / p['stiffness']


def _slide(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    return 'arm', {'compliance_m_per_n': 1.0 / p['stiffness'],
                   'mass_kg': p['mass']}, 1.0 / p['stiffness']


def _payload_mass(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    deviation = case.payload_true - case.payload_told
    return 'arm', {'deviation_kg': deviation}, abs(deviation)


def _payload_change(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    change = p['mass'] - case.payload_true
    if 'leak' in case.forms:
        return 'arm', {'change_kg': change}, abs(change)
    return 'arm', {'change_kg': change, 'time_s': p['time'],
                   'duration_s': p['duration']}, abs(change)


def _loose(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    share = 0.5 if 'half_loose' in case.forms else 1.0
    compliance = 1.0 / (share * case.payload_true * p['frequency']**2)
    return 'arm', {'compliance_m_per_n': compliance,
                   'damping_ratio': p['damping_ratio']}, compliance


def _air_drag(case: TruthCase, p: Parameters) -> tuple[str, dict[str, float], float]:
    # Half of density times drag coefficient times the links' height, 0.05 m and a little more.
    return 'arm', {}, 2.0 * p['coefficient'] / HEIGHT


def _unsized(site: str) -> Said:
    return lambda case, p: (site, {}, float('nan'))


_SAID: dict[str, Said] = {
    'coulomb_friction': _at_joint('torque', 'level_n_m'),
    'viscous_friction': _at_joint('coefficient', 'damping_n_m_s'),
    'asymmetric_friction': _asymmetric,
    'stribeck_friction': _stribeck,
    'presliding_friction': _presliding,
    'backlash': _at_joint('gap', 'gap_rad'),
    'gear_compliance': _flexible(_joint),
    'torque_ripple': _ripple,
    'joint_spring': _spring,
    'actuator_gain': _at_joint('factor', 'factor', 1.0),
    'actuator_bias': _at_joint('bias', 'bias'),
    'actuator_dead_zone': _at_joint('half_width', 'half_width'),
    'actuator_saturation': _saturation,
    'motor_lag': _lag,
    'drive_bandwidth': _at_joint('factor', 'time_constant_factor', 1.0),
    'drive_integral': _at_joint('rate', 'integral_rate_per_s'),
    'input_delay': _late_commands,
    'angle_delay': _at_joint('delay', 'delay_s'),
    'angle_gain': _at_joint('factor', 'factor', 1.0),
    'angle_offset': _at_joint('offset', 'offset_rad'),
    'strain_bias': _at_gauge('bias', 'bias'),
    'strain_drift': _at_gauge('rate', 'drift_per_s'),
    'strain_gain': _gauge_gain,
    'strain_crosstalk': _crosstalk,
    'strain_filter': _filter,
    'strain_delay': _late,
    'link_stiffness': _at_link('factor', 'factor', 1.0),
    'modal_damping': _at_link('factor', 'factor', 1.0),
    'air_drag': _air_drag,
    'clamp_compliance': _flexible(_link),
    'base_tilt': _tilt,
    'base_compliance': _base,
    'base_sliding': _slide,
    'coriolis_centripetal': _unsized('arm'),
    'modal_truncation': _unsized('arm'),
    'hub_inertia': lambda case, p: ('elbow', {'inertia_kg_m2': p['inertia']}, p['inertia']),
    'payload_mass': _payload_mass,
    'payload_inertia': _for_arm('inertia', 'inertia_kg_m2'),
    'payload_offset': _for_arm('beyond', 'offset_m'),
    'payload_beside': _for_arm('beside', 'beside_m'),
    'payload_change': _payload_change,
    'loose_payload': _loose,
}
