"""What the nodes build from their parameters: none is without effect."""

from __future__ import annotations

from typing import Any

from flex_payload_estimator.estimators.rpe.prior import CERTAIN
from flex_payload_estimator.nodes.node_setup import controller_of, estimator_of
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.simulation.plant_setup import simulator_of
from flex_plant_sim.simulation.simulator import simulate
from msg_config.errors import InputError
from msg_config.parameters import check_parameters, load_parameters, Parameter
from node_bench import another
import numpy as np
import pytest

BASE: dict[str, dict[str, Any]] = {
    'plant_sim': {'model': 'assumed_modes', 'modes': 2},
    'payload_estimator': {'model': 'paper_reduced', 'modes': 2, 'estimator': 'sf1'},
    'lqg_controller': {'model': 'paper_reduced', 'modes': 2}}
ROWS = [pytest.param(node, row, id=f'{node}-{row.name}')
        for node, table in load_parameters().items() if node in BASE
        for row in table.values() if row.applies == 'reset']
COMMANDS = np.random.default_rng(3).uniform(-1.0, 1.0, (30, 2))
OUTPUTS = np.random.default_rng(4).normal(0.0, (0.1, 0.1, 1e-5, 1e-5, 1e-5, 1e-5), (30, 6))


def answers(node: str, values: dict[str, Any]) -> Array:
    """Return what a node's computation answers to the same samples, by its parameters."""
    table = check_parameters(node, values)
    if node == 'plant_sim':
        return simulate(simulator_of(table), COMMANDS)[0].ravel()
    if node == 'payload_estimator':
        estimator = estimator_of(table)
        found = [estimator.update(0.01 * k, y, u)
                 for k, (y, u) in enumerate(zip(OUTPUTS, COMMANDS))]
        return np.array([number for a in found for number in (
            a.mass, a.variance, a.p, *a.innovation)] + [estimator.payload_max])
    controller = controller_of(table)
    sent = [controller.command(0.01 * k, y, u, 0.3, np.array([0.1, -0.1]))
            for k, (y, u) in enumerate(zip(OUTPUTS, COMMANDS))]
    return np.append(np.ravel(sent), controller.payload_max)


@pytest.mark.parametrize(('node', 'row'), ROWS)
def test_a_parameter_that_waits_for_the_reset_changes_the_answers(node: str, row: Parameter
                                                                  ) -> None:
    base = {**BASE[node], **{name: choices[0] for name, choices in row.needs.items()
                             if BASE[node].get(name) not in choices}}
    # SF1 needs a gauge a mode: fewer, not more.
    wanted = 1 if row.name == 'modes' else another(row, check_parameters(node, base)[row.name])
    before, after = answers(node, base), answers(node, {**base, row.name: wanted})
    assert before.shape != after.shape or np.abs(after - before).max() > 0.0
    np.testing.assert_array_equal(before, answers(node, base), 'chance is no effect')


@pytest.mark.parametrize('node', ['payload_estimator', 'lqg_controller'])
def test_no_range_of_payloads_is_narrower_than_one_that_is_known(node: str) -> None:
    """Where it is, what the estimator divides by its square would be by nothing."""
    assert load_parameters()[node]['payload_max'].minimum == CERTAIN
    for mass in (1e-300, 1e-30, -1.0):
        with pytest.raises(InputError) as refused:
            check_parameters(node, {'payload_max': mass})
        assert str(refused.value) == (
            f'{node}: payload_max: expected a number from 1e-09 to 1000 kg, or 0, got {mass}')
    for estimator in ('rpe', 'sf1', 'sf1_paper')[:3 if node == 'payload_estimator' else 1]:
        kind = {'estimator': estimator} if node == 'payload_estimator' else {}
        found = answers(node, {**BASE[node], **kind, 'payload_max': CERTAIN})
        assert found[-1] == CERTAIN and np.isfinite(found).all()
