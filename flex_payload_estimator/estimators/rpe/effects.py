"""What a robot file's effects do to a prediction: commands, forces, contact and sensors."""

from __future__ import annotations

from flex_payload_estimator.estimators.rpe.filter import Filter
from flex_payload_estimator.estimators.rpe.friction import brake
from flex_payload_estimator.estimators.rpe.schedule import BoundedCache
from flex_plant_sim.arm.schedule import chebyshev_nodes
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.effects.mechanics.kinematics import end_rotations
from flex_plant_sim.simulation.drive_input import DriveInput
from flex_plant_sim.simulation.extended_arm import ExtendedArm
import numpy as np

# Nodes over cos theta_2, which leave 1e-5 of the matrices, and payloads whose arms are kept.
NODES, CACHED_ARMS = 9, 16


class EffectStep:
    """
    The effects of an extended arm that are not in its sampled matrices.

    Parameters
    ----------
    arm : ExtendedArm

    Attributes
    ----------
    moves : bool
        Whether an effect acts on the motion, by a force or a contact.
    drive_input : DriveInput
        From the commands sent to those that the drives apply.
    memory : int
        Number of past commands that effects need.

    """

    def __init__(self, arm: ExtendedArm):
        self.arm = arm
        self.drive_input = DriveInput(arm)
        self.moves = arm.has_contact or any(
            type(effect).force is not Effect.force for effect in arm.effects)
        self.memory = max([e.memory(arm.robot.sample_time) for e in arm.effects], default=0)
        self._loaded = BoundedCache(CACHED_ARMS)

    def output_matrix(self) -> Array:
        """Return d(sensors)/dx about the straight arm at rest, (m, n)."""
        unit = np.eye(self.arm.states)
        return (self.arm.output(unit, 0.0) - self.arm.output(0.0 * unit, 0.0)).T

    def bend_rows(self) -> Array:
        """Return the angles by which bending turns the links' ends over the state, (2, n)."""
        return np.pad(end_rotations(self.arm.form, self.arm.robot),
                      ((0, 0), (0, self.arm.states - self.arm.form.order)))

    def _at_payload(self, payload: float) -> ExtendedArm:
        """Return the arm with a payload, kg."""
        arm = self.arm.at_payload(payload)
        arm.nodes = chebyshev_nodes(NODES)
        return arm

    def push(self, f: Filter, payload: float, before: Array, command: Array, time: float
             ) -> None:
        """
        Let forces, contacts and friction act on a filter that the linear plant has predicted.

        Parameters
        ----------
        f : Filter
            x changes, and P with dry friction.
        payload : float
            kg, of the slice of the schedule in use.
        before : Array
            State before the step, (n,).
        command : Array
            At the drive, (2,).
        time : float
            s, at the start of the step.

        """
        arm: ExtendedArm = self._loaded.get(payload, lambda: self._at_payload(payload))
        force = arm.schedule.at(np.cos(before[1]))[2]
        f.x[:] = arm.apply_free_effects(force, before, f.x, command, time)
        if arm.has_friction:
            brake(f, arm, force, before, arm.motion(before, command, time))
