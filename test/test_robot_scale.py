"""Sizes on robots of other lengths, masses and commands: answers that no unit decides."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.robot import EffectSpec, Link, Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.causes.search import search
from flex_plant_sim.diagnosis.likelihood.prior import prior_table
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.effects import build, catalogue
from msg_config.errors import InputError
import numpy as np
import pytest
from simulated_records import effects, REFERENCE, simulated, SLOWEST

LONGER, HEAVIER = 3.0, 20.0
# Powers of length and mass in each unit; the other units have neither.
POWERS = {'kg': (0, 1), 'kg m^2': (2, 1), 'N m': (2, 1), 'N m/rad': (2, 1), 'N m s/rad': (2, 1),
          'rad/(N m)': (-2, -1), 'm/N': (0, -1), 'm': (1, 0)}
CURRENT = load_robot('quanser_2dsfl')


def similar(robot: Robot) -> Robot:
    """Return an arm that moves and bends as a robot does under the same commands."""
    def link(one: Link) -> Link:
        lengths = {name: LONGER * getattr(one, name)
                   for name in ('length', 'thickness', 'height', 'hub_radius')}
        return replace(one, **lengths, youngs_modulus=one.youngs_modulus * HEAVIER / LONGER,
                       density=one.density * HEAVIER / LONGER**3,
                       gauge_positions=tuple(LONGER * x for x in one.gauge_positions))

    torque = HEAVIER * LONGER**2
    upper, lower = (link(one) for one in robot.links)
    first, second = (replace(drive, inertia=torque * drive.inertia, damping=torque * drive.damping,
                             torque_gain=torque * drive.torque_gain) for drive in robot.drives)
    known = robot.tolerances
    return replace(
        robot, name='similar', links=(upper, lower), drives=(first, second),
        elbow_mass=HEAVIER * robot.elbow_mass, elbow_inertia=torque * robot.elbow_inertia,
        payload_mass=HEAVIER * robot.payload_mass,
        payload_inertia=torque * robot.payload_inertia,
        tolerances=replace(known, gauge_position_m=LONGER * known.gauge_position_m,
                           payload_inertia_kg_m2=torque * known.payload_inertia_kg_m2))


def worth(unit: str) -> float:
    """Return what a unit is worth on the similar arm, by its dimensions."""
    length, mass = POWERS.get(unit, (0, 0))
    return float(LONGER**length * HEAVIER**mass)


@pytest.mark.parametrize('robot', [REFERENCE, CURRENT], ids=lambda robot: robot.name)
def test_what_is_conceivable_grows_as_its_unit_does(robot: Robot) -> None:
    for one, other in zip(all_hypotheses(robot), all_hypotheses(similar(robot)), strict=True):
        assert one.label == other.label
        for small, large in zip(one.parameters, other.parameters, strict=True):
            expected = small.scaled(worth(small.unit))
            for name in ('null', 'low', 'high', 'smallest', 'typical', 'starts'):
                assert getattr(large, name) == pytest.approx(getattr(expected, name), rel=1e-9)


def test_on_the_reference_robot_sizes_are_as_the_catalogue_says() -> None:
    for h in all_hypotheses(REFERENCE):
        if h.label != 'viscous_friction:joint_1':
            assert [p.typical for p in h.parameters] == [p.typical for p in h.effect.parameters]


def test_a_command_in_other_units_asks_for_the_same() -> None:
    counts = CURRENT
    for k, drive in enumerate(CURRENT.drives):
        counts = counts.with_drive(k, torque_gain=drive.torque_gain / 1000.0,
                                   command_limit=drive.command_limit * 1000.0)
    for one, other in zip(all_hypotheses(CURRENT), all_hypotheses(counts), strict=True):
        for small, large in zip(one.parameters, other.parameters, strict=True):
            power = {'command unit': 1, '1/command unit': -1}.get(small.unit, 0)
            assert large.typical == pytest.approx(1000.0**power * small.typical)


def test_a_similar_arm_gets_the_same_answer() -> None:
    asked = ('coulomb_friction', 'payload_mass', 'clamp_compliance')
    others = [name for name in catalogue() if name not in asked]
    hidden = effects('coulomb_friction:joint_1:level_n_m=0.4',
                     'payload_mass:arm:deviation_kg=0.04')
    record = simulated(hidden, 14.0)
    with np.errstate(all='ignore'):
        one, other = (search(
            Data.of([replace(record, payload=heavier * record.payload)], SLOWEST, 0.01),
            BaseModel(robot), 1, lambda *told: None, others)
            for robot, heavier in ((REFERENCE, 1.0), (similar(REFERENCE), HEAVIER)))
    assert {h.label for h in one.best.fit.hypotheses} == {
        'coulomb_friction:joint_1', 'payload_mass:arm'}
    assert one.best.fit.hypotheses != other.best.fit.hypotheses
    units = [p.unit for h in one.best.fit.hypotheses for p in h.parameters]
    assert other.best.fit.values == pytest.approx(
        one.best.fit.values * [worth(unit) for unit in units], rel=1e-3)
    for identifier in asked:
        assert other.posterior.effect_probability(identifier) == pytest.approx(
            one.posterior.effect_probability(identifier), abs=1e-3)


def test_a_robot_file_may_name_what_is_conceivable_on_its_robot() -> None:
    friction = EffectSpec('coulomb_friction', 'joint_1', {'level_n_m': 90.0})
    assert build(friction, similar(REFERENCE)).values == (90.0,)
    with pytest.raises(InputError, match='level_n_m: expected 0 to 20 N m, got 90'):
        build(friction, REFERENCE)


@pytest.mark.parametrize('robot', [REFERENCE, CURRENT], ids=lambda robot: robot.name)
def test_the_prior_is_printed_for_the_robot(robot: Robot) -> None:
    lines = [line.split() for line in prior_table(robot).splitlines()]
    levels = [float(line[3]) for line in lines if line[:2] == ['coulomb_friction', 'level_n_m']]
    known = {h.parameters[0].typical for h in all_hypotheses(robot)
             if h.effect.identifier == 'coulomb_friction'}
    assert levels == pytest.approx(sorted(known), rel=5e-3)
