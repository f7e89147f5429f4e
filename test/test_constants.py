"""benchmarks/constants.py: another value of a constant reaches the estimator, and none stays."""

from __future__ import annotations

from pathlib import Path
import re
import sys
from typing import Any

from flex_payload_estimator.estimators.rpe import (
    competition,
    likelihood,
    outliers,
    trial,
    window_pass,
)
from flex_plant_sim.compiled import COMPILED
import numpy as np
import pytest

if COMPILED:
    from numba.core import config as numba_config


@pytest.fixture
def constants(repository: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(repository / 'benchmarks'))
    import constants as script
    yield script
    sys.modules.pop('constants')


def test_every_constant_is_where_the_table_has_it(constants: Any) -> None:
    for module, names in constants.CONSTANTS.items():
        text = (Path(trial.__file__).parent / f'{module}.py').read_text(encoding='utf-8')
        for name in names:
            assert re.search(rf'^(\w+, )*{name}(, \w+)* = |import .*\b{name}$', text, re.M), name


def test_integers_stay_integers_of_at_least_one(constants: Any) -> None:
    assert [constants.changed_value(*of) for of in ((3, 0.5), (1, 0.5), (8, 2.0))] == [2, 1, 16]
    assert constants.changed_value(3.0, 0.5) == 1.5


def test_every_module_that_imports_a_constant_has_the_other_value(constants: Any) -> None:
    with constants.patched('trial', 'SETTLING_S', 7.0):
        assert trial.SETTLING_S == window_pass.SETTLING_S == competition.SETTLING_S == 7.0
    assert trial.SETTLING_S == window_pass.SETTLING_S == competition.SETTLING_S == 0.1


def test_another_value_is_in_what_is_compiled(constants: Any) -> None:
    before = likelihood.false_alarm_threshold
    told = likelihood.false_alarm_threshold(0.01), outliers.false_alarm_threshold(0.01)
    with constants.patched('likelihood', 'FALSE_ALARM_S', 36.0):
        for module in (likelihood, outliers):
            assert module.false_alarm_threshold(0.01) == pytest.approx(np.log(3600.0))
        assert not COMPILED or likelihood.false_alarm_threshold is not before
    assert likelihood.false_alarm_threshold is before
    assert (likelihood.false_alarm_threshold(0.01), outliers.false_alarm_threshold(0.01)) == told


def test_answers_follow_a_constant_and_come_back(constants: Any, monkeypatch: pytest.MonkeyPatch
                                                 ) -> None:
    """One constant that is compiled and one of Python, whose own value then changes no bit."""
    if COMPILED:
        # Half the time of compiling, and the same bits.
        monkeypatch.setattr(numba_config, 'OPT', type(numba_config.OPT)('0'))
    records = constants.logs(1, constants.FIRST_SEED, ('matched', 'disturbed'))
    base = constants.answers(records)

    def same(module: str, name: str, value: float) -> int:
        with constants.patched(module, name, value):
            found = constants.answers(records)
        return sum(np.array_equal(a.track, b.track) for a, b in zip(base, found))

    assert same('likelihood', 'LARGEST_READING', 2.0) == 0
    assert same('window_pass', 'FIRST_PASS_S', 1.0) == 0
    assert same('window_pass', 'FIRST_PASS_S', 0.5) == 2


def test_what_differs_by_chance_has_no_star(constants: Any) -> None:
    rng = np.random.default_rng(0)
    before = rng.standard_normal(20)
    assert constants.signed_ranks(before, before * (1.0 + 1e-6)) == 1.0
    assert constants.signed_ranks(before, 1.5 * before) < 1e-4
    assert constants.signed_ranks(before, before * np.exp(0.1 * rng.standard_normal(20))) > 0.05
    none, every = np.zeros(8, dtype=bool), np.ones(8, dtype=bool)
    assert constants.mcnemar(none, none) == 1.0
    assert constants.mcnemar(none, every) == pytest.approx(2.0**-7)
    variants = [constants.Variant('A', '', (0.04, 0.5), False),
                constants.Variant('B', '', (1e-4, 1.0), False)]
    assert constants.standing(variants) == {1}
