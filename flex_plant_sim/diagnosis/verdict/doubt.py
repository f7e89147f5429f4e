"""What to say where something that has no name is likelier than the causes that were found."""

from __future__ import annotations

from flex_plant_sim.diagnosis.causes.posterior import Posterior
from flex_plant_sim.diagnosis.causes.search import SearchResult


def doubt(posterior: Posterior) -> str:
    """Return what to say before the causes where one unknown thing is likelier; else nothing."""
    if posterior.genuine_probability >= 0.5:
        return ''
    if len(posterior.best.hypotheses) == 1:
        lead = 'More likely one thing that the catalogue lacks is behind it all.'
    else:
        lead = 'So much at once is rare: one thing that the catalogue lacks may be behind it all.'
    return f'{lead} {_genuine_text(posterior)}: '


def _genuine_text(posterior: Posterior) -> str:
    which = 'this cause is' if len(posterior.best.hypotheses) == 1 else 'each of these causes is'
    most = max(posterior.effect_probability(h.effect.identifier)
               for h in posterior.best.hypotheses)
    return f'The probability that {which} real is at most {100.0 * most:.0f} %'


def unnamed_remainder(found: SearchResult) -> str:
    """Return why something unnamed is assumed beside the causes or in place of one."""
    fit = found.best.fit
    if fit.discrepancy.remainder and fit.varying_gain > 0.0 and not fit.has_large_errors:
        one = 'it' if len(fit.hypotheses) == 1 else 'one of these causes'
        text = (f' But {one} is not equally large throughout the record: something unnamed that '
                'looks like it on average is more likely.')
        return text if doubt(found.posterior) else f'{text} {_genuine_text(found.posterior)}.'
    return ' Something unnamed remains.'
