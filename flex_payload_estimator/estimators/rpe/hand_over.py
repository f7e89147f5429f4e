"""What one filter at rest knows, handed over to those that go on when the arm moves."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.hypothesis import Filter
from flex_payload_estimator.estimators.rpe.kernel import FIRST_BIAS
import numpy as np


def hand_over(rested: Filter, f: Filter) -> None:
    """
    Let a filter know of state, gauges and noise what one at rest knows, and keep its own payload.

    The payload of the one at rest is summed out of its joint posterior: what its state owes to it
    is doubt of the state.
    """
    gauges = slice(FIRST_BIAS, rested.beta.size)
    known, owed = rested.spread[gauges, gauges], (rested.sens @ rested.spread)[:, gauges]
    slope = owed @ np.linalg.pinv(known, hermitian=True)
    whole = rested.cov + rested.sens @ rested.spread @ rested.sens.T
    f.x[:], f.cov[:], f.sens[:, gauges] = rested.x, whole - owed @ slope.T, slope
    f.beta[gauges], f.spread[gauges, gauges] = rested.beta[gauges], known
    f.record[:], f.reading[:] = rested.record, rested.reading
