"""What is proposed of a hypothesis, and what is said of it."""

from __future__ import annotations

from flex_plant_sim.diagnosis.causes.hypothesis import all_hypotheses
from flex_plant_sim.diagnosis.causes.proposal import ProposalScorer
from flex_plant_sim.diagnosis.causes.sensitivity import Sensitivity
from flex_plant_sim.diagnosis.verdict.results import ParameterValue
from flex_plant_sim.diagnosis.verdict.verdict import cause_sentence
import numpy as np
import pytest
from simulated_records import REFERENCE


def test_the_proposal_of_a_discrete_value_gains_what_that_value_does() -> None:
    # ln N of rows (8) less twice (3) a change: 0.5 |r|^2 - 0.5 |r + 2 c|^2; no more is asked.
    rng, known = np.random.default_rng(3), all_hypotheses(REFERENCE)
    two, = (h for h in known if h.label == 'modal_truncation:arm' and h.fixed_values == (3.0,))
    residual, change = rng.normal(size=(2, 8))
    sensitivity = Sensitivity(two.null, np.array([2.0]), (2.0 * change[None]).astype(np.float32))
    scorer = ProposalScorer(residual[None], np.zeros(0), np.ones(8), 28.0)
    gain = 0.5 * residual @ residual - 0.5 * np.sum((residual + 2.0 * change)**2)
    assert scorer.propose(two, [sensitivity]).linear_gain == pytest.approx(gain, abs=1e-5)
    assert np.all(np.array(scorer.propose(two, [sensitivity]).starts) == 3.0)


def test_sizes_that_do_the_same_are_parted_by_their_prior() -> None:
    """Joints that turn without a command told 1e27 of both levels; the equations were singular."""
    asymmetric = next(h for h in all_hypotheses(REFERENCE)
                      if h.label == 'asymmetric_friction:joint_1')
    change = np.full((2, 8), 1e13)
    scorer = ProposalScorer(-0.3 * change[:1], np.zeros(0), np.ones(8), 28.0)
    deviation = np.where(asymmetric.is_size, 1.0, 0.0)
    found = scorer.propose(asymmetric, [
        Sensitivity(asymmetric.null, deviation, change.astype(np.float32))])
    best = found.starts[0][asymmetric.is_size]
    assert np.isfinite(found.linear_gain) and best == pytest.approx([0.15, 0.15], rel=0.1)


@pytest.mark.parametrize('label, probe, best', [
    # Late by 5 to 80 ms, on one side of null; a share of 80 ms is at least the next probe.
    ('strain_delay:arm', 4, 0.04), ('strain_delay:arm', 2, 0.01), ('strain_delay:arm', 0, 0.0005),
    # With probes on both sides, of a quarter less to 0.45 more, each tells of its own.
    ('angle_gain:joint_2', 3, 1.06), ('angle_gain:joint_2', 0, 0.994),
    # What is linear is told by one probe.
    ('actuator_bias:joint_1', 0, None)])
def test_a_probe_tells_what_sizes_change_up_to_the_next_probes(
        label: str, probe: int, best: float | None) -> None:
    """A share of what 80 ms change promised 12 nats of 2.6 ms, which cost 9."""
    known = next(h for h in all_hypotheses(REFERENCE) if h.label == label)
    # By itself, the residual is least at a tenth of the probe.
    deviation, change = known.probe_deviations()[probe], np.full((1, 8), 1e4)
    scorer = ProposalScorer(-0.1 * change, np.zeros(0), np.ones(8), 28.0)
    found = scorer.propose(known, [Sensitivity(known.null, deviation, change.astype(np.float32))])
    size = found.starts[0][known.is_size]
    expected = known.null + 0.1 * deviation if best is None else best
    assert size == pytest.approx(np.broadcast_to(expected, known.is_size.shape)[known.is_size])


def test_a_filter_is_said_by_how_late_slow_strains_come() -> None:
    """One lag of 12 ms is fitted by an order of two as 2 ms and much damping."""
    hypothesis, = (h for h in all_hypotheses(REFERENCE) if h.label == 'strain_filter:arm')
    values = [ParameterValue('time_constant_s', 0.002, 0.001, 0.003, 's'),
              ParameterValue('damping', 3.0, 2.0, 4.0, '')]
    assert 'so that slow strains come 12 ms late' in cause_sentence(hypothesis, values)
