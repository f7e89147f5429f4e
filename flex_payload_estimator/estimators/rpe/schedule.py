"""The sampled arm over theta_2 and payload, as cosine series, with its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
import math
from typing import Any

from flex_payload_estimator.estimators.rpe.forces import moves
from flex_plant_sim.arm.schedule import barycentric_weights, chebyshev_nodes
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.arm.state_space import zero_order_hold
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Terms of the cosine series and Chebyshev nodes over the payload: remainders of 1e-9 of the
# matrices on the reference arm, 4e-7 on the Quanser's.
ANGLE_TERMS, PAYLOAD_NODES = 19, 28
# The same of the parts' derivatives, which act through deviations of some percent: 4e-5, 2e-4.
COARSE_TERMS, COARSE_NODES = 9, 12
# Soft mass over the lower link's mass: over xi = m / (m + soft mass) the arm is nearly polynomial.
SOFT_SHARE = 0.4
# Slices are at steps of this share of (m + soft mass), which leaves a cubic remainder of 1e-8. A
# payload known no better than to WIDE steps takes every WIDE-th only, which leaves 2e-6. The
# parts' derivatives, which act through deviations of a few percent, are held over steps of
# PART_STEP of (m + soft mass) and PART_ANGLE of the angle, rad.
SLICE_STEP, WIDE, PART_STEP, PART_ANGLE = 4e-3, 12, 0.05, 0.02
# Sizes of the caches.
CACHED_SLICES, CACHED_LAYERS, CACHED_PARTS = 128, 16, 512


# A derivative over a part: arms, and the weight of each one's table in it.
Mixture = Sequence[tuple[ExtendedArm, float]]


def differentiation_matrix(nodes: Array) -> Array:
    """Return D with (D f)_k = f'(x_k) for polynomials through Chebyshev nodes, (K, K)."""
    weights = (-1.0)**np.arange(nodes.size)
    weights[[0, -1]] *= 0.5
    gap = nodes[:, None] - nodes + np.eye(nodes.size)
    matrix = weights / weights[:, None] / gap
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return matrix


@lru_cache
def cosine_transform(count: int) -> Array:
    """Return what turns values at Chebyshev nodes of c into a_k of sum a_k cos(k theta)."""
    angle = np.arccos(np.clip(chebyshev_nodes(count), -1.0, 1.0))
    return np.linalg.inv(np.cos(angle[:, None] * np.arange(count)))


@dataclass(frozen=True)
class PayloadSlice:
    """
    The series about one payload.

    Attributes
    ----------
    payload : float
        kg.
    series : Array
        T [A B E], d/dm and d^2/dm^2 side by side, (K, 3 W), W = n (n + 2 + N), N = 0 without
        forces of motion: one product gives all at an angle.

    """

    payload: float
    series: Array


class BoundedCache:
    """
    The last results of a function of a key.

    Parameters
    ----------
    most : int
        Number of results; the oldest one is dropped for another.

    """

    def __init__(self, most: int):
        self.most = most
        self._results: dict[Any, Any] = {}

    def get(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return the result of a key, and call `make` for it if it is not there."""
        found = self._results.get(key)
        if found is None:
            if len(self._results) >= self.most:
                del self._results[next(iter(self._results))]
            found = self._results[key] = make()
        return found


@dataclass(frozen=True)
class PayloadSchedule:
    """
    T [A B E] of the delta model x+ = x + T (A x + B u + E f), over theta_2 and m.

    f are the forces of motion, (N,), see forces.py.

    Attributes
    ----------
    axis, coarse_axis : Array
        Chebyshev nodes of the payload axis, on [-1, 1].
    table : Array
        (L, K W), W as of a PayloadSlice.
    parts : Array
        Derivatives of T [A B] over part parameters, (L', K' p n (n + 2)).
    slope : Array
        Differentiation matrix of the payload axis, (L, L).
    parameters : int
        p.
    soft_mass, span : float
        kg, and the largest xi = m / (m + soft mass).

    """

    axis: Array
    coarse_axis: Array
    table: Array
    parts: Array
    slope: Array
    parameters: int
    soft_mass: float
    span: float
    slices: BoundedCache = field(default_factory=lambda: BoundedCache(CACHED_SLICES))
    part_slices: BoundedCache = field(default_factory=lambda: BoundedCache(CACHED_PARTS))
    part_layers: BoundedCache = field(default_factory=lambda: BoundedCache(CACHED_LAYERS))

    @classmethod
    def of(cls, arm: ExtendedArm, payload_max: float,
           variants: Sequence[Mixture] = ()) -> PayloadSchedule:
        """
        Tabulate an arm for payloads from 0 to `payload_max`, kg.

        Parameters
        ----------
        arm : ExtendedArm
            The model.
        payload_max : float
            kg.
        variants : sequence of Mixture
            For each part, arms in which it is changed, and the weights with which their tables
            sum to the derivative.

        """
        soft = SOFT_SHARE * arm.robot.links[1].mass
        span = payload_max / (payload_max + soft)
        axis, coarse = chebyshev_nodes(PAYLOAD_NODES), chebyshev_nodes(COARSE_NODES)
        whole = coefficients(arm, ANGLE_TERMS, _payloads(axis, span, soft))
        masses, width = _payloads(coarse, span, soft), arm.states * (arm.states + 2)
        base = coefficients(arm, COARSE_TERMS, masses, forces=False)
        parts = np.zeros((COARSE_NODES, COARSE_TERMS, len(variants), width))
        for k, mixture in enumerate(variants):
            # The weights sum to 0, or to 1 / step: less the nominal table, for the digits.
            found = sum(share * (coefficients(variant, COARSE_TERMS, masses, forces=False) - base)
                        for variant, share in mixture)
            parts[:, :, k] = np.reshape(found, (COARSE_NODES, COARSE_TERMS, width))
        return cls(axis, coarse, whole, parts.reshape(COARSE_NODES, parts[0].size),
                   differentiation_matrix(axis), len(variants), soft, span)

    def index(self, payload: float, step: float = SLICE_STEP) -> int:
        """Return the index of the slice nearest to a payload, kg."""
        return round(math.log1p(payload / self.soft_mass) / step)

    def cut(self, payload: float, variance: float = 0.0) -> PayloadSlice:
        """Return the slice for a payload, kg, that is known to a variance, kg^2."""
        index = self.index(payload)
        if variance > (WIDE * SLICE_STEP * (payload + self.soft_mass))**2:
            index = WIDE * round(index / WIDE)
        found: PayloadSlice = self.slices.get(index, lambda: self._cut(index))
        return found

    def _cut(self, index: int) -> PayloadSlice:
        payload = self.soft_mass * math.expm1(index * SLICE_STEP)
        total = payload + self.soft_mass
        weights = barycentric_weights(self._place(payload), self.axis)
        first, slope = weights @ self.slope, 2.0 / self.span * self.soft_mass / total**2
        second = slope**2 * first @ self.slope - 2.0 * slope / total * first
        cuts = (np.stack([weights, slope * first, second]) @ self.table).reshape(
            3, ANGLE_TERMS, -1)
        return PayloadSlice(payload, np.concatenate(cuts, axis=1))

    def parts_at(self, payload: float, angle: float) -> Array:
        """Return the derivatives over the parts near a payload, kg, and an angle, rad, (p, W')."""
        turn = round(angle / PART_ANGLE)
        key = (self.index(payload, PART_STEP), turn)
        found: Array = self.part_slices.get(key, lambda: self._cut_parts(*key))
        return found

    def part_layers_at(self, payload: float) -> Array:
        """Return the same near a payload, kg, as cosine series over the angle, (K', p W')."""
        return self._layers(self.index(payload, PART_STEP))

    def _cut_parts(self, index: int, turn: int) -> Array:
        """Return the derivatives at a slice and an angle, (p, W')."""
        return at_angle(self._layers(index), turn, self.parameters)

    def _layers(self, index: int) -> Array:
        layers: Array = self.part_layers.get(index, lambda: self._part_layers(index))
        return layers

    def _part_layers(self, index: int) -> Array:
        place = self._place(self.soft_mass * math.expm1(index * PART_STEP))
        weights = barycentric_weights(min(place, 1.0), self.coarse_axis)
        # All parts may be known exactly: then there is none, and no size that -1 stands for.
        return np.asarray(weights @ self.parts).reshape(
            COARSE_TERMS, self.parts.shape[1] // COARSE_TERMS)

    def _place(self, payload: float) -> float:
        """Return the place of a payload, kg, on the axis: from -1 to 1, and a little beyond."""
        return 2.0 * payload / (payload + self.soft_mass) / self.span - 1.0


def at_angle(layers: Array, turn: int, count: int) -> Array:
    """Return cosine series (K', count W) at an angle of `turn` PART_ANGLE, (count, W)."""
    wave = np.cos(turn * PART_ANGLE * np.arange(COARSE_TERMS))
    return np.asarray(wave @ layers).reshape(count, layers.shape[1] // max(count, 1))


def _payloads(axis: Array, span: float, soft: float) -> Array:
    xi = 0.5 * span * (axis + 1.0)
    return soft * xi / (1.0 - xi)


def coefficients(arm: ExtendedArm, terms: int, payloads: Array, forces: bool = True) -> Array:
    """Return the cosine coefficients of int_0^T exp(A s) ds [A B E], (L, terms W)."""
    transform, cosines = cosine_transform(terms), chebyshev_nodes(terms)
    layers = []
    for payload in payloads:
        loaded = arm.at_payload(float(payload))
        loaded.nodes = cosines
        plant = loaded.plant
        inputs = [plant.a, plant.b]
        if forces and moves(arm):
            inputs.append(plant.e)
        _, increments = zero_order_hold(plant.a, np.concatenate(inputs, axis=-1), arm.step_time)
        layers.append((transform @ increments.reshape(terms, -1)).ravel())
    return np.stack(layers)
