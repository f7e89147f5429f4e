"""The true effect at its true size explains a record of an independent simulator."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from flex_plant_sim.arm.robot import EffectSpec
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects import build
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import simulate, Simulator
import numpy as np
import pytest

BENCH = Path(__file__).resolve().parents[2] / 'shared' / 'data' / 'bench'
ROBOT = load_robot('reference')
HIDDEN = ('coulomb_friction', 'strain_filter', 'input_delay', 'link_stiffness', 'base_tilt',
          'payload_change', 'payload_mass')


def in_our_terms(name: str, truth: dict[str, Any]) -> Effect:
    """Return the hidden effect from the independent simulator's own terms."""
    told, size = truth['payload_told'], truth['effect']
    site, values = {
        'coulomb_friction': lambda: ('joint_2', {'level_n_m': size['coulomb'][1]}),
        'strain_filter': lambda: ('arm', {'time_constant_s': 1.0 / size['strain_filter'][0],
                                          'damping': size['strain_filter'][1]}),
        'input_delay': lambda: ('arm', {'delay_s': size['delay']}),
        'link_stiffness': lambda: ('link_2', {'factor': size['stiffness_2']}),
        'base_tilt': lambda: ('arm', {'tilt_x_rad': size['tilt_x'], 'tilt_y_rad': 0.0}),
        'payload_change': lambda: ('arm', {'change_kg': size['payload_drop'][1] - told,
                                           'time_s': size['payload_drop'][0], 'duration_s': 0.0}),
        'payload_mass': lambda: ('arm', {'deviation_kg': truth['payload_true'] - told}),
    }[name]()
    return build(EffectSpec(name, site, values), ROBOT)


def fits(record: Array, payload: float, effects: tuple[Effect, ...]) -> Array:
    """Return 100 (1 - |e| / |y - mean y|) of each channel, %."""
    arm = ExtendedArm(ROBOT, 'assumed_modes', 3, payload, effects)
    simulated, measured = simulate(Simulator(arm), record[:, 1:3])[0], record[:, 3:]
    error = np.linalg.norm(measured - simulated, axis=0)
    return 100.0 * (1.0 - error / np.linalg.norm(measured - measured.mean(axis=0), axis=0))


@pytest.mark.skipif(not BENCH.is_dir(), reason='no ../shared/data/bench beside the repository')
@pytest.mark.parametrize('name', HIDDEN)
def test_true_effect_explains_the_record(name: str) -> None:
    truths = json.loads((BENCH / 'truth.json').read_text())
    case, truth = next((key, value) for key, value in truths.items() if value['name'] == name)
    record = np.loadtxt(BENCH / f'{case}.csv', delimiter=',', skiprows=1)
    before = fits(record, truth['payload_told'], ())
    after = fits(record, truth['payload_told'], (in_our_terms(name, truth),))
    assert after.min() > 85.0 and after.min() > before.min() + 15.0
