"""Selective forgetting, SF1 (29), with the variance of its error beside its P."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from flex_plant_sim.compiled import compiled
from msg_config.errors import InputError


@dataclass(frozen=True)
class SF1Settings:
    """
    The constants of (29), (30).

    Attributes
    ----------
    alpha_0, alpha_1 : float
        0 < alpha_0 < alpha_1.
    p_0 : float
        P at the start.
    mass_0 : float
        theta_0, kg.
    variance_0 : float
        Variance of theta_0, kg^2.
    drift : float
        Growth of the variance, kg^2/s: what the payload may wander.

    """

    alpha_0: float = 0.1
    alpha_1: float = 2.0
    p_0: float = 2.0
    mass_0: float = 0.0
    variance_0: float = 0.04
    drift: float = 1e-6

    def __post_init__(self) -> None:
        """Validate."""
        if not 0.0 < self.alpha_0 < self.alpha_1:
            raise InputError('alpha_0: expected 0 < alpha_0 < alpha_1, got '
                             f'{self.alpha_0:g} and {self.alpha_1:g}')


class SF1State(NamedTuple):
    """
    Between two samples.

    Attributes
    ----------
    mass : float
        m_p, kg.
    p : float
        P of (29).
    variance : float
        Of the error of mass, kg^2.

    """

    mass: float
    p: float
    variance: float

    @classmethod
    def start(cls, settings: SF1Settings) -> SF1State:
        """Return the state at the start."""
        return cls(settings.mass_0, settings.p_0, settings.variance_0)


class Regressor(NamedTuple):
    """
    One sample of psi = phi m_p + e, (27).

    Attributes
    ----------
    psi, phi : float
        rad and rad/kg.
    slope : float
        What one kilogram really adds to psi, rad/kg; phi where the split is the tangent.
    noise : float
        Variance of e, rad^2.

    """

    psi: float
    phi: float
    slope: float
    noise: float


def sf1_update(state: SF1State, sample: Regressor, weight: float, settings: SF1Settings,
               step: float) -> SF1State:
    """
    Return the state after one sample, (29).

    Parameters
    ----------
    state : SF1State
        Before.
    sample : Regressor
        Of this sample.
    weight : float
        1 for (29) as printed; reference variance over var(e) where psi and phi are normalised.
    settings : SF1Settings
        Constants.
    step : float
        T, s.

    Notes
    -----
    Whatever the gain kappa, the error obeys (1 - kappa slope) (m - m_{t-1}) - kappa e_t. So the
    variance follows Joseph's form, V_t = (1 - kappa slope)^2 V_{t-1} + kappa^2 var(e), where P of
    (29) is none: (29) is least squares for var(e) = 1, and its forgetting restores P, not V.

    """
    return SF1State(*sf1_step(state.mass, state.p, state.variance, *sample, weight,
                              settings.alpha_0, settings.alpha_1, settings.drift * step))


@compiled
def sf1_step(mass: float, p: float, variance: float, psi: float, phi: float, slope: float,
             noise: float, weight: float, alpha_0: float, alpha_1: float, walk: float
             ) -> tuple[float, float, float]:
    """Return mass, P and variance after one sample, see `sf1_update`; walk in kg^2."""
    kappa = p * phi * weight / (1.0 + phi * p * phi * weight)
    rest = 1.0 - kappa * slope
    forgotten = (alpha_1 - alpha_0) / alpha_1 * p + alpha_0
    return (mass + kappa * (psi - phi * mass), (1.0 - kappa * phi) * forgotten,
            rest * rest * (variance + walk) + kappa * kappa * noise)


def bounded(state: SF1State, low: float, high: float) -> SF1State:
    """Return the state with its mass inside [low, high], kg."""
    return state if low <= state.mass <= high else state._replace(
        mass=min(max(state.mass, low), high))
