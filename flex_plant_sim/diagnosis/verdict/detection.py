"""
Detection limits: the smallest size of each effect that a record would have shown.

A limit is the size from which on the evidence would favour the effect, on average.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import math

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.diagnosis.causes.hypothesis import Hypothesis
from flex_plant_sim.diagnosis.causes.proposal import Proposal, ROUNDING
from flex_plant_sim.diagnosis.likelihood.evidence import detectable_size
from flex_plant_sim.diagnosis.likelihood.prior import factors_on_parts, log_prior_odds
from flex_plant_sim.diagnosis.pool import attempt, each
from flex_plant_sim.diagnosis.verdict.results import DetectionLimit
from flex_plant_sim.effects.parameter import Parameter
import numpy as np

# Sizes probed at most, and the relative error of a limit at which it is close enough: noise moves
# the gain at a limit, at least 5 nats, by the root of twice as many, thus the size by 30 %.
MAX_PROBES, CLOSE = 10, 0.1
# Elasticity of what is needed over the size of an effect that is not steep: what is needed then
# changes by CLOSE where the size does by CLOSE / ELASTICITY. (Between sizes probed for two bench
# records it was 0.25 at most; of friction and saturation 2.4, and beyond all bounds. Limits of
# these records err by 1.3 % in the root mean square, by 9 % at most.)
ELASTICITY = 0.25
# Largest factor from one probed size to the next: further off, its information tells little.
STRIDE = 10.0
# Of an effect that is not linear, share of the smallest probed size below which none is asked
# about: a contact's break-away is then finer than the sensors.
LEAST_SHARE = 0.1

# (hypothesis, deviation from null) -> information on it there, see `causes.information`.
Information = Callable[[Hypothesis, float], float]


def detection_limits(proposals: Sequence[Proposal], robot: Robot, duration: float,
                     information: Information, jobs: int = 1,
                     progress: Callable[[float], None] = lambda share: None
                     ) -> dict[str, DetectionLimit]:
    """
    Return 'identifier:site' to the smallest visible deviation from null; inf where none is.

    A size is visible if the effect with it would be more probable than nothing in its place.

    Parameters
    ----------
    proposals : sequence of Proposal
        Of each hypothesis, beside the causes that were found; limits are first guessed from them.
    robot : Robot
        Whose sites share an effect's prior odds.
    duration : float
        Of the longest record, s.
    information : Callable
        Information on a deviation, beside the same causes.
    jobs : int
        Processes.
    progress : Callable
        Called with the share that is done.

    """
    limits = partial(_limits, robot=robot, duration=duration, information=information)
    found: dict[str, list[float]] = {}
    for proposal, sizes in zip(proposals, each(partial(_limits_or_inf, limits), proposals, jobs,
                                               progress)):
        found.setdefault(proposal.hypothesis.label, []).extend(sizes)
    units = {p.hypothesis.label: _size(p.hypothesis).unit for p in proposals}
    return {label: DetectionLimit(max(sizes), units[label], min(sizes))
            for label, sizes in found.items()}


def _size(hypothesis: Hypothesis) -> Parameter:
    """Return the parameter that a limit is stated of."""
    return hypothesis.parameters[int(np.argmax(hypothesis.is_size))]


def _limits_or_inf(limits: Callable[[Proposal], list[float]], proposal: Proposal) -> list[float]:
    """Return limits, inf where the sizes that are tried predict nothing finite."""
    found = attempt(limits, proposal)
    return [math.inf] if found is None else found


def _limits(proposal: Proposal, robot: Robot, duration: float, information: Information
            ) -> list[float]:
    """
    Return the sizes from which on a proposal's hypothesis shows, one for each side of null.

    A side that shows at no size has none, as null may have no room beside it; inf where no side
    has one. Both sides of what is linear are alike.
    """
    hypothesis = proposal.hypothesis
    prior, k = hypothesis.prior(duration), int(np.argmax(hypothesis.is_size))
    # Within its bounds, a prior is denser than the Gaussian; the posterior is taken as inside.
    price = -log_prior_odds(hypothesis.effect, robot) + float(prior.log_mass[k])
    one, width = hypothesis.parameters[k], float(prior.width[k])
    guess = first_guess(proposal, width, price)
    least = 0.0 if hypothesis.effect.linear else LEAST_SHARE * proposal.probed_sizes[0]
    close = CLOSE if is_steep(proposal) else CLOSE / ELASTICITY
    sides = dict.fromkeys(math.copysign(1.0, d[k]) for d in hypothesis.probe_deviations())

    # Of a factor on a part, no record has more information than the part's prior lacks.
    same = factors_on_parts(robot).get(hypothesis.label)
    most = math.inf if same is None else same.part.tolerance**-2

    def needed(side: float, size: float) -> float:
        known = information(hypothesis, side * size)
        # What has no finite prediction shows.
        return 0.0 if math.isnan(known) else detectable_size(min(known, most), width, price)

    found: list[float] = []
    for side in sides:
        room = one.high - one.null if side > 0.0 else one.null - one.low
        size = visible_size(partial(needed, side), found[0] if found else guess, room, least,
                            close)
        if size < math.inf:
            found.append(size)
            if hypothesis.effect.linear:
                break
    return found or [math.inf]


def is_steep(proposal: Proposal) -> bool:
    """Tell whether the information on a size may rise steeply: a contact, a command's limit."""
    known = proposal.information
    return bool(proposal.hypothesis.effect.contact or np.min(known) < ROUNDING * np.max(known))


def first_guess(proposal: Proposal, width: float, price: float) -> float:
    """Return a size near the limit, by the proposal's information, or one that was probed."""
    guesses = [detectable_size(known, width, price) for known in proposal.information]
    return next(filter(math.isfinite, guesses), float(proposal.probed_sizes[-1]))


def visible_size(needed: Callable[[float], float], guess: float, most: float, least: float = 0.0,
                 close: float = CLOSE) -> float:
    """
    Return the least size that is as large as what is needed, by its own information, to show.

    What is needed is not monotone in the size: parts undo small sizes, commands never reach
    limits. So iteration x -> needed(x) is kept between a size that is hidden and a visible one.

    Parameters
    ----------
    needed : Callable
        Size -> size from which on it would show with the information there; inf for none.
    guess : float
        Where to begin.
    most : float
        The largest size; where that does not show, inf is returned.
    least : float
        The smallest size to ask about; where that shows, it is returned.
    close : float
        Relative change of a size from which on what it needs is the limit.

    """
    hidden, visible, size = 0.0, math.inf, min(max(guess, least), most)
    for _ in range(MAX_PROBES):
        enough = needed(size)
        if enough <= size:
            visible = size
        else:
            hidden = size
        if abs(enough - size) <= close * size:
            return max(enough, least) if enough <= most else math.inf
        if visible <= least or (visible < math.inf and visible - hidden <= CLOSE * visible):
            return visible
        if hidden >= most:
            return math.inf
        if hidden < enough < visible:
            size = min(max(enough, least), STRIDE * size, most)
        else:
            size = math.sqrt(max(hidden, visible / STRIDE) * visible) if visible < math.inf \
                else min(STRIDE * hidden, most)
    return visible
