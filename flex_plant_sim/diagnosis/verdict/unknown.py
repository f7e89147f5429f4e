"""
What is unnamed: the laws of the remaining latent forces, in sentences and as advice.

It completes the diagnosis after the verdict, where something unknown is at work.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from string import ascii_lowercase

from flex_plant_sim.diagnosis.likelihood.prior import unknown_odds
from flex_plant_sim.diagnosis.prediction.friction_part import friction_part
from flex_plant_sim.diagnosis.prediction.latent_view import Finding, LatentView
from flex_plant_sim.diagnosis.prediction.law import CONSTANT, STRETCHES
from flex_plant_sim.diagnosis.verdict.results import Diagnosis, Verdict
from flex_plant_sim.diagnosis.verdict.wording import digits_text, percent_text, shown_unit

# Verdicts under which something unknown is at work.
UNNAMED_VERDICTS: tuple[Verdict, ...] = ('not_in_catalogue', 'cause_and_remainder')
# Variables of laws in words.
VARIABLE_TEXT = {'speed': 'its speed', 'angle': 'its angle', 'load': 'the load on its link',
                 'command': 'its command', 'time': 'time', 'strain': 'its own strain',
                 'strain rate': 'the rate of its strain', 'command_1': 'the command of joint 1',
                 'command_2': 'the command of joint 2', CONSTANT: 'a constant level'}
NOT_IN_CATALOGUE = 'The simulation is wrong in a way that nothing in the catalogue explains.'
LOOK_AT_RESIDUALS = 'Look at the residual plots: channel, band and dependence say where to look.'
# Least share of a force that a law is believed to leave, so that its odds stay finite: with 20
# stretches they are 1e30, as good as certain.
LEAST_LEFT = 1e-3
# Likelihood ratio of a locked part that is predicted worse, on the whole or most of all where a
# cause stands, by Laplace's rule: so were 0 of 126 sets that were right, and 4 of 41 that were not
# (scoring seeds 12101 to 14064 of the bank). benchmarks/stated.py counts them.
REFUTED = (1.0 / 128.0) / (5.0 / 43.0)
# What a force is that follows no one variable.
MANY_OR_MEMORY = (
    'Behind that are several variables, an acceleration (as of a wrong mass), or something with a '
    'memory, such as a gap, a loose mass, a compliance or a delay.')


def with_stated_law(diagnosis: Diagnosis, view: LatentView) -> Diagnosis:
    """
    Return a verdict without a cause as `not_in_catalogue` where a law is that of no effect.

    What of the probability is left to nothing goes to something unknown at the law's odds.

    The evidence allows a gauge a share of its strain and a joint one of its torque that no model
    has; it does not ask whether these are one function of one variable. A law that leaves the
    share 1 - s of a force's power on stretches left out is (1 - s)^(-n / 2) times as likely as
    none, with the n stretches as independent samples.
    """
    laws = [f.law for f in view.findings if f.has_shape_of_no_effect]
    if not (diagnosis.names_nothing and laws):
        return diagnosis
    left = min(max(1.0 - law.share, LEAST_LEFT) for law in laws)
    odds = unknown_odds() * left**(-0.5 * STRETCHES)
    nothing = diagnosis.effects['nothing']
    added, total = nothing * odds, 1.0 + nothing * odds
    effects = {name: p / total for name, p in diagnosis.effects.items()}
    effects['unknown'] += added / total
    sets = _with_unnamed({labels: p / total for labels, p in diagnosis.sets}, added / total)
    said = diagnosis.verdict == 'not_in_catalogue'
    return replace(diagnosis, verdict='not_in_catalogue', effects=effects, sets=sets,
                   cannot_tell=(), advice=LOOK_AT_RESIDUALS,
                   sentence=diagnosis.sentence if said else NOT_IN_CATALOGUE)


def refuted(diagnosis: Diagnosis) -> Diagnosis:
    """
    Return named causes as less probable than something unnamed that only looks like them.

    For an extended robot that predicts the locked part, to which nothing was fitted, worse than
    the robot file does, on the whole or at a cause's own channel most of all: the odds of the
    causes are multiplied by REFUTED, and what they lose goes to something unnamed.
    """
    if diagnosis.verdict not in ('cause', 'cannot_tell') or not diagnosis.causes:
        return diagnosis
    named = 1.0 - diagnosis.effects['unknown'] - diagnosis.effects['nothing']
    kept = REFUTED / (1.0 - named + REFUTED * named)
    effects = {name: kept * p for name, p in diagnosis.effects.items()}
    effects['nothing'] = diagnosis.effects['nothing']
    effects['unknown'] = diagnosis.effects['unknown'] + (1.0 - kept) * named
    causes = tuple(replace(c, probability=kept * c.probability) for c in diagnosis.causes)
    before = dict(diagnosis.sets)
    after = {labels: p if labels in ((), ('unknown',)) else kept * p
             for labels, p in before.items()}
    sets = _with_unnamed(after, sum(before.values()) - sum(after.values()))
    return replace(diagnosis, verdict='cause_and_remainder', causes=causes, effects=effects,
                   sets=sets, sentence=f'{diagnosis.sentence} More likely something unnamed looks '
                                       'like this on the part that was fitted.')


def _with_unnamed(sets: Mapping[tuple[str, ...], float], added: float
                  ) -> tuple[tuple[tuple[str, ...], float], ...]:
    """Return sets, the most probable first, with what is added to something unnamed alone."""
    more = {**sets, ('unknown',): sets.get(('unknown',), 0.0) + added}
    return tuple(sorted(more.items(), key=lambda row: -row[1]))


def with_unknown(diagnosis: Diagnosis, view: LatentView) -> Diagnosis:
    """Return the diagnosis with what latent forces show, where something is unnamed."""
    if diagnosis.verdict not in UNNAMED_VERDICTS:
        return diagnosis
    sentences = sentences_of(view)
    if not sentences:
        return diagnosis
    return replace(diagnosis, sentence=' '.join([diagnosis.sentence, *sentences]),
                   advice=diagnosis.advice and _advice(view))


def sentences_of(view: LatentView) -> tuple[str, ...]:
    """Return a sentence for each force that is shown."""
    return _sentences(_shown(view))


def _shown(view: LatentView) -> tuple[Finding, ...]:
    """Return torques that exceed model errors; else gauge errors, as these mostly echo torques."""
    return view.torques if _sentences(view.torques) else view.gauges


def _sentences(findings: Sequence[Finding]) -> tuple[str, ...]:
    """Return sentences about stated laws; without one, about what forces may follow."""
    known = tuple(sentence(f) for f in findings if f.law.stated)
    if known:
        return known
    shown = [f for f in findings if f.exceeds_model_error]
    many = (MANY_OR_MEMORY,) if any(f.has_memory for f in shown) else ()
    return (*map(sentence, shown), *many)


def sentence(finding: Finding) -> str:
    """Return what a latent force shows, in one sentence."""
    law, series = finding.law, finding.series
    what = 'torque' if series.unit == 'N m' else 'error'
    scale, unit = shown_unit(series.unit)
    size = f'{digits_text(scale * series.rms, 2)} {unit} rms'
    site = series.site.replace('_', ' ')
    if law.stated and law.variable == CONSTANT:
        return f'An unnamed constant {what} acts on {site} ({size}).'
    if law.stated:
        over = variable_text(law.variable)
        return (f'An unnamed {what} of {site} ({size}) is a law over {over}, which explains '
                f'{100.0 * law.share:.0f} % of it on stretches left out{_as_friction(finding)}.')
    if not finding.has_memory:
        return f'An unnamed {what} of {site} ({size}) seems to follow {likely_text(finding)}.'
    swings = f', and swings at {digits_text(finding.line.frequency, 2)} Hz' if finding.line else ''
    alike = '; an angle sensor that errs would look alike' if what == 'torque' else ''
    return f'An unnamed {what} of {site} ({size}) follows no one variable{swings}{alike}.'


def likely_text(finding: Finding) -> str:
    """Return the variables that a force may follow, how much of it each explains, and a doubt."""
    likely = finding.likely_variables
    named = ' or '.join(
        f'{variable_text(v.variable)} ({percent_text(v.share)} of it where not fitted)'
        for v in likely)
    return named + (': which, this record cannot tell' if len(likely) > 1
                    else ', not surely enough to state a law')


def variable_text(variable: str) -> str:
    """Return a variable in words."""
    return VARIABLE_TEXT.get(variable, variable.replace('_', ' '))


def _as_friction(finding: Finding) -> str:
    """Return what of a law over a joint's speed is friction; nothing for other laws."""
    if finding.law.variable != 'speed':
        return ''
    part = friction_part(finding.series)
    share = f'{100.0 * part.share:.0f} % of it'
    return f"; {part} than the extended robot's drive has would be {share}"


def _advice(view: LatentView) -> str:
    stated = [f.law for f in _shown(view) if f.law.stated]
    likely = [f for f in _shown(view) if f.exceeds_model_error and not f.has_memory]
    if likely and not stated:
        first = likely[0]
        over = variable_text(first.likely_variables[0].variable)
        return (f'Record {first.series.site.replace("_", " ")} longer, and {over} through the '
                'whole range, apart from all else.')
    if not stated:
        return ('Record both joints at rest after a push: what swings or creeps on shows the '
                'coordinate that the model lacks.')
    law = stated[0]
    site, over = law.site.replace('_', ' '), variable_text(law.variable)
    if law.variable in ('time', CONSTANT):
        return f'Record {site} again from a cold start and an hour later: does it return?'
    if law not in [f.law for f in view.torques]:
        alike = [other.site for other in stated if other.variable == law.variable
                 and _link_of(other.site) == _link_of(law.site)]
        if len(alike) > 1:
            return (f'Look at link {_link_of(law.site)} before its gauges: several of them depend '
                    f'alike on {over}.')
        return f'Look at {site}, its cable and its amplifier: what they read depends on {over}.'
    return (f'Record {site} through the whole range of {over}, both ways: the table that the '
            'extended robot carries is only known where this record was.')


def _link_of(site: str) -> str:
    """Return the number of a gauge's link, 2 of strain_2a; a joint's site as it is."""
    return site.removeprefix('strain_').rstrip(ascii_lowercase) if 'strain_' in site else site
