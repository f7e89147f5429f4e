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
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.likelihood.prior import log_prior_odds
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.effects.drive.input_delay import InputDelay
import numpy as np
from scipy.special import ndtri


def with_command_timing(diagnosis: Diagnosis, best: RefinedFit, data: Data, jobs: int = 1
                        ) -> Diagnosis:
    """Return the diagnosis with what the best set tells on when commands were logged."""
    sentence = diagnosis.sentence
    for cause in diagnosis.causes:
        if cause.name == InputDelay.identifier:
            early = 1e3 * cause.parameters[0].value
            of = '' if cause.site == 'arm' else f' of {cause.site.replace("_", " ")}'
            sentence += f' Commands{of} logged {early:.2g} ms too early would look the same.'
    # Channels that are mixed up gain with any commands, and come first.
    misread = any(windows.record.misread for windows in data.windows)
    rows, gain = (0, 0.0) if misread else rows_late(best, data, jobs)
    if rows:
        late = 1e3 * rows * best.likelihood.base.robot.sample_time
        sentence = (f'The commands seem to be logged {late:.3g} ms late: moved up by as much, '
                    f'they make the record 10^{gain / math.log(10.0):.0f} times likelier. No arm '
                    'answers before it is told to, so move them and diagnose again; what follows '
                    f'is told of the log as it is. {sentence}')
    return replace(diagnosis, sentence=sentence)


def rows_late(best: RefinedFit, data: Data, jobs: int = 1) -> tuple[int, float]:
    """
    Return by how many rows commands are logged late, and what that gains, nats; or (0, 0.0).

    Commands act one more row earlier each time, as long as the evidence of the best set rises,
    linear in its parts. What that gains is then taken with causes and parts that are fitted anew:
    beside a set that lacks a cause, moved commands gain by standing for it. A recorder's mistake
    is as improbable as an input delay.
    """
    rows, highest = 0, _linear_evidence(best, 0)
    # Moved by more than the warm-up, commands of the fitted windows would be locked ones.
    for more in range(1, data.windows[0].warm_up):
        found = _linear_evidence(best, more)
        if not found > highest:
            break
        rows, highest = more, found
    gain = gain_if_moved(best, data, rows, jobs) if rows else 0.0
    price = -log_prior_odds(InputDelay, best.likelihood.base.robot)
    return (rows, gain) if gain > price else (0, 0.0)


def gain_if_moved(best: RefinedFit, data: Data, rows: int, jobs: int = 1) -> float:
    """
    Return what a set gains if commands act rows earlier, nats.

    Where errors stay large they are not white, and the gain is as uncertain as windows disagree:
    then it is the least of its 95 % interval. (Where a drive's slew rate was limited, 8.3 nats
    were 8.3 +- 10.4; with a cause left out and commands truly late, 32 +- 13.)
    """
    fit = best.fit
    # Fitted alike: where much is wrong, parts that are fitted once more gain with any commands.
    as_logged, moved = (RefinedFit.refine(
        CandidateSet.of(fit), best.likelihood.base, data.with_commands_moved(by),
        fit.error_scale, jobs).fit for by in (0, rows))
    # Without what its reading adds to the evidence that is stated, see `interpretations`.
    gain = moved.log_evidence - max(as_logged.log_evidence,
                                    fit.statistics.log_evidence(fit.error_scale))
    if not moved.has_large_errors:
        return gain
    by_window = moved.window_log_likelihoods - as_logged.window_log_likelihoods
    return gain - float(ndtri(0.975) * np.sqrt(by_window.size) * np.std(by_window))


def _linear_evidence(best: RefinedFit, rows: int) -> float:
    """Return the log-evidence if commands act rows earlier, nats; -inf where it diverges."""
    likelihood = best.likelihood.with_commands_moved(rows) if rows else best.likelihood
    try:
        return fit_set(likelihood, best.causes, (best.fit.values,),
                       best.fit.error_scale).log_evidence
    except np.linalg.LinAlgError:
        return -math.inf
