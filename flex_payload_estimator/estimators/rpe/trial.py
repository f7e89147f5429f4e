"""A trial: a filter beside the incumbent that may take its place."""

from __future__ import annotations

from dataclasses import dataclass

from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.modes import freedom

# A filter that begins afresh needs this long, s, to know what it can know of the state.
SETTLING_S = 0.1


@dataclass(eq=False)
class Trial:
    """
    A filter beside the incumbent, and how much likelier than that it is.

    Attributes
    ----------
    kind : str
        'change': a payload that walks, beside one that is constant; 'constant': a constant
        payload beside one that walks; 'mode': another mode.
    kalman : Filter
        Its Kalman filter.
    since : float
        When it began; of a CUSUM, when it was last zero, which dates a change, s.
    mass_before : float
        The incumbent's payload when it began, kg.
    misfit, score : float
        The incumbent's misfit and score ratio at `since`, see misfit.py.
    log_ratio : float
        Log-likelihood ratio over the incumbent since `since`, nats.
    counted : float
        Time over which that is counted, s.
    run : float
        Time since it began, s.
    largest : float
        Largest log_ratio since `since`, nats.
    judged : Filter or None
        The same hypothesis, linearised as the incumbent is, where `kalman` is linearised
        otherwise; it gives the likelihood, see restarts.with_payload_walk.

    """

    kind: str
    kalman: Filter
    since: float
    mass_before: float
    misfit: float = 1.0
    score: float = 1.0
    log_ratio: float = 0.0
    counted: float = 0.0
    run: float = 0.0
    largest: float = 0.0
    judged: Filter | None = None

    @property
    def filters(self) -> list[Filter]:
        """Return its filters; the last gives the likelihood."""
        return [self.kalman] if self.judged is None else [self.kalman, self.judged]

    def add(self, time: float, log_ratio: float) -> None:
        """Count a sample: its time, s, and its log-likelihood ratio, nats."""
        self.run, self.counted = self.run + time, self.counted + time
        self.log_ratio += log_ratio
        if self.log_ratio > self.largest:
            self.largest = self.log_ratio

    def restart_sum(self, time: float, misfit: float = 1.0, score: float = 1.0) -> None:
        """Count from a time, s, on; the incumbent has a misfit and a score ratio."""
        self.log_ratio = self.counted = self.largest = 0.0
        self.since, self.misfit, self.score = time, misfit, score

    @property
    def is_settling(self) -> bool:
        """Whether it restarted just now, and is still behind for that alone."""
        if self.kind == 'mode':
            return self.kalman.age < SETTLING_S
        return self.kind == 'constant' and self.counted < SETTLING_S

    def is_cusum(self, incumbent: Filter) -> bool:
        """Tell whether its hypothesis may become true at any time, so that Page's sum counts."""
        return self.kind == 'change' or freedom(self.kalman.mode) > freedom(incumbent.mode)

    def has_less_freedom(self, incumbent: Filter) -> bool:
        """Tell whether its mode has less freedom than the incumbent's."""
        return freedom(self.kalman.mode) < freedom(incumbent.mode)

    def sample_log_ratio(self, incumbent: Filter) -> float:
        """
        Return the log-likelihood ratio of the last sample over the incumbent, nats.

        Within one mode by the densities as stated; across modes by those scaled to the fit,
        because a larger model error would otherwise pay for itself.
        """
        if self.kalman.mode.name == incumbent.mode.name:
            return self.filters[-1].stated_log_density - incumbent.stated_log_density
        return self.kalman.log_density - incumbent.log_density
