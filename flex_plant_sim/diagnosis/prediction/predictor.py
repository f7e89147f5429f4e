"""One-step prediction over the windows of a record, by a scheduled steady Kalman predictor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.schedule import barycentric_weights
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.gauge_error import GaugeError
from flex_plant_sim.diagnosis.prediction.noise import load_levels, process_noise, steady_gain
from flex_plant_sim.diagnosis.prediction.nuisance import nuisances, settled
from flex_plant_sim.diagnosis.prediction.passage import Matrices, Run, undo_sensors
from flex_plant_sim.diagnosis.record.windows import Record, Windows
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

NODES = 7
PASSES = 2
LEVEL_STEP = 0.01


@dataclass(frozen=True)
class Base:
    """
    The model that hypotheses are added to.

    Attributes
    ----------
    robot : Robot
    model : str
    modes : int
    effects : tuple of Effect
        Always on.
    level : tuple of float
        Process noise as shares of the loads in a 10 ms step, see process_noise.
    deviations : tuple of float
        Of the robot's parameters from its file, as `nuisances` lists them, (p,); or none.

    """

    robot: Robot
    model: str = 'assumed_modes'
    modes: int = 3
    effects: tuple[Effect, ...] = ()
    level: tuple[float, float] = (0.01, 0.02)
    deviations: tuple[float, ...] = ()

    def settled(self, payload: float) -> Base:
        """Return the base with its deviations in the robot and the effects."""
        robot, effects = settled(self.robot, nuisances(self.robot, payload),
                                 np.array(self.deviations))
        return replace(self, robot=robot, effects=(*self.effects, *effects), deviations=())

    def arm(self, payload: float, effects: Sequence[Effect] = (),
            robot: Robot | None = None, in_step: bool = False) -> ExtendedArm:
        """Return the arm with further effects; see ExtendedArm."""
        return ExtendedArm(robot or self.robot, self.model, self.modes, payload,
                           (*self.effects, *effects), nodes=NODES, in_step=in_step)


class Predictor:
    """
    A record, its windows and the base model's filtered trajectory through it.

    Smooth forces are evaluated along that trajectory, sensors that are affine are inverted, so
    that most hypotheses stay linear in the state; dry friction and contact are not.

    Parameters
    ----------
    base : Base
    windows : Windows
    noise : Array
        Standard deviation of each output channel, (m,).
    judging : bool
        Whether it serves to tell causes apart. Then gauges have an error of their own, and
        strain that reads whole samples late is brought forward to the angles it belongs to: the
        likelihood of a record is the same in any order of its samples, and so exact for delays
        of any length. What is predicted in real time must not be brought forward.

    """

    def __init__(self, base: Base, windows: Windows, noise: Array, judging: bool = False):
        self.base, self.windows, self.noise, self.judging = base, windows, noise, judging
        self.record: Record = windows.record
        self.gauge_error = GaugeError.of(windows, base.robot.sample_time)
        self.arm = arm = self.arm_with()
        self.weights = barycentric_weights(np.cos(self.record.output[:, 1]), arm.nodes)
        self.gain = self.gain_of(arm)
        self.states = np.zeros((len(self.record.time), arm.states))
        for _ in range(PASSES):
            self.states = self._filter(arm)
            self.angle = self.states[:, :arm.form.order] @ arm.form.elbow_angle
            self.weights = barycentric_weights(np.cos(self.angle), arm.nodes)

    def arm_with(self, effects: Sequence[Effect] = (), robot: Robot | None = None) -> ExtendedArm:
        """Return the base's arm with further effects, or another robot's."""
        if not self.judging:
            return self.base.arm(self.record.payload, effects, robot)
        # The gauges' error comes first, so that its states are behind the arm's own.
        judged = replace(self.base, effects=(self.gauge_error, *self.base.effects))
        return judged.arm(self.record.payload, effects, robot, in_step=True)

    def _force_variance(self, arm: ExtendedArm) -> Array:
        # White force noise of the same density moves a shorter step by less than its share.
        share = np.sqrt(LEVEL_STEP / arm.robot.sample_time)
        return process_noise(load_levels(arm, self.record.command, self.record.output),
                             (share * self.base.level[0], share * self.base.level[1]))

    def gain_of(self, arm: ExtendedArm) -> Array:
        """Return an arm's steady gain: another arm's may be unstable with it."""
        own = self.gauge_error.step_variance(arm, self.windows) if self.judging else 0.0
        return steady_gain(arm, self._force_variance(arm), self.noise, own)

    def innovations(self, effects: Sequence[Effect] = (), robot: Robot | None = None,
                    gain: Array | None = None) -> Array:
        """
        Return y - y_predicted over the scored samples, (B, W, length, m).

        Parameters
        ----------
        effects : sequence of Effect
            On top of the base's; their values may be arrays (B, 1).
        robot : Robot, optional
            In place of the base's.
        gain : Array, optional
            (K, n, m); the arm's own by default.

        """
        if any(effect.reshapes for effect in effects):
            return self._with_other_shapes(effects, robot).innovations(gain=gain)
        arm = self.arm_with(effects, robot)
        used = np.unique(self.windows.indices)
        if gain is None and robot is None and not any(e.structural for e in effects):
            matrices = self.matrices
        else:
            gain = self.gain_of(arm) if gain is None else gain
            matrices = Matrices.of(self, arm, gain, used)
        run = Run(self, arm, matrices, used, _batch(effects))
        rows = np.searchsorted(used, self.windows.indices.T)
        states = run.states(rows, run.trajectory[rows[0], 0])
        scored, rows = states[self.windows.warm_up:], rows[self.windows.warm_up:]
        errors = run.measured[rows] - scored @ arm.output_matrix.T
        return np.ascontiguousarray(errors.transpose(2, 1, 0, 3))

    def _with_other_shapes(self, effects: Sequence[Effect], robot: Robot | None) -> Predictor:
        """Return a predictor with a trajectory of its own: its coordinates mean other shapes."""
        other = replace(self.base, robot=robot or self.base.robot,
                        effects=(*self.base.effects, *effects))
        return Predictor(other, self.windows, self.noise, self.judging)

    @cached_property
    def matrices(self) -> Matrices:
        """Return the base's matrices, which serve all effects that leave the plant alone."""
        return Matrices.of(self, self.arm, self.gain, np.unique(self.windows.indices))

    def thinned(self, every: int) -> Predictor:
        """Return the same predictor, asked about every so-manieth window alone."""
        other = object.__new__(Predictor)
        other.__dict__.update({k: v for k, v in self.__dict__.items() if k != 'matrices'})
        other.windows = self.windows.thinned(every)
        return other

    def _filter(self, arm: ExtendedArm) -> Array:
        """Return the predicted states of the base over the whole record, (N, n)."""
        rows = np.arange(len(self.record.time))
        run = Run(self, arm, Matrices.of(self, arm, self.gain, rows), rows, 1)
        start = np.zeros((1, arm.states))
        start[0, :2] = self.record.output[0, :2]
        return run.states(rows[:, None], start)[:, 0, 0]

    def weights_of(self, arm: ExtendedArm) -> Array:
        """Return the weights over schedule nodes where an arm's sensors put the elbow, (N, K)."""
        shift = self._angle_shift(arm)[:, 1]
        if not shift.any():
            return self.weights
        return barycentric_weights(np.cos(self.angle + shift), arm.nodes)

    def _angle_shift(self, arm: ExtendedArm) -> Array:
        """Return how far the joints are from where the base sees them, (N, 2)."""
        if not arm.acts_on_output:
            return np.zeros((len(self.record.time), 2))
        undone = undo_sensors(arm, self.record)
        return undone[:, 0, :2] - undo_sensors(self.arm, self.record)[:, 0, :2]

    def started(self, arm: ExtendedArm) -> Array:
        """Return the base's states, (N, n); where coordinates were added, they are at zero."""
        states = self._started(arm)
        states[:, :2] += self._angle_shift(arm)
        return states

    def _started(self, arm: ExtendedArm) -> Array:
        n, extra = self.arm.form.order, arm.form.order - self.arm.form.order
        states = np.zeros((len(self.states), arm.states))
        if extra > 0:
            states[:, :n] = self.states[:, :n]
            states[:, n + extra:2 * n + extra] = self.states[:, n:2 * n]
            return states
        known = min(self.states.shape[1], arm.states)
        states[:, :known] = self.states[:, :known]
        return states


def _batch(effects: Sequence[Effect]) -> int:
    """Return B, from effects whose values are arrays (B, 1)."""
    shapes = [np.shape(value) for effect in effects for value in effect.values]
    return max([shape[0] for shape in shapes if shape], default=1)
