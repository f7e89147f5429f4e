"""Sizes hold over all sets that may be, and where much is left, in other records of the like."""

from __future__ import annotations

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import hypotheses
from flex_plant_sim.diagnosis.causes.over_sets import (
    deviations_of_parts,
    deviations_of_sizes,
    shares,
)
from flex_plant_sim.diagnosis.causes.posterior import Posterior
from flex_plant_sim.diagnosis.likelihood.evidence import Slab
from flex_plant_sim.diagnosis.likelihood.moments import Moments
from flex_plant_sim.diagnosis.prediction.discrepancy import Amplitude
from flex_plant_sim.diagnosis.prediction.predictor import Base
import numpy as np
import pytest
from scipy.stats import norm
from simulated_records import REFERENCE

EMPTY = Moments(np.zeros((1, 1, 1)), np.zeros(0), Slab(*np.zeros((4, 0))), np.zeros(0), 1.0,
                np.zeros(1))
MASS, = (h for h in hypotheses(REFERENCE) if h.label == 'payload_mass:arm')
DRAG, = (h for h in hypotheses(REFERENCE) if h.label == 'viscous_friction:joint_1')
WINDOWS = 40


def found(some: tuple[tuple[float, ...], ...], probability: tuple[float, ...], scale: float = 1.0,
          nats: tuple[Array, ...] = (np.zeros(WINDOWS),) * 3) -> Posterior:
    """Return sets: the mass's size, then that of the drag if it is there; one part at 0.1."""
    fits = [Fit((MASS, DRAG)[:len(v)], Amplitude(), np.array(v), np.array([0.1 * len(v)]),
                np.array([scale]), np.diag([0.2**2] * len(v) + [0.3**2]), EMPTY, 0.0,
                by_window=n) for v, n in zip(some, nats)]
    return Posterior(tuple(fits), np.array(probability), Base(REFERENCE))


def test_what_sets_disagree_by_counts_as_they_are_probable() -> None:
    posterior = found(((1.0,), (2.0, 5.0), ()), (0.6, 0.3, 0.1))
    assert shares(posterior) == pytest.approx([0.6, 0.3, 0.1])
    assert deviations_of_sizes(posterior, MASS) == pytest.approx(
        [np.sqrt(0.2**2 + (2.0 - 1.0)**2 / 3.0)])
    assert deviations_of_parts(posterior) == pytest.approx(
        [np.sqrt(0.3**2 + 0.3 * 0.1**2 + 0.1 * 0.1**2)])


def test_one_sure_set_leaves_its_own_interval() -> None:
    posterior = found(((1.0,), (2.0, 5.0)), (1.0, 0.0))
    assert deviations_of_sizes(posterior, MASS) == pytest.approx([0.2])


def test_where_much_is_left_nats_are_known_as_well_as_windows_agree() -> None:
    # 30 nats in sum, 60 of them by chance: the other set leads in three records of ten.
    apart = np.random.default_rng(3).standard_normal(WINDOWS)
    apart = 30.0 / WINDOWS + 60.0 / np.sqrt(WINDOWS) * (apart - apart.mean()) / apart.std()
    sure = (1.0, np.exp(-apart.sum()))
    both = [found(((1.0,), (2.0, 5.0)), sure, scale, (apart, 0.0 * apart)) for scale in (1.0, 2.0)]
    assert shares(both[0]) == pytest.approx([1.0, 0.0], abs=1e-9)
    assert shares(both[1])[1] == pytest.approx(norm.cdf(-0.5), abs=0.03)
    assert deviations_of_sizes(both[1], MASS)[0] > 0.5
