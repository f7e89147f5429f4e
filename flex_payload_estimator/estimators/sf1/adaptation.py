"""One step of SF1 (29), selective forgetting: payload and P from psi and phi; what it tells."""

from __future__ import annotations

from flex_plant_sim.compiled import compiled


@compiled
def sf1_step(mass: float, p: float, psi: float, phi: float, weight: float, alpha_0: float,
             alpha_1: float) -> tuple[float, float, float]:
    """
    Return mass, P and the gain kappa after one sample, (29).

    Parameters
    ----------
    mass, p : float
        theta_{t-1} = m_p, kg, and P_{t-1}.
    psi, phi : float
        psi = phi m_p + e, rad and rad/kg, (27).
    weight : float
        1 for (29) as printed; reference variance over var(e) where psi and phi are normalised.
    alpha_0, alpha_1 : float
        Constants of the forgetting, (30).

    """
    kappa = p * phi * weight / (1.0 + phi * p * phi * weight)
    forgotten = (alpha_1 - alpha_0) / alpha_1 * p + alpha_0
    return mass + kappa * (psi - phi * mass), (1.0 - kappa * phi) * forgotten, kappa


@compiled
def told_share(before: float, after: float, prior: float) -> float:
    """
    Return what a sample has told of a value, as a share of what all samples have.

    A sample tells what it adds to one over the value's variance; while samples have told nothing,
    each has told all of it.

    Parameters
    ----------
    before, after : float
        Variance before and after the sample.
    prior : float
        Variance without any sample.

    """
    below = before * (prior - after)
    return min(max(prior * (before - after) / below, 0.0), 1.0) if below > 0.0 else 1.0
