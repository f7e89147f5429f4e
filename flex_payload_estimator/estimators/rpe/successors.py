"""The filters that trials begin with, made of what the incumbent knows."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.filter import FilterStep
from flex_payload_estimator.estimators.rpe.hypothesis import Filter, level, Mode, ROUGH, SEEK
from flex_payload_estimator.estimators.rpe.replay import DOUBT, FRESH, ROUNDS


def kept(f: Filter, mode: Mode, walk: float, stepper: FilterStep) -> Filter:
    """Return one that knows the same, in a mode and with a walk of the payload, kg/sqrt(s)."""
    new = stepper.freed(f) if walk else f.copy()
    new.mode = mode._replace(walk=walk)
    return new


def still(f: Filter, stepper: FilterStep) -> list[Filter]:
    """Return those whose payload stands still: linearised afresh, and as the parts were."""
    mode = f.mode._replace(walk=0.0)
    as_it_was = [kept(f, mode, 0.0, stepper)] if mode.parts else []
    return [_renewed(f, mode, stepper), *as_it_was]


def converted(f: Filter, mode: Mode, stepper: FilterStep) -> Filter:
    """Return a filter of another mode: with less model error all is kept, else fresh."""
    if mode.parts and f.mode.parts and level(mode) < level(f.mode):
        return kept(f, mode, 0.0, stepper)
    return _renewed(f, SEEK if mode.name == ROUGH.name else mode, stepper)


def _renewed(f: Filter, mode: Mode, stepper: FilterStep) -> Filter:
    new = stepper.renewed(f, mode, FRESH, DOUBT)
    if not mode.parts:
        # It knows of state and gauges what the past begins without.
        new.rounds = ROUNDS
    return new
