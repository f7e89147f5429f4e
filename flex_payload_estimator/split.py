"""The split A = A^0 + m_p A^m, B = B^0 + m_p B^m, (13): as printed, resolvent and tangent."""

from __future__ import annotations

from typing import Literal, NamedTuple

from flex_plant_sim.arm_model import Array
from flex_plant_sim.errors import InputError
from flex_plant_sim.paper_model import CompactForm
import numpy as np
from scipy.linalg.lapack import dgesv

SplitKind = Literal['paper', 'resolvent', 'tangent']
KINDS = ('paper', 'resolvent', 'tangent')


class Split(NamedTuple):
    """
    (13) at one theta_2 and one payload.

    Attributes
    ----------
    a, b : Array
        A (n, n) and B (n, 2) at the payload.
    a_m, b_m : Array
        A^m and B^m, per kg; A^0 = A - m_p A^m.
    mass : float
        m_p, kg.

    """

    a: Array
    b: Array
    a_m: Array
    b_m: Array
    mass: float

    @property
    def a_0(self) -> Array:
        """Return A^0."""
        return self.a - self.mass * self.a_m

    @property
    def b_0(self) -> Array:
        """Return B^0."""
        return self.b - self.mass * self.b_m


def check_kind(kind: str) -> None:
    """
    Raise where a split is unknown.

    Raises
    ------
    InputError
        Not one of KINDS.

    """
    if kind not in KINDS:
        raise InputError(f'split: expected one of {", ".join(KINDS)}, got {kind!r}')


def split_compact(form: CompactForm, mass: float, kind: SplitKind = 'resolvent') -> Split:
    """
    Return the split of (12) for a compact form.

    Parameters
    ----------
    form : CompactForm
        M_1…M_7 at theta_2.
    mass : float
        A priori m_p, kg.
    kind : str
        'paper': (15), (16), Lambda frozen. 'resolvent': by Lambda = Lambda_0 + m_p Lambda M_3^m
        Lambda_0, so that A^0 = A(0) and A^m is the secant from 0 to m_p. 'tangent': A^m = dA/dm_p.

    """
    check_kind(kind)
    return compact_blocks(form.lam(mass), np.eye(len(form.m_1)) - form.m_3[0], form.m_3[1],
                          (form.m_1, *form.m_2, *form.m_5), form.m_6, form.m_7, mass, kind)


def compact_blocks(lam: Array, mass_0: Array, mass_m: Array, terms: tuple[Array, ...],
                   m_6: Array, m_7: Array, mass: float, kind: SplitKind) -> Split:
    """
    Return the split from Lambda, I - M_3^0, M_3^m and (M_1, M_2^0, M_2^m, M_5^0, M_5^m).

    M_4 vanishes with the reduced actuators.
    """
    m_1, m_20, m_2m, m_50, m_5m = terms
    f = len(m_1)
    rate, jump = lam.dot(m_20 + mass * m_2m), lam.dot(m_50 + mass * m_5m)
    a, b = np.zeros((2 + 2 * f, 2 + 2 * f)), np.zeros((2 + 2 * f, 2))
    a[:2, 2:2 + f] = m_6
    a[2:2 + f, 2 + f:] = np.eye(f)
    a[2 + f:, 2:2 + f] = stiffness = lam.dot(m_1)
    a[2 + f:, 2 + f:] = rate
    b[:2], b[2:2 + f], b[2 + f:] = m_7, jump, rate.dot(jump)
    a_m, b_m = np.zeros_like(a), np.zeros_like(b)
    rate_m, jump_m = lam.dot(m_2m), lam.dot(m_5m)
    if kind == 'paper':
        # Lambda M_2^m Lambda M_5^0 + Lambda M_2^0 Lambda M_5^m, (15)
        product_m = rate_m.dot(lam.dot(m_50)) + lam.dot(m_20).dot(jump_m)
    else:
        through = lam.dot(mass_m)
        if kind == 'resolvent':
            lam_0 = dgesv(mass_0, np.eye(f))[2]
            stiffness, rate_0, jump_0 = lam_0.dot(m_1), lam_0.dot(m_20), lam_0.dot(m_50)
            rate_m, jump_m = rate_m + through.dot(rate_0), jump_m + through.dot(jump_0)
            product_m = rate_m.dot(jump_0) + rate.dot(jump_m)
        else:
            rate_m, jump_m = rate_m + through.dot(rate), jump_m + through.dot(jump)
            product_m = rate_m.dot(jump) + rate.dot(jump_m)
        a_m[2 + f:, 2:2 + f] = through.dot(stiffness)
    a_m[2 + f:, 2 + f:] = rate_m
    b_m[2:2 + f], b_m[2 + f:] = jump_m, product_m
    return Split(a, b, a_m, b_m, mass)


def split_second_order(mass_0: Array, mass_m: Array, right: Array, mass: float,
                       kind: SplitKind) -> Split:
    """
    Return the split of x = (p, p') with Lambda = M^-1, M = mass_0 + m_p mass_m.

    'resolvent' uses Lambda = Lambda_0 - m_p Lambda M^m Lambda_0, 'tangent' dLambda/dm_p
    = -Lambda M^m Lambda. The payload enters through Lambda alone, so that (15), which freezes
    it, would leave nothing to estimate.

    Parameters
    ----------
    mass_0, mass_m : Array
        (N, N).
    right : Array
        [-K, -D, B], (N, 2N + 2).
    mass : float
        m_p, kg.
    kind : str
        'resolvent' or 'tangent'.

    Raises
    ------
    InputError
        kind is 'paper'.

    """
    check_kind(kind)
    if kind == 'paper':
        raise InputError('split: expected resolvent or tangent for a second-order model, got '
                         '\'paper\', which needs model paper_reduced')
    n = len(mass_0)
    solved = dgesv(mass_0 + mass * mass_m, np.hstack([right, mass_m]))[2]
    base = dgesv(mass_0, right)[2] if kind == 'resolvent' else solved[:, :2 * n + 2]
    slope = -solved[:, 2 * n + 2:].dot(base)
    a, a_m = np.zeros((2, 2 * n, 2 * n))
    b, b_m = np.zeros((2, 2 * n, 2))
    a[:n, n:] = np.eye(n)
    a[n:], b[n:] = solved[:, :2 * n], solved[:, 2 * n:2 * n + 2]
    a_m[n:], b_m[n:] = slope[:, :2 * n], slope[:, 2 * n:]
    return Split(a, b, a_m, b_m, mass)
