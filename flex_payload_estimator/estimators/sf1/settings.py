"""
Settings of the SF1 estimators: the constants of (30) and the choices beyond the paper.

`Pace` converts the constants to other sampling intervals, as densities over time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from flex_payload_estimator.estimators.base import largest_payload
from flex_payload_estimator.model.delta import TERMS
from flex_plant_sim.arm.robot import Robot
from msg_config.errors import InputError

Regression = Literal['paper', 'resolvent']
# Sampling interval that the constants of (30) belong to, s.
PAPER_STEP = 0.01


@dataclass(frozen=True)
class SF1Settings:
    """
    The constants of (29), (30).

    Attributes
    ----------
    alpha_0, alpha_1 : float
        0 < alpha_0 < alpha_1; alpha_0 is added to P per sample of PAPER_STEP.
    p_0 : float
        P at the start.
    mass_0 : float
        theta_0, the payload at the start, kg.
    variance_0 : float
        Variance of theta_0, kg^2.

    """

    alpha_0: float = 0.1
    alpha_1: float = 2.0
    p_0: float = 2.0
    mass_0: float = 0.0
    variance_0: float = 0.04

    def __post_init__(self) -> None:
        """Validate."""
        if not 0.0 < self.alpha_0 < self.alpha_1:
            raise InputError('alpha_0: expected 0 < alpha_0 < alpha_1, got '
                             f'{self.alpha_0:g} and {self.alpha_1:g}')


@dataclass(frozen=True)
class SF1EstimatorSettings:
    """
    The constants of (30), and the choices beyond the paper.

    Attributes
    ----------
    regression : str
        'paper': split (15), (16), psi and phi as printed, a regression at every sample with the
        constants unchanged, the state carried on by (23).
        'resolvent': resolvent split, psi and phi divided by the ratio of the standard deviation
        of the composite innovation to its settled value (so that the constants keep their
        scale), a regression at the pace to which the constants belong, the state carried on by
        (24).
    r_1, r_2 : float
        R_1 = r_1 I, R_2 = r_2 I of the predictor, angles in rad, gauges in V, per sample of
        PAPER_STEP.
    terms : int
        n' of (19).
    exact : bool
        Halve the step of (19) where n' terms do not reach full accuracy.
    payload_max : float or None
        The estimate stays in [0, payload_max], kg; None for what `largest_payload` says.
    sf1 : SF1Settings

    """

    regression: Regression = 'resolvent'
    r_1: float = 1e-4
    r_2: float = 1e-4
    terms: int = TERMS
    exact: bool = True
    payload_max: float | None = None
    sf1: SF1Settings = field(default_factory=SF1Settings)

    def __post_init__(self) -> None:
        """Validate."""
        if self.regression not in ('paper', 'resolvent'):
            raise InputError('regression: expected paper or resolvent, got '
                             f'{self.regression!r}')


DEFAULT_SETTINGS = SF1EstimatorSettings()
PAPER_SETTINGS = SF1EstimatorSettings(regression='paper', exact=False)


@dataclass(frozen=True)
class Pace:
    """
    How often to regress at a sampling interval, and how the constants of (30) scale with it.

    SF1 compares one step of the arm with one measurement, and the information on the payload in a
    step grows with the square of its length: steps of 1 ms, however many, tell next to nothing.
    So faster data is regressed at the pace of (30) and predicted exactly in between. For slower
    data the constants are densities over time: R_1 and alpha_0 grow with the step, R_2 shrinks.

    Attributes
    ----------
    samples : int
        Samples from one regression to the next.
    share : float
        Their duration divided by PAPER_STEP.

    """

    samples: int = 1
    share: float = 1.0

    @classmethod
    def of(cls, step: float, regression: Regression) -> Pace:
        """Return the pace at a sampling interval, s; 'paper' takes its constants as printed."""
        if regression == 'paper':
            return cls()
        samples = max(1, round(PAPER_STEP / step))
        return cls(samples, samples * step / PAPER_STEP)


def check_usable(robot: Robot, model: str, modes: int, settings: SF1EstimatorSettings) -> None:
    """
    Check that SF1 can estimate with a robot, model and settings.

    Raises
    ------
    InputError
        More modes than gauges on a link, a payload at the start beyond the largest, or
        regression 'paper' on another model than 'paper_reduced'.

    """
    if settings.regression == 'paper' and model != 'paper_reduced':
        raise InputError(f'regression: paper needs model paper_reduced, got {model!r}; '
                         'it is what estimator sf1_paper has, estimator sf1 takes any model')
    gauges = min(len(link.gauge_positions) for link in robot.links)
    if modes > gauges:
        raise InputError(f'modes: SF1 needs a gauge a mode on each link, expected at most '
                         f'{gauges}, got {modes}; estimator rpe needs none')
    most = largest_payload(robot, settings.payload_max)
    if settings.sf1.mass_0 > most:
        raise InputError(f'payload_initial: expected at most the largest payload, {most:g} kg, '
                         f'got {settings.sf1.mass_0:g}')
