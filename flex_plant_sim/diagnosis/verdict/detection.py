"""
Detection limits: the smallest size of each effect that a record would have shown.

`verdict` computes them from the proposals that the search leaves. A limit is the size from which
on the evidence would favour the effect.
"""

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

# Bisections of the interval between two probed sizes, on a logarithm: 1e-6 of it is left.
BISECTIONS = 20
# Times that a limit far below the probed sizes is probed itself, and its ratio to the smallest of
# them that is far: between probed sizes, information is interpolated.
MAX_REPROBES, FAR_BELOW_PROBES = 2, 0.7
# Bisections, on a logarithm, between a size that changes nothing and one that is visible.
MAX_HALVINGS = 4


def detection_limits(proposals: Sequence[Proposal], robot: Robot, duration: float,
                     refiner: ProposalRefiner, jobs: int = 1) -> dict[str, tuple[float, str]]:
    """
    Return 'identifier:site' to (smallest deviation from null, unit); inf where none is visible.

    A size is visible if the effect with it would be more probable than nothing in its place.

    Parameters
    ----------
    proposals : sequence of Proposal
        Of each hypothesis, beside the causes that were found.
    robot : Robot
        Whose sites share an effect's prior odds.
    duration : float
        Of the longest record, s.
    refiner : ProposalRefiner
        Probes further sizes, where a limit is far below those that were probed.
    jobs : int
        Processes.

    """
    for number in range(MAX_REPROBES + MAX_HALVINGS):
        sizes = [(p, _next_probe_size(p, robot, duration, number < MAX_REPROBES))
                 for p in proposals]
        wanted = [(p, size) for p, size in sizes if size is not None]
        refined = {p.hypothesis: p for p in each(refiner, wanted, jobs)}
        proposals = [refined.get(p.hypothesis, p) for p in proposals]
    found: dict[str, tuple[float, str]] = {}
    for p in proposals:
        size, (hidden, visible) = _limit(p, robot, duration), _visible_sizes(p)
        # An effect that changes nothing up to some size is visible from the next one on.
        least = size if hidden == 0.0 else max(size, visible)
        limit = (least, p.hypothesis.parameters[_size_index(p)].unit)
        # Of several discrete values, the one that is hardest to see counts.
        found[p.hypothesis.label] = max(limit, found.get(p.hypothesis.label, limit))
    return found


def _next_probe_size(proposal: Proposal, robot: Robot, duration: float, below: bool
                     ) -> float | None:
    """
    Return the size to probe next, if any; `below` allows one far below the probed sizes.

    At sizes far below those, parts may do what the effect does, or the effect changes nothing, as
    a limit that no command reaches.
    """
    size, (hidden, visible) = _limit(proposal, robot, duration), _visible_sizes(proposal)
    if hidden > 0.0 and size < visible:
        return math.sqrt(hidden * visible)
    far = below and not proposal.hypothesis.effect.linear and size < FAR_BELOW_PROBES * visible
    return size if far else None


def _visible_sizes(proposal: Proposal) -> tuple[float, float]:
    """Return the largest probed size that changes nothing, or 0, and the next larger one."""
    visible = proposal.information > 0.0
    least = float(np.min(proposal.probed_sizes[visible], initial=np.inf))
    hidden = proposal.probed_sizes[proposal.probed_sizes < least]
    return float(np.max(hidden, initial=0.0)), least


def _size_index(proposal: Proposal) -> int:
    return int(np.argmax(proposal.hypothesis.is_size))


def _limit(proposal: Proposal, robot: Robot, duration: float) -> float:
    """
    Return the size that its own information makes just detectable; inf beyond the bounds.

    Of a factor on a part, no record has more information than one over the part's variance. The
    information does not say so by itself, as it is linearised in the part.
    """
    prior, k = proposal.hypothesis.prior(duration), _size_index(proposal)
    # The density of a one-sided prior is twice that of the Gaussian.
    price = -log_prior_odds(proposal.hypothesis.effect, robot)
    price -= np.log(2.0) * (prior.one_sided[k] != 0.0)
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
    Return the least size that its own information makes detectable.

    Sizes and information are given as logarithms. The size is bisected between the probed ones:
    information may rise with any power of the size, as of a limit that commands just reach, so
    that fixed-point iteration need not converge.
    """
    def needed(at: float) -> float:
        known = float(np.exp(np.interp(at, sizes, information)))
        return float(np.log(detectable_size(known, width, price)))

    visible = [k for k, at in enumerate(sizes) if needed(at) <= at]
    if not visible or visible[0] == 0:
        return float(np.exp(needed(sizes[0 if visible else -1])))
    low, high = sizes[visible[0] - 1:visible[0] + 1]
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if needed(middle) <= middle else (middle, high)
    return float(np.exp(high))
