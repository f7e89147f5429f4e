"""
The diagnosis of records: cut, searched, and put into one verdict in an engineer's words.

`diagnose` judges by what was fitted; `complete`, in the module beside it, adds what was not, and
may change the verdict. The two are the entry to the whole chain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from flex_plant_sim.arm.parts import in_velocity_loop, within_file_limits
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.diagnosis.causes.fit import Fit
from flex_plant_sim.diagnosis.causes.hypothesis import CauseSet, Hypothesis
from flex_plant_sim.diagnosis.causes.model_averaging import averaged_part_deviations
from flex_plant_sim.diagnosis.causes.posterior import is_unknown, Posterior, SetKey
from flex_plant_sim.diagnosis.causes.search import search, SearchResult
from flex_plant_sim.diagnosis.causes.search_state import MIN_RELATIVE_PROBABILITY, Progress
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.discrepancy import DiscrepancyModel
from flex_plant_sim.diagnosis.prediction.latent_view import latent_view
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.data import Data, MOVE_MORE, unmoved
from flex_plant_sim.diagnosis.record.rate import at_needed_rate
from flex_plant_sim.diagnosis.record.windows import least_duration, Record
from flex_plant_sim.diagnosis.verdict.command_timing import with_command_timing
from flex_plant_sim.diagnosis.verdict.damping_law import with_damping_law
from flex_plant_sim.diagnosis.verdict.detection import detection_limits
from flex_plant_sim.diagnosis.verdict.doubt import doubt, unnamed_remainder
from flex_plant_sim.diagnosis.verdict.late_event import locked_part_differs, searched_again
from flex_plant_sim.diagnosis.verdict.noisy_sensors import with_noise
from flex_plant_sim.diagnosis.verdict.parameter_values import averaged_values, values_in_set
from flex_plant_sim.diagnosis.verdict.results import (
    Alternative,
    Cause,
    Diagnosis,
    ParameterValue,
    PartEstimate,
    Verdict,
)
from flex_plant_sim.diagnosis.verdict.unknown import (
    LOOK_AT_RESIDUALS,
    NOT_IN_CATALOGUE,
    with_stated_law,
)
from flex_plant_sim.diagnosis.verdict.varying_part import varying_part_text
from flex_plant_sim.diagnosis.verdict.wording import (
    apart_text,
    beyond_tolerance,
    name_text,
    parameter_text,
    part_text,
    percent_text,
)
from flex_plant_sim.effects import catalogue, explanation_at
from flex_plant_sim.simulation.nominal import nominal_effects, with_bent_links
from flex_plant_sim.simulation.slowest_mode import frequency_of
import numpy as np

# What no name of the catalogue stands for, in words.
UNNAMED = 'something unnamed'
# Sets of causes that the answer lists at most, and names in a sentence.
MAX_LISTED_SETS, MAX_LISTED_NAMES = 12, 6


def nominal_base(robot: Robot, model: str, modes: int, coriolis: bool = True) -> BaseModel:
    """
    Return the model that a diagnosis begins with: `nominal_effects` and the forces of bent links.

    Without these, which tell by tens of nats on ordinary records, parts and causes take their
    place.
    """
    return BaseModel(robot, model, modes,
                     nominal_effects(with_bent_links(robot, model), model, coriolis))


def prepared(records: Sequence[Record], nominal: BaseModel) -> tuple[list[Record], BaseModel]:
    """Return records at the rate that a diagnosis needs, and the model at that rate."""
    slower, step = at_needed_rate(records, slowest_frequency(nominal, records[0].payload),
                                  nominal.robot.sample_time)
    return slower, replace(nominal, robot=replace(nominal.robot, sample_time=step))


def diagnose(records: Sequence[Record], nominal: BaseModel, jobs: int = 1,
             progress: Progress = lambda step, share: None,
             exclude: Sequence[str] = ()) -> tuple[Diagnosis, Data, BaseModel]:
    """
    Return the diagnosis of records, the data it used, and the model with the causes.

    The verdict stands once `complete` has compared both models where nothing was fitted.

    Parameters
    ----------
    records : sequence of Record
        Of one robot, with the same sample time, see `prepared`.
    nominal : BaseModel
        The model in question, see `nominal_base`, with that sample time.
    jobs : int
        Processes.
    progress : Callable
        Called with a step's name and its share done.
    exclude : sequence of str
        Identifiers to leave out of the catalogue.

    Raises
    ------
    InputError
        If a record is too short for five windows.

    """
    slowest = slowest_frequency(nominal, records[0].payload)
    data = Data.of(records, slowest, nominal.robot.sample_time)
    still = unmoved(records, data)
    if still:
        return _cannot_answer(still), data, nominal
    found = search(data, nominal, jobs, progress, exclude)
    if locked_part_differs(found, data):
        # What begins in the locked part shows only where that is fitted.
        other = Data.of(records, slowest, nominal.robot.sample_time, locks_first=True)
        found, data = searched_again(found, data, other, nominal, jobs, progress, exclude)
    diagnosis = _diagnosis(found, data, nominal, jobs,
                           lambda share: progress('detection limits', share))
    extended = extended_base(found, nominal)
    if diagnosis.names_nothing:
        diagnosis = with_stated_law(diagnosis, latent_view(predictors(extended, data)))
    diagnosis = with_noise(with_command_timing(diagnosis, found.best, data, jobs), records,
                           nominal.robot)
    return diagnosis, data, extended


def predictors(base: BaseModel, data: Data) -> list[Predictor]:
    """Return a model's predictors of the records, with their locked windows."""
    return [Predictor(base, windows, noise) for windows, noise in zip(data.locked, data.noise)]


def slowest_frequency(base: BaseModel, payload: float) -> float:
    """Return the lowest natural frequency of the stretched arm with locked joints, rad/s."""
    return frequency_of(base.arm(payload))


def needed_duration(nominal: BaseModel) -> float:
    """Return how long a record must be that `diagnose` takes once it is `prepared`, s."""
    slowest = slowest_frequency(nominal, nominal.robot.payload_mass)
    _, step = at_needed_rate([], slowest, nominal.robot.sample_time)
    return least_duration(slowest, step)


def extended_base(found: SearchResult, nominal: BaseModel) -> BaseModel:
    """Return the nominal model with the causes and the estimated parts, as a file may say them."""
    model = found.best.extended_model(nominal)
    return replace(model, robot=within_file_limits(model.robot))


def _cannot_answer(still: Sequence[str]) -> Diagnosis:
    return Diagnosis(
        'data_cannot_answer', f'The record cannot answer: {" and ".join(still)} hardly moved.',
        advice=f'{MOVE_MORE}.')


def _diagnosis(found: SearchResult, data: Data, nominal: BaseModel, jobs: int,
               progress: Callable[[float], None]) -> Diagnosis:
    limits = detection_limits(found.proposals, nominal.robot, data.duration, found.information,
                              jobs, progress)
    causes = causes_of(found.posterior, found.best.fit)
    verdict, sentence, sets = _verdict(found, causes)
    channels = nominal.robot.output_names
    return Diagnosis(
        verdict, sentence + varying_part_text(found), causes, sets,
        {k: v for k, v in limits.items() if np.isfinite(v.value)},
        tuple(k for k, v in limits.items() if not np.isfinite(v.value)),
        tuple(_alternatives(found.posterior, h) for h in found.best.fit.hypotheses),
        _advice(verdict, sets),
        {name: float(s) for name, s in zip(channels, found.best.fit.error_scale)},
        part_estimates(found), _set_rows(found.posterior), _effect_rows(found.posterior))


def part_estimates(found: SearchResult) -> tuple[PartEstimate, ...]:
    """Return the priors and posteriors of all parts."""
    fit, deviations = found.best.fit, averaged_part_deviations(found.posterior)
    robot = found.posterior.nominal.robot
    return tuple(PartEstimate(part.name, part.unit, part.tolerance, float(m), float(s),
                              in_velocity_loop(robot, part.name, float(m)))
                 for part, m, s in zip(found.best.likelihood.parts, fit.deviations, deviations))


def _set_rows(posterior: Posterior) -> tuple[tuple[tuple[str, ...], float], ...]:
    """Return labels and probabilities of the most probable sets."""
    found: dict[tuple[str, ...], float] = {}
    for fit, p in zip(posterior.fits, posterior.probability):
        unknown = ('unknown',) if is_unknown(fit, posterior.nominal) else ()
        labels = (*sorted(SetKey.of(fit).labels), *unknown)
        found[labels] = found.get(labels, 0.0) + float(p)
    return tuple(sorted(found.items(), key=lambda row: -row[1])[:MAX_LISTED_SETS])


def _effect_rows(posterior: Posterior) -> dict[str, float]:
    """Return the probability of every effect, of `unknown` and of `nothing`."""
    return {**{name: posterior.effect_probability(name) for name in catalogue()},
            'unknown': posterior.unknown_probability, 'nothing': posterior.nothing_probability}


def causes_of(posterior: Posterior, best: Fit) -> tuple[Cause, ...]:
    """Return the causes of the best set with their probabilities and look-alikes."""
    found = []
    of_each = CauseSet(best.hypotheses, 1.0).split(best.values)
    for hypothesis, values in zip(best.hypotheses, of_each):
        name = hypothesis.effect.identifier
        alike = dict.fromkeys(label.partition(':')[0]
                              for label in posterior.credible_alternatives(hypothesis.label))
        sizes = averaged_values(posterior, hypothesis)
        found.append(Cause(
            name, hypothesis.site, cause_sentence(hypothesis, sizes),
            posterior.effect_probability(name), sizes,
            tuple(other for other in alike if other in catalogue() and other != name),
            hypothesis.effect_at(values)))
    return tuple(found)


def _alternatives(posterior: Posterior, hypothesis: Hypothesis) -> tuple[Alternative, ...]:
    """Return the fitted hypotheses that may stand in a cause's place, most probable first."""
    others = SetKey.of(posterior.best).labels - {hypothesis.label}
    without = max((fit.log_evidence for fit in posterior.fits
                   if SetKey.of(fit).labels == others), default=posterior.best.log_evidence)
    found = []
    for fit, p in zip(posterior.fits, posterior.probability):
        fresh = [h for h in fit.hypotheses if h.label not in others]
        if len(fresh) == 1 and len(fit.hypotheses) == len(others) + 1:
            found.append(Alternative(
                fresh[0].effect.identifier, fresh[0].site, values_in_set(fit, fresh[0]),
                fit.log_evidence - without, float(p)))
    return tuple(found)


def cause_sentence(hypothesis: Hypothesis, values: Sequence[ParameterValue]) -> str:
    """Return the effect's explanation at its site, with sizes that are there and uncertainty."""
    text = explanation_at(hypothesis.effect, hypothesis.site)
    sizes = [parameter_text(v) for v, p, counts in zip(
        values, hypothesis.parameters, hypothesis.is_size)
        if counts and not (p.optional and v.low <= p.null <= v.high) or p.value_names]
    remark = hypothesis.effect_at(np.array([v.value for v in values])).remark
    return f'{text.rstrip(".")} ({", ".join([*sizes, remark] if remark else sizes)}).'


def _verdict(found: SearchResult, causes: Sequence[Cause]
             ) -> tuple[Verdict, str, tuple[tuple[str, ...], ...]]:
    """Return verdict, sentence and the sets of causes that cannot be told apart."""
    unknown = is_unknown(found.best.fit, found.posterior.nominal)
    if not causes and not unknown:
        return nothing_verdict(found.posterior, part_estimates(found))
    if not causes:
        return 'not_in_catalogue', f'{NOT_IN_CATALOGUE}{_far_part(found)}', ()
    sentence = ' '.join(with_damping_law(cause, found.posterior.nominal.robot)
                        for cause in causes)
    sets = tuple((c.name, *c.look_alikes) for c in causes if c.look_alikes)
    if unknown:
        return ('cause_and_remainder', f'{doubt(found.posterior)}{sentence}'
                f'{unnamed_remainder(found)}{_far_part(found)}', sets)
    doubted = doubt(found.posterior)
    if doubted:
        return 'cause_and_remainder', f'{doubted}{sentence}', sets
    if sets:
        alike = ' '.join(dict.fromkeys(
            f'This record cannot tell {apart_text(names)}.' for names in sets))
        return 'cannot_tell', f'{sentence} {alike}', sets
    nothing = found.posterior.nothing_probability
    if nothing > MIN_RELATIVE_PROBABILITY:
        return 'cause', f'{sentence} That nothing is wrong has {percent_text(nothing)}.', ()
    return ('cause', f'{sentence} Nothing else in the catalogue explains the record as well.', ())


def nothing_verdict(posterior: Posterior, parts: Sequence[PartEstimate]
                    ) -> tuple[Verdict, str, tuple[tuple[str, ...], ...]]:
    """Return the verdict where no set of causes is likelier than nothing; all together may be."""
    nothing, far = posterior.nothing_probability, _parts_beyond_tolerance(parts)
    if nothing >= 0.5:
        allowed = DiscrepancyModel()
        return ('nothing_wrong',
                'Nothing in the catalogue is shown to be wrong with the simulation: its errors, '
                'one step ahead, stay within noise, part tolerances and what every model may miss '
                f'({100.0 * allowed.torque_share[0]:.0f} % of the net torque, '
                f'{100.0 * allowed.gauge_share:.0f} % of the strain).{far}', ())
    rows = sorted(_effect_rows(posterior).items(), key=lambda row: -row[1])
    likely = {name: p for name, p in rows if p > MIN_RELATIVE_PROBABILITY * rows[0][1]}
    few = dict(list(likely.items())[:MAX_LISTED_NAMES])
    listed = ', '.join(f'{UNNAMED if name == "unknown" else name_text(name)} {percent_text(p)}'
                       for name, p in few.items())
    named = [name for name in few if name in catalogue()]
    others = f' and {len(likely) - len(few)} more, less likely' if len(likely) > len(few) else ''
    return ('cannot_tell', 'Whether anything is wrong with the simulation, this record cannot '
            f'tell: {listed}{others}.{far}',
            (('nothing', *named),) if named else ())


def _far_part(found: SearchResult) -> str:
    """Return which part may be far off, where that is the likeliest of what has no name."""
    far = found.best.fit.discrepancy.far_part
    share = found.posterior.genuine_probability * sum(
        float(p) for fit, p in zip(found.posterior.fits, found.posterior.probability)
        if fit.discrepancy.far_part == far)
    return ''.join(f' Perhaps ({percent_text(share)}) a part is not as the robot file says: '
                   f'{part_text(p)}.' for p in part_estimates(found) if p.name == far)


def _parts_beyond_tolerance(parts: Sequence[PartEstimate]) -> str:
    """Return what to say of the parts that are further off than good parts are."""
    far = [part_text(part) for part in beyond_tolerance(parts)]
    return f' Parts beyond their tolerance: {"; ".join(far)}.' if far else ''


def _advice(verdict: Verdict, sets: Sequence[Sequence[str]]) -> str:
    """Return where to look where nothing has a name; what sets need, `with_experiment` says."""
    return LOOK_AT_RESIDUALS if verdict in ('not_in_catalogue', 'cannot_tell') and not sets else ''
