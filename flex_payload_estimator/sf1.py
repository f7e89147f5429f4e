"""Selective forgetting, SF1 (29), with the variance of its error beside its P."""

from __future__ import annotations

from dataclasses import dataclass, replace

from flex_plant_sim.errors import InputError


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


@dataclass(frozen=True)
class SF1State:
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


def sf1_update(state: SF1State, psi: float, phi: float, noise: float, settings: SF1Settings,
               step: float, normalise: bool) -> SF1State:
    """
    Return the state after one sample of psi = phi m_p + e, (29).

    Parameters
    ----------
    state : SF1State
    psi, phi : float
        rad and rad/kg.
    noise : float
        Variance of e, rad^2.
    settings : SF1Settings
    step : float
        T, s.
    normalise : bool
        Divide psi and phi by the standard deviation of e, so that P counts in kg^2.

    Notes
    -----
    With a gain kappa chosen in whatever way, the error m - m_t obeys
    (1 - kappa phi) (m - m_{t-1}) - kappa e_t. The variance follows as Joseph's form,
    V_t = (1 - kappa phi)^2 V_{t-1} + kappa^2 var(e), true where P of (29) is no variance.

    """
    weight = 1.0 / noise if normalise else 1.0
    kappa = state.p * phi * weight / (1.0 + phi * state.p * phi * weight)
    mass = state.mass + kappa * (psi - phi * state.mass)
    forgotten = (settings.alpha_1 - settings.alpha_0) / settings.alpha_1 * state.p \
        + settings.alpha_0
    rest = 1.0 - kappa * phi
    variance = rest * rest * (state.variance + settings.drift * step) + kappa * kappa * noise
    return SF1State(mass, rest * forgotten, variance)


def bounded(state: SF1State, low: float, high: float) -> SF1State:
    """Return the state with its mass inside [low, high], kg."""
    return replace(state, mass=min(max(state.mass, low), high))
