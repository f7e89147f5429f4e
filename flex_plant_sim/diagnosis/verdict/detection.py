"""Detection limits: the size of each effect at which a record's evidence turns."""

from __future__ import annotations

from collections.abc import Sequence
import math

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.causes.proposal import Proposal, ProposalRefiner
from flex_plant_sim.diagnosis.likelihood.evidence import detectable_size
from flex_plant_sim.diagnosis.likelihood.prior import factors_on_parts, log_prior_odds
from flex_plant_sim.diagnosis.pool import each
import numpy as np

# Each halves the interval of the logarithm between two looks: 1e-6 is left.
BISECTIONS = 20
# Looks nearer by, and what is far: information is interpolated between sizes.
MAX_REPROBES, FAR_BELOW_PROBES = 2, 0.7
# Halvings, on a logarithm, of what parts sizes that change nothing from those that show.
MAX_HALVINGS = 4


def detection_limits(proposals: Sequence[Proposal], robot: Robot, duration: float,
                     refiner: ProposalRefiner, jobs: int = 1) -> dict[str, tuple[float, str]]:
    """
    Return 'identifier:site' to (smallest deviation from null, unit); inf where none shows.

    A size shows when the effect with it would be more probable than nothing in its place.

    Parameters
    ----------
    promises : sequence of Promise
        What each hypothesis could add to the causes that are on.
    robot : Robot
        Whose sites share an effect's odds.
    duration : float
        Of the longest record, s.
    closer : Closer
        Looks again where a limit is far below the sizes that were looked at: there, parts may
        do what the effect does.
    jobs : int
        Processes.

    """
    for number in range(MAX_REPROBES + MAX_HALVINGS):
        items = [(p, _next_probe_size(p, robot, duration, number < MAX_REPROBES)) for p in proposals]
        far = [(p, size) for p, size in items if size is not None]
        again = {p.hypothesis: p for p in each(refiner, far, jobs)}
        proposals = [again.get(p.hypothesis, p) for p in proposals]
    found: dict[str, tuple[float, str]] = {}
    for p in proposals:
        size, (hidden, shown) = _limit(p, robot, duration), _visible_sizes(p)
        # What changes nothing at some size shows first between that and the next.
        least = size if hidden == 0.0 else max(size, shown)
        limit = (least, p.hypothesis.parameters[_size_index(p)].unit)
        # Of what nature has one of two values of, the one that is harder to see.
        found[p.hypothesis.label] = max(limit, found.get(p.hypothesis.label, limit))
    return found


def _next_probe_size(proposal: Proposal, robot: Robot, duration: float, below: bool) -> float | None:
    """
    Return at what size to look again, if any.

    Far below those that were looked at, parts may do what the effect does. Or it does nothing
    there: a limit that no command reaches.
    """
    size, (hidden, shown) = _limit(proposal, robot, duration), _visible_sizes(proposal)
    if hidden > 0.0 and size < shown:
        return math.sqrt(hidden * shown)
    far = below and not proposal.hypothesis.effect.linear and size < FAR_BELOW_PROBES * shown
    return size if far else None


def _visible_sizes(proposal: Proposal) -> tuple[float, float]:
    """Return the largest size that changes nothing, 0 if none is known, and the least larger."""
    shows = proposal.information > 0.0
    least = float(np.min(proposal.probed_sizes[shows], initial=np.inf))
    less = proposal.probed_sizes[proposal.probed_sizes < least]
    return float(np.max(less, initial=0.0)), least


def _size_index(proposal: Proposal) -> int:
    return int(np.argmax(proposal.hypothesis.is_size))


def _limit(proposal: Proposal, robot: Robot, duration: float) -> float:
    """
    Return the size that is as large as what its own information makes detectable.

    Parts are taken as linear, which leaves of a large factor what a part undoes in full: of that
    a record knows no more than the part's tolerance does.
    """
    prior, k = proposal.hypothesis.prior(duration), _size_index(proposal)
    # A one-sided slab is twice as dense.
    price = -log_prior_odds(proposal.hypothesis.effect, robot) - np.log(2.0) * (prior.one_sided[k] != 0.0)
    known = proposal.information > 0.0
    if not known.any():
        return float('inf')
    found = factors_on_parts(robot).get(proposal.hypothesis.label)
    most = np.inf if found is None else found.part.tolerance**-2
    sizes = proposal.probed_sizes[known]
    information = np.minimum(proposal.information[known], most)
    size = _threshold(np.log(sizes), np.log(information), float(prior.width[k]), price)
    one = proposal.hypothesis.parameters[k]
    return size if size <= max(one.high - one.null, one.null - one.low) else float('inf')


def _threshold(sizes: Array, information: Array, width: float, price: float) -> float:
    """
    Return the least size that its own information makes detectable; logarithms are given.

    Halved between the looks on its two sides: information may rise with any power of the size, as
    of a limit that commands just reach, so that to go from size to size need not converge.
    """
    def needed(at: float) -> float:
        known = float(np.exp(np.interp(at, sizes, information)))
        return float(np.log(detectable_size(known, width, price)))

    shows = [k for k, at in enumerate(sizes) if needed(at) <= at]
    if not shows or shows[0] == 0:
        return float(np.exp(needed(sizes[0 if shows else -1])))
    low, high = sizes[shows[0] - 1:shows[0] + 1]
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if needed(middle) <= middle else (middle, high)
    return float(np.exp(high))
