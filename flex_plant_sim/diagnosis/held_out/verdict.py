"""From the search's course to one verdict in a sentence an engineer would say."""

from __future__ import annotations

from collections.abc import Sequence

from flex_plant_sim.diagnosis.held_out.allowance import still_wrong, WRONG
from flex_plant_sim.diagnosis.held_out.candidate_pass import Data, Round
from flex_plant_sim.diagnosis.held_out.detection import detection_limits
from flex_plant_sim.diagnosis.held_out.fit import fit_base
from flex_plant_sim.diagnosis.held_out.nuisance import settled_base
from flex_plant_sim.diagnosis.held_out.ranking import (
    candidate,
    clear_of_null,
    look_alikes,
    parameter_values,
    probabilities,
    Ranked,
)
from flex_plant_sim.diagnosis.held_out.search import Progress, Search, search
from flex_plant_sim.diagnosis.prediction.predictor import Base
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.results import Cause, Diagnosis, ParameterValue
import numpy as np

REMAINDER = 2.0
EXPLAINED = 0.5
# A cause whose interval holds its absence, beside the other causes, is at most as likely as not.
UNDETERMINED = 0.5
QUIET_STRAIN = 5.0
QUIET_ANGLE = 30.0


def diagnose(records: Sequence[Record], nominal: Base, jobs: int = 1,
             progress: Progress = lambda step, share: None,
             exclude: Sequence[str] = ()) -> tuple[Diagnosis, Data, Base]:
    """
    Return the diagnosis of records, the data it used, and the model it ends with.

    Parameters
    ----------
    records : sequence of Record
        Of one robot; the same sample time.
    nominal : Base
        See nominal_base.
    jobs : int
        Processes.
    progress : Callable
        Told a step's name and its share done.
    exclude : sequence of str
        Identifiers to leave out of the catalogue.

    Raises
    ------
    InputError
        A record too short for five windows.

    """
    data = Data.of(records, nominal)
    still = _still(records, data)
    if still:
        return _cannot_answer(still), data, nominal
    found = search(data, nominal, jobs, progress, exclude)
    fitted = fit_base(found.final)
    progress('detection limits', 0.0)
    limits = detection_limits(found.final, fitted, data.allowed, data.duration, exclude)
    progress('detection limits', 1.0)
    shown = {k: v for k, v in limits.items() if np.isfinite(v[0])}
    blind = tuple(k for k, v in limits.items() if not np.isfinite(v[0]))
    rounds = tuple(_rows(r) for r in found.rounds)
    causes = tuple(cause_of(*pair) for pair in zip(found.accepted, found.grounds))
    verdict, sentence, sets = _verdict(found, causes)
    named = () if verdict == 'not_in_catalogue' else causes
    channels = nominal.robot.output_names
    remainder = {name: float(left) for name, left in zip(channels, found.after)}
    return Diagnosis(verdict, sentence, named, sets, shown, blind, rounds,
                     _advice(verdict, sets), remainder), data, settled_base(
                         found.extended, records[0].payload)


def _still(records: Sequence[Record], data: Data) -> tuple[str, ...]:
    """Return the joints and links that hardly moved in any record."""
    quiet = []
    for j in (0, 1):
        swing = max(np.ptp(r.output[:, j]) / n[j] for r, n in zip(records, data.noise))
        if swing < QUIET_ANGLE:
            quiet.append(f'joint_{j + 1}')
    bends = max(np.max(np.std(r.output[:, 2:], axis=0) / n[2:])
                for r, n in zip(records, data.noise))
    return (*quiet, 'the links') if bends < QUIET_STRAIN else tuple(quiet)


def _cannot_answer(still: Sequence[str]) -> Diagnosis:
    return Diagnosis(
        'data_cannot_answer', f'The record cannot answer: {" and ".join(still)} hardly moved.',
        advice='Record 40 s or more with both joints following steps of at least 0.3 rad, '
               'with pauses of about a second.')


def _rows(found: Round) -> tuple:
    chances = probabilities(found.ranked, found.chosen)
    return tuple(candidate(r, float(p)) for r, p in zip(found.ranked, chances))


def cause_of(ranked: Ranked, found: Round) -> Cause:
    """Return an accepted effect as it is stated, with what its round says of it."""
    assert found.chosen is not None
    chances = probabilities(found.ranked, found.chosen)
    name = ranked.hypothesis.effect.identifier
    probability = float(sum(p for r, p in zip(found.ranked, chances)
                            if r.hypothesis.effect.identifier == name))
    if not clear_of_null(ranked):
        probability = min(probability, UNDETERMINED)
    values = parameter_values(ranked.fit)
    alike = tuple(r.hypothesis.effect.identifier
                  for r in look_alikes(found.chosen, found.ranked))
    return Cause(name, ranked.hypothesis.site, cause_sentence(ranked, values), probability,
                 values, alike[:2], ranked.hypothesis.at(ranked.fit.values))


def cause_sentence(ranked: Ranked, values: Sequence[ParameterValue]) -> str:
    """Return the effect's explanation at its site, with sizes and uncertainty."""
    site = ranked.hypothesis.site.replace('_', ' ')
    text = ranked.hypothesis.effect.explanation.format(site=site)
    sizes = [f'{v.name} {v.value:.3g} ± {0.5 * (v.high - v.low):.2g} {v.unit}'.rstrip()
             for v, counts in zip(values, ranked.hypothesis.sizes) if counts]
    return f'{text.rstrip(".")} ({", ".join(sizes)}).'


def _verdict(found: Search,
             causes: Sequence[Cause]) -> tuple[str, str, tuple[tuple[str, ...], ...]]:
    before, after = float(found.before.max()), float(found.after.max())
    if before <= WRONG:
        return ('nothing_wrong', 'Nothing in the catalogue is wrong with the simulation: its '
                'errors stay within noise and part tolerances.', ())
    explained = 1.0 - after / before
    if not causes or explained < EXPLAINED:
        names = f' (the best guess, {causes[0].name}, explains too little)' if causes else ''
        return ('not_in_catalogue', 'The simulation is wrong in a way that nothing in the '
                f'catalogue explains{names}.', ())
    sentence = ' '.join(cause.sentence for cause in causes)
    sets = tuple((c.name, *c.look_alikes) for c in causes if _torn(c))
    if sets:
        return 'cannot_tell', (f'One of {", ".join(sets[0])}: this record cannot tell them '
                               f'apart. Best guess: {sentence}'), sets
    if np.any(still_wrong(found.before, found.after / REMAINDER)):
        return 'cause_and_remainder', f'{sentence} Something unnamed is left.', ()
    return 'cause', f'{sentence} Nothing else in the catalogue explains the record as well.', ()


def _torn(cause: Cause) -> bool:
    """Tell whether a look-alike is as likely as not."""
    return bool(cause.look_alikes) and cause.probability < 0.6


def _advice(verdict: str, sets: Sequence[Sequence[str]]) -> str:
    if verdict == 'cannot_tell':
        return (f'To tell {" from ".join(sets[0])}: record again with another known payload and '
                'with slow and fast moves.')
    if verdict == 'not_in_catalogue':
        return 'Look at the residual plots: channel, band and dependence say where to look.'
    return ''
