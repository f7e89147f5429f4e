"""Sizes hold over all sets that may be, and where much is left, in other records of the like."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses, Hypothesis
from flex_plant_sim.diagnosis.causes.model_averaging import (
    averaged_part_deviations,
    averaged_size_deviations,
    set_weights,
)
from flex_plant_sim.diagnosis.causes.posterior import Posterior
from flex_plant_sim.diagnosis.likelihood.evidence import ParameterPrior
from flex_plant_sim.diagnosis.likelihood.sufficient_statistics import SufficientStatistics
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.verdict.parameter_values import averaged_values, values_in_set
from flex_plant_sim.diagnosis.verdict.verdict import cause_sentence
from flex_plant_sim.interval import Z95
import numpy as np
import pytest
from scipy.stats import norm
from simulated_records import REFERENCE

EMPTY = SufficientStatistics(np.zeros((1, 1, 1)), np.zeros(0), ParameterPrior(*np.zeros((6, 0))),
                             np.zeros(0), 1.0, np.zeros(1))
MASS, = (h for h in all_hypotheses(REFERENCE) if h.label == 'payload_mass:arm')
DRAG, = (h for h in all_hypotheses(REFERENCE) if h.label == 'viscous_friction:joint_1')
CROSSTALK = tuple(h for h in all_hypotheses(REFERENCE) if h.label == 'strain_crosstalk:strain_1a')
FRICTION = tuple(h for h in all_hypotheses(REFERENCE) if h.label == 'asymmetric_friction:joint_1')
WINDOWS = 40


def found(some: tuple[tuple[float, ...], ...], probability: tuple[float, ...],
          error_scale: float = 1.0, nats: tuple[Array, ...] = (np.zeros(WINDOWS),) * 3
          ) -> Posterior:
    """Return sets: the mass's size, then that of the drag if it is there; one part at 0.1."""
    fits = [Fit((MASS, DRAG)[:len(v)], DiscrepancyModel(), np.array(v), np.array([0.1 * len(v)]),
                np.array([error_scale]), np.diag([0.2**2] * len(v) + [0.3**2]), EMPTY, 0.0,
                window_log_likelihoods=n) for v, n in zip(some, nats)]
    return Posterior(tuple(fits), np.array(probability), BaseModel(REFERENCE))


def test_what_sets_disagree_by_counts_as_they_are_probable() -> None:
    posterior = found(((1.0,), (2.0, 5.0), ()), (0.6, 0.3, 0.1))
    assert set_weights(posterior) == pytest.approx([0.6, 0.3, 0.1])
    assert averaged_size_deviations(posterior, MASS) == pytest.approx(
        [np.sqrt(0.2**2 + (2.0 - 1.0)**2 / 3.0)])
    assert averaged_part_deviations(posterior) == pytest.approx(
        [np.sqrt(0.3**2 + 0.3 * 0.1**2 + 0.1 * 0.1**2)])


def test_one_sure_set_leaves_its_own_interval() -> None:
    posterior = found(((1.0,), (2.0, 5.0)), (1.0, 0.0))
    assert averaged_size_deviations(posterior, MASS) == pytest.approx([0.2])


def test_where_much_is_left_nats_are_known_as_well_as_windows_agree() -> None:
    # 30 nats in sum, 60 of them by chance: the other set leads in three records of ten.
    apart = np.random.default_rng(3).standard_normal(WINDOWS)
    apart = 30.0 / WINDOWS + 60.0 / np.sqrt(WINDOWS) * (apart - apart.mean()) / apart.std()
    sure = (1.0, np.exp(-apart.sum()))
    both = [found(((1.0,), (2.0, 5.0)), sure, error_scale, (apart, 0.0 * apart))
            for error_scale in (1.0, 2.0)]
    assert set_weights(both[0]) == pytest.approx([1.0, 0.0], abs=1e-9)
    assert set_weights(both[1])[1] == pytest.approx(norm.cdf(-0.5), abs=0.03)
    assert averaged_size_deviations(both[1], MASS)[0] > 0.5


def of_kinds(kinds: tuple[Hypothesis, ...], some: tuple[tuple[float, ...], ...],
             probability: tuple[float, ...]) -> Posterior:
    """Return sets of one cause each, whose kinds differ in a fixed value."""
    posterior = found(some, probability)
    return replace(posterior, fits=tuple(
        replace(fit, hypotheses=(kind,)) for fit, kind in zip(posterior.fits, kinds)))


def test_a_size_is_averaged_over_what_its_cause_may_come_from() -> None:
    """Sets that name another source of the same crosstalk state its share, too."""
    posterior = of_kinds(CROSSTALK[:2], ((0.1, 2.0), (0.4, 3.0)), (0.75, 0.25))
    deviations = averaged_size_deviations(posterior, CROSSTALK[0])
    assert deviations[0] == pytest.approx(np.sqrt(0.2**2 + 0.25 * 0.3**2))


def test_a_value_of_few_is_stated_with_all_that_it_may_be() -> None:
    posterior = of_kinds(CROSSTALK, ((0.1, 2.0), (0.4, 3.0), (0.1, 4.0)), (0.7, 0.28, 0.02))
    source = averaged_values(posterior, CROSSTALK[0])[1]
    assert (source.value, source.low, source.high) == (2.0, 2.0, 3.0)
    assert dict(source.choices) == pytest.approx({'strain_1b': 0.7, 'strain_2a': 0.28})
    sentence = cause_sentence(CROSSTALK[0], averaged_values(posterior, CROSSTALK[0]))
    assert 'source strain_1b (70 %) or strain_2a (28 %)' in sentence
    alone = cause_sentence(CROSSTALK[1], values_in_set(posterior.fits[1], CROSSTALK[1]))
    assert 'source strain_2a)' in alone


def test_the_side_of_a_gear_that_a_sensor_is_on_is_said_in_words() -> None:
    gears = tuple(h for h in all_hypotheses(REFERENCE) if h.label == 'gear_compliance:joint_1')
    posterior = of_kinds(gears, ((0.1, 1.0, 0.0, 0.0), (0.4, 0.0, 0.0, 0.0)), (0.6, 0.4))
    sentence = cause_sentence(gears[0], averaged_values(posterior, gears[0]))
    assert 'sensor behind gear yes, on the link (60 %) or no, on the motor (40 %)' in sentence


def test_bounds_are_those_of_all_kinds_of_a_cause() -> None:
    """Friction that is most probably dry may have bristles that travel."""
    posterior = of_kinds(FRICTION, ((1.0, 1.0, 0.0), (1.0, 1.0, 0.02)), (0.75, 0.25))
    travel = averaged_values(posterior, FRICTION[0])[2]
    assert (travel.value, travel.low) == (0.0, 0.0)
    spread = np.sqrt(0.2**2 + 0.25 * 0.02**2)
    assert travel.high == pytest.approx(min(Z95 * spread, 0.2))
