"""benchmarks/diagnosis_constants.py: constants where its table has them, and what differs."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path
import sys
from typing import Any

from flex_plant_sim.diagnosis.causes import neighbours, refined_fit
from flex_plant_sim.diagnosis.verdict.results import Cause, Diagnosis, ParameterValue
import pytest
from simulated_records import effects


@pytest.fixture
def script(repository: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(repository / 'benchmarks'))
    import diagnosis_constants
    yield diagnosis_constants
    sys.modules.pop('diagnosis_constants')


def test_every_constant_is_where_the_table_has_it(script: Any) -> None:
    for name, constants in script.CONSTANTS.items():
        module = import_module(f'{script.PACKAGE}.{name}')
        assert all(isinstance(getattr(module, constant), (int, float)) for constant in constants)


def test_every_module_that_imports_a_constant_has_the_other_value(script: Any) -> None:
    with script.patched('causes.refined_fit', 'GAIN_UNCERTAINTY', 0.6):
        assert refined_fit.GAIN_UNCERTAINTY == neighbours.GAIN_UNCERTAINTY == 0.6
    assert refined_fit.GAIN_UNCERTAINTY == neighbours.GAIN_UNCERTAINTY == 0.3


def test_a_value_is_measured_from_its_neutral_one(script: Any) -> None:
    assert script.changed_value(1.05, 1.0, 2.0) == pytest.approx(1.1)
    assert [script.changed_value(*of) for of in ((60, 0, 0.5), (-1.0, 0.0, 2.0))] == [30, -2.0]


def test_cases_do_not_score(script: Any) -> None:
    cases = script.calibration_cases(script.CASES)
    assert [case.key for case in cases] == list(script.CASES)


def test_each_difference_has_its_letter(script: Any) -> None:
    size = ParameterValue('level_n_m', 1.0, 0.8, 1.2, 'N m')
    cause = Cause('coulomb_friction', 'joint_1', '', 0.88, (size,), (),
                  effects('coulomb_friction:joint_1:level_n_m=1')[0])
    told = script.Answer(Diagnosis('cause', '', (cause,),
                                   effects={'coulomb_friction': 0.88}), 10.0)

    def letters(**changes: Any) -> str:
        return str(script.difference(told, replace(
            told, diagnosis=replace(told.diagnosis, **changes))))

    assert letters() == letters(sentence='other words') == '='
    assert letters(effects={'coulomb_friction': 0.87}) == '='
    assert letters(verdict='cannot_tell', causes=()) == 'vn'
    assert letters(effects={'coulomb_friction': 0.8}) == 'p0.08'
    moved = replace(cause, parameters=(replace(size, value=1.1),))
    assert letters(causes=(moved,)) == 's'
