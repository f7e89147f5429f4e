"""
Sets with laws of unnamed torques, ranked by how their models run freely over the fitted part.

A law is a table fitted to a smoothed torque. One step ahead, a set is judged by what the table
rounds off, which goes with the motion and is no white noise: over twelve sets found on the
measured Quanser arm, up to 1400 nats apart, evidence and free runs have a rank correlation of
-0.03. A model with such a table is there to simulate, so it is judged by what it simulates. That
each window counts as one independent draw is an assumption, not calibrated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.posterior import (
    log_prior_odds_of_causes,
    Posterior,
)
from flex_plant_sim.diagnosis.causes.refined_fit import RefinedFit
from flex_plant_sim.diagnosis.pool import all_of, attempt
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.free_run import horizon_errors, HORIZONS
from flex_plant_sim.diagnosis.prediction.latent_view import law_effect, torque_laws
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.data import Data
import numpy as np

# Runs of a record at most. (With twice as many, the scores of six sets on the measured arm, see
# `free_run_score`, are 0.8 nats off at most.)
MAX_RUNS = 60


def ranked_by_free_runs(sets: Sequence[RefinedFit], log_likelihoods: Array, nominal: BaseModel
                        ) -> tuple[RefinedFit, Posterior]:
    """
    Return the most probable set by its free runs, and the posterior over all of them.

    Parameters
    ----------
    sets : sequence of RefinedFit
        At least one.
    log_likelihoods : Array
        Of their free runs, (S,), see `free_run_log_likelihoods`.
    nominal : BaseModel
        The model in question.

    """
    prices = np.array([log_prior_odds_of_causes(chosen.fit, nominal) for chosen in sets])
    # Where every model diverges, the prior odds are all that is known.
    score = prices + (log_likelihoods if np.any(np.isfinite(log_likelihoods)) else 0.0)
    # One-step nats say nothing here, of single windows no more than of all.
    fits = [replace(chosen.fit, window_log_likelihoods=np.zeros(0)) for chosen in sets]
    best = int(np.argmax(score))
    return replace(sets[best], fit=fits[best]), Posterior.from_scores(fits, score, nominal)


def free_run_log_likelihoods(sets: Sequence[RefinedFit], data: Data, nominal: BaseModel,
                             jobs: int, progress: Callable[[float], None] = lambda share: None
                             ) -> Array:
    """
    Return the log-likelihood of each set's free runs, with laws of what it leaves, nats, (S,).

    Parameters
    ----------
    sets : sequence of RefinedFit
        Refined.
    data : Data
        The records.
    nominal : BaseModel
        The model in question.
    jobs : int
        Processes.
    progress : Callable
        Called with the share of the sets that have run.

    """
    def log_likelihood(candidate: RefinedFit) -> float:
        rms = attempt(lambda fit: free_run_rms(with_own_laws(fit, data, nominal), data), candidate)
        return -np.inf if rms is None else free_run_score(rms, windows)

    windows = sum(work.starts.size for work in data.windows)
    return np.array(all_of(log_likelihood, sets, jobs, progress))


def with_own_laws(chosen: RefinedFit, data: Data, nominal: BaseModel) -> BaseModel:
    """Return a set's model with the laws that hold of the torques that it leaves."""
    extended = chosen.extended_model(nominal)
    laws = torque_laws([Predictor(extended, windows, noise)
                        for windows, noise in zip(data.locked, data.noise)])
    return replace(extended, effects=(*extended.effects, *map(law_effect, laws)))


def free_run_rms(model: BaseModel, data: Data) -> Array:
    """Return the root mean square errors of free runs over the fitted windows, (H, m)."""
    found = [horizon_errors(Predictor(model, windows, noise), HORIZONS, MAX_RUNS)
             for windows, noise in zip(data.windows, data.noise)]
    shared = [h for h in HORIZONS if all(h in errors for errors in found)]
    with np.errstate(over='ignore', invalid='ignore'):
        return np.array([np.sqrt(np.mean(np.concatenate([errors[h] for errors in found])**2, 0))
                         for h in shared])


def free_run_score(rms: Array, windows: int) -> float:
    """
    Return the composite log-likelihood of free runs, nats but for a constant.

    Errors at one horizon in a window are one draw of a Gaussian whose scale is not known: with
    its most likely scale, W windows give -W ln(rms) a channel. Horizons see the same stretches,
    so that their mean counts (C. Varin, N. Reid and D. Firth, Statistica Sinica 21 (2011)).

    Parameters
    ----------
    rms : Array
        By horizon and channel, (H, m).
    windows : int
        W, each of several periods of the slowest mode.

    """
    if not np.all(np.isfinite(rms)):
        return -np.inf
    return float(-windows * np.sum(np.mean(np.log(rms), axis=0)))
