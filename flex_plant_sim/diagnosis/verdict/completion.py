"""
A diagnosis completed: what latent forces and the locked part say of what `diagnose` found.

The steps stand in an order that matters: laws of what is unnamed join the extended model before it
is measured, and what the locked part refutes is unnamed from then on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from flex_plant_sim.diagnosis.pool import all_of
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.latent_view import latent_view, LatentView
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.verdict.experiments import with_experiment
from flex_plant_sim.diagnosis.verdict.improvement import Gain, measure_gain
from flex_plant_sim.diagnosis.verdict.locked_part import with_gain, with_gauges_beyond
from flex_plant_sim.diagnosis.verdict.log_hints import with_hints
from flex_plant_sim.diagnosis.verdict.results import Diagnosis
from flex_plant_sim.diagnosis.verdict.symptoms import ChannelResidual, describe
from flex_plant_sim.diagnosis.verdict.unknown import UNNAMED_VERDICTS, with_unknown
from flex_plant_sim.diagnosis.verdict.verdict import predictors
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.logs.log import Log

# Share of the time at which measuring begins, for progress: on three records of 30 s it was 0.29
# to 0.36.
MEASURING_SHARE = 0.32


@dataclass(frozen=True)
class Completed:
    """
    A whole diagnosis with what was measured for it.

    Attributes
    ----------
    diagnosis : Diagnosis
    extended : BaseModel
        The model with the causes, the estimated parts and laws of what is unnamed.
    predictors : tuple of list of Predictor
        Of the records: of the nominal model, and of the extended one.
    gains : tuple of Gain
    before, after : tuple of ChannelResidual
        Residuals of the nominal and of the extended model.
    latent : Mapping
        Latent forces `before` and, where something is unnamed, `after`.

    """

    diagnosis: Diagnosis
    extended: BaseModel
    predictors: tuple[list[Predictor], list[Predictor]]
    gains: tuple[Gain, ...]
    before: tuple[ChannelResidual, ...]
    after: tuple[ChannelResidual, ...]
    latent: Mapping[str, LatentView]


def complete(found: tuple[Diagnosis, Data, BaseModel], nominal: BaseModel, jobs: int = 1,
             progress: Callable[[str, float], None] = lambda step, share: None,
             seed: int = 0, logs: Sequence[Log] = ()) -> Completed:
    """
    Return what `diagnose` found of a nominal model, completed: the verdict may be another one.

    In `jobs` processes; `progress` is called with a step's name and its share done, the seed is
    the bootstrap's, and what was said of the logs becomes part of the answer.
    """
    diagnosis, data, extended = found
    progress('latent forces', 0.0)
    before = predictors(nominal, data)
    # Where the model was not extended, before and after are the same.
    after = before if extended == nominal else predictors(extended, data)
    unnamed = diagnosis.verdict in UNNAMED_VERDICTS
    asked = {'before': before, **({'after': after} if unnamed else {})}
    latent = dict(zip(asked, all_of(latent_view, [*asked.values()], jobs)))
    diagnosis = with_experiment(diagnosis)
    added: tuple[Effect, ...] = ()
    if unnamed:
        diagnosis, added = with_unknown(diagnosis, latent['after']), latent['after'].law_effects
    if added:
        extended = replace(extended, effects=(*extended.effects, *added))
        after = predictors(extended, data)
    progress('measuring the gain', MEASURING_SHARE)
    gains = measure_gain(before, after, seed=seed, jobs=jobs)
    described = all_of(describe, [before] if after is before else [before, after], jobs)
    wrong, left = described[0], described[-1]
    diagnosis = with_gauges_beyond(with_gain(diagnosis, gains, len(added)), left, gains)
    if diagnosis.verdict in UNNAMED_VERDICTS and not unnamed:
        # What the locked part refutes is unnamed too.
        latent['after'] = latent_view(after)
        diagnosis = with_unknown(diagnosis, latent['after'])
    return Completed(with_hints(diagnosis, logs), extended, (before, after), gains, wrong, left,
                     latent)
