"""A torque that no effect has: its law competes with the causes that would imitate it."""

from __future__ import annotations

from dataclasses import dataclass

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.posterior import is_unknown, Key
from flex_plant_sim.diagnosis.causes.search import Search, search
from flex_plant_sim.diagnosis.prediction.law import Law
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.effects import catalogue
from flex_plant_sim.effects.base import Effect, Motion
import numpy as np
import pytest
from simulated_records import effects, REFERENCE, simulated, SLOWEST

# What is hidden beside, and what imitates a brake that hardly grows with the speed.
ASKED = ('strain_gain', 'viscous_friction', 'actuator_gain', 'modal_damping')
GAUGE = 'strain_gain:strain_2a'


@dataclass(frozen=True)
class Rubbing(Effect):
    """A brake of joint 2 that saturates: what slides in a lubricant."""

    identifier = 'rubbing'
    parameters = ()
    sites = 'joint'

    def force(self, motion: Motion) -> Array:
        return -0.8 * np.tanh(motion.velocity[..., 1:2] / 0.1) * motion.form.force[:, 1]


def found_in(*hidden: Effect) -> Search:
    """Return what a search among ASKED finds in a record of 28 s."""
    data = Data.of([simulated(hidden, 28.0)], SLOWEST, REFERENCE.sample_time)
    with np.errstate(all='ignore'):
        return search(data, Base(REFERENCE), 1, lambda *told: None,
                      [name for name in catalogue() if name not in ASKED])


def test_a_law_takes_the_place_of_causes_that_imitate_it() -> None:
    found = found_in(*effects(f'{GAUGE}:factor=0.8'), Rubbing('joint_2', ()))
    best = found.best.fit
    assert Key.of(best).labels == {GAUGE} and is_unknown(best, found.posterior.nominal)
    law, = best.discrepancy.laws
    assert (law.site, law.values[0]) == ('joint_2', 'speed')
    assert best.values == pytest.approx([0.8], abs=0.02)
    # What it would be without the law: worse, however many of the others stand in its place.
    without = [fit for fit in found.posterior.fits if not fit.discrepancy.laws]
    assert best.log_evidence > max(fit.log_evidence for fit in without) + 10.0


def test_a_cause_is_asked_for_less_than_a_law_that_does_the_same() -> None:
    found = found_in(*effects(f'{GAUGE}:factor=0.8', 'viscous_friction:joint_2:damping_n_m_s=3'))
    assert Key.of(found.best.fit).labels == {GAUGE, 'viscous_friction:joint_2'}
    assert not is_unknown(found.best.fit, found.posterior.nominal)


def test_a_knot_is_asked_for_what_laplace_s_method_leaves_to_chance() -> None:
    """The integral of a Gaussian likelihood over a Gaussian prior, by quadrature."""
    size, deviation = 1.5, 0.04
    law = Law('joint_1', 'N m', 'speed', 'rad/s', np.zeros(1), np.ones(1), np.array([deviation]),
              0.9, 0.01, size, True, True)
    value = np.linspace(-8.0, 8.0, 400001) * size
    prior = np.exp(-0.5 * (value / size)**2) / (size * np.sqrt(2.0 * np.pi))
    likelihood = np.exp(-0.5 * (value / deviation)**2)
    mean = float(np.sum(prior * likelihood) * (value[1] - value[0]))
    assert law.asked == pytest.approx(-np.log(mean), rel=1e-6)
