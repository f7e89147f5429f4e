"""Modes: how far the model of the arm, and the payload, may be from what the filter is told."""

from __future__ import annotations

from typing import NamedTuple

from flex_payload_estimator.estimators.rpe.compiled_step import NoiseModel


class Mode(NamedTuple):
    """
    A hypothesis about what is wrong with the model.

    Attributes
    ----------
    name : str
        'exact', 'rough' or 'coarse'; variants of a mode carry its name.
    free_parts : bool
        Whether parts and gauge gains are estimated, with the robot file's tolerances as prior
        standard deviations.
    gauge_error, drive_error : float
        Standard deviation of the model error of a gauge, and of a drive's net torque, as a share
        of its recent root mean square; white noise, drawn afresh every filter_step.ERROR_STEP_S.
    payload_walk : float
        Random walk of the payload, kg per square root of a second; 0 for a constant payload.
    bending : bool
        Whether the forces of motion have the terms of first order in the links' deflections.

    """

    name: str
    free_parts: bool
    gauge_error: float
    drive_error: float
    payload_walk: float = 0.0
    bending: bool = True


# Ordered by freedom. The errors of `rough` were chosen with benchmarks/model_error.py and
# benchmarks/loop_band.py on tuning seeds, with three shapes a link. The drive error of `coarse`
# covers a drive's whole torque and more (friction, a gap, a lag): with 0.6, as for a gauge, the
# bands on the MuJoCo arms of benchmarks/hidden_effects.py (seeds 10010 to 10129) are 1.2 to 1.7
# times as wide and contain the payload no more often.
MODES = (Mode('exact', False, 0.0, 0.0, bending=False), Mode('rough', True, 0.1, 0.1),
         Mode('coarse', True, 0.6, 2.0))
EXACT, ROUGH, COARSE = MODES
# Parts as in the robot file, but the links bend as real ones do, whatever the file names.
EXACT_BENDING = EXACT._replace(bending=True)
# `rough` on trial, with a smaller model error. It has to find where to linearise, and whether
# parts are off; a large model error hides that where the arm moves little.
ROUGH_ON_TRIAL = ROUGH._replace(gauge_error=0.05, drive_error=0.05)
# Free parts with hardly any model error, to compare with exact models, at the start and over the
# sample window. With the error of `rough`, an exact model a few percent off would be the likelier
# by up to a hundred nats. With none, what the linearisation neglects decides, and some runs on
# the filter's own model go astray.
PARTS_FREE = ROUGH._replace(gauge_error=0.01, drive_error=0.01)
FREEDOM = {mode.name: place for place, mode in enumerate(MODES)}


def freedom(mode: Mode) -> int:
    """Return how much a mode allows: 0 for `exact`, 1 for `rough`, 2 for `coarse`."""
    return FREEDOM[mode.name]


def noise_model(mode: Mode, error_samples: float, gains: float, payload_max: float, step: float,
                gate: float) -> NoiseModel:
    """
    Return the numbers that the compiled step takes of a mode.

    Parameters
    ----------
    mode : Mode
        Whose.
    error_samples : float
        Number of samples over which a model error is the same.
    gains : float
        Number of gauge gains among the parameters of a mode with free parts.
    payload_max : float
        Largest payload, kg.
    step : float
        Sampling time, s.
    gate : float
        See likelihood.gate_of.

    """
    # A filter with a model error expects more than it sees, so it cannot tell that the noise is
    # less than the robot file says: its scale is at least 1.
    least_scale, gains = (1.0, gains) if mode.free_parts else (0.0, 0.0)
    return (mode.drive_error**2 * error_samples, mode.payload_walk**2 * step,
            mode.gauge_error**2 * error_samples, least_scale, gains, payload_max, step, gate)
