"""
What a record tells on when its commands were logged: a recorder's mistake, not an arm's.

It completes the verdict. Commands that are logged late make an arm answer before it is told, which
no effect of the catalogue can do; logged too early, they look like an input delay, which is one.
"""

from __future__ import annotations

from dataclasses import replace
import math

from flex_plant_sim.diagnosis.causes.candidate_set import CandidateSet
from flex_plant_sim.diagnosis.causes.gauss_newton import fit_set
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.likelihood.likelihood import Likelihood
from flex_plant_sim.diagnosis.likelihood.prior import log_prior_odds
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.effects.drive.input_delay import InputDelay
import numpy as np


def with_command_timing(diagnosis: Diagnosis, nothing: RefinedFit, data: Data, jobs: int = 1
                        ) -> Diagnosis:
    """Return the diagnosis with what the set `nothing` tells on when commands were logged."""
    sentence = diagnosis.sentence
    for cause in diagnosis.causes:
        if cause.name == InputDelay.identifier:
            early = 1e3 * cause.parameters[0].value
            sentence += f' Commands logged {early:.2g} ms too early would look the same.'
    rows, gain = rows_late(nothing, data, jobs)
    if rows:
        late = 1e3 * rows * nothing.likelihood.base.robot.sample_time
        sentence = (f'The commands seem to be logged {late:.3g} ms late: moved up by as much, '
                    f'they make the record 10^{gain / math.log(10.0):.0f} times likelier. No arm '
                    'answers before it is told to, so move them and diagnose again; what follows '
                    f'is told of the log as it is. {sentence}')
    return replace(diagnosis, sentence=sentence)


def rows_late(nothing: RefinedFit, data: Data, jobs: int = 1) -> tuple[int, float]:
    """
    Return by how many rows commands are logged late, and what that gains, nats; or (0, 0.0).

    Commands act one more row earlier each time, as long as the evidence of the arm without causes
    rises, linear in its parts. What that gains is then taken with parts that are fitted anew. A
    recorder's mistake is as improbable as an input delay.
    """
    rows, best = 0, _linear_evidence(nothing.likelihood)
    # Moved by more than the warm-up, commands of the fitted windows would be locked ones.
    for more in range(1, data.windows[0].warm_up):
        found = _linear_evidence(nothing.likelihood.with_commands_moved(more))
        if not found > best:
            break
        rows, best = more, found
    gain = gain_if_moved(nothing, data, rows, jobs) if rows else 0.0
    price = -log_prior_odds(InputDelay, nothing.likelihood.base.robot)
    return (rows, gain) if gain > price else (0, 0.0)


def gain_if_moved(nothing: RefinedFit, data: Data, rows: int, jobs: int = 1) -> float:
    """Return what the arm without causes gains if commands act rows earlier, nats."""
    # Fitted alike: where much is wrong, parts that are fitted once more gain with any commands.
    as_logged, moved = (RefinedFit.refine(
        CandidateSet.of(nothing.fit), nothing.likelihood.base, data.with_commands_moved(by),
        nothing.fit.error_scale, jobs).fit.log_evidence for by in (0, rows))
    return moved - max(as_logged, nothing.fit.log_evidence)


def _linear_evidence(likelihood: Likelihood) -> float:
    """Return the log-evidence of the arm without causes, nats; -inf where it diverges."""
    try:
        return fit_set(likelihood, CauseSet((), likelihood.duration), (np.zeros(0),)).log_evidence
    except np.linalg.LinAlgError:
        return -math.inf
