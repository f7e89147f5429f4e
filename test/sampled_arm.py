"""The finite-element arm one sample at a time, for a controller to close the loop."""

from __future__ import annotations

from flex_plant_sim.arm.robot import Robot
import numpy as np
from truth.assembly import assemble
from truth.beam_elements import Array
from truth.configuration import Arm, Joint, Link, reference_arm, Structure
from truth.integrator import Loop, run
from truth.simulation import copy_terms, plant_of, stable_step


def elements_of(robot: Robot, payload: float) -> Arm:
    """Return the true arm that has a robot's parts."""
    arm = reference_arm(payload)
    links = tuple(Link(link.length, link.thickness, link.height, link.youngs_modulus, link.density,
                       link.damping_ratio, tuple(link.gauge_positions), link.hub_radius)
                  for link in robot.links)
    joints = tuple(Joint(drive.inertia, drive.torque_gain, drive.damping)
                   for drive in robot.drives)
    structure = Structure(robot.elbow_mass, robot.elbow_inertia)
    return Arm(links, joints, structure, arm.payload, arm.sensors,  # type: ignore[arg-type]
               robot.sample_time, arm.step, arm.shapes, arm.position_gain, arm.command_limit,
               arm.excitation)


class Elements:
    """The finite-element arm, one sample at a time, with the robot's noise."""

    def __init__(self, arm: Arm, robot: Robot, seed: int):
        self.arm, self.system = arm, assemble(arm)
        step = stable_step(arm, self.system)
        steps, sensors = round(arm.sample_time / step), arm.sensors
        angle = np.array([sensors.angle_gain, sensors.angle_offset, sensors.angle_step,
                          [False, False]], dtype=float).T.copy()
        # Two samples, because the state after a step is read from the second one.
        self._loop = Loop(False, np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((2, 2)),
                          np.zeros((2, 2)), angle, np.full(2 * steps, arm.payload.mass),
                          copy_terms(self.system.lower_empty),
                          copy_terms(self.system.payload_unit), self.system.curvature, step,
                          steps, 0.0)
        self._plant, self.state = plant_of(arm, self.system), np.zeros((2, self.system.size))
        self._noise = np.concatenate([np.full(2, robot.angle_noise), np.full(
            len(self.system.curvature), robot.strain_noise)])
        self._random = np.random.default_rng(seed)

    def measure(self) -> Array:
        """Return (theta_1, theta_2, strain…) with noise, (m,)."""
        exact = np.concatenate([self.state[0, :2], self.system.curvature @ self.state[0]])
        return np.asarray(exact + self._noise * self._random.standard_normal(exact.size))

    def step(self, command: Array) -> None:
        """Advance one sample."""
        self._loop.command[:] = command
        strain = np.zeros((2 * self._loop.steps_per_sample, len(self.system.curvature)))
        states = np.zeros((2, *self.state.shape))
        run(self._plant, self._loop, self.state[0].copy(), self.state[1].copy(),
            np.zeros((2, 2)), strain, states)
        self.state = states[1]

    def tip(self) -> Array:
        """Return the position of the payload, m, (2,)."""
        upper, lower, p = self.system.upper, self.system.lower_empty, self.state[0]
        n = upper.tip.size
        q_1, q_2 = p[2:2 + n], p[2 + n:2 + n + lower.tip.size]
        return place(self.arm, p[:2], (upper.tip @ q_1, upper.tip_slope @ q_1, lower.tip @ q_2))


def place(arm: Arm, joints: Array, bent: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
    """
    Return the position of the tip, m, (2,).

    `bent` holds the upper link's deflection, m, and slope, rad, and the lower one's deflection, m.
    """
    reach = [link.hub_radius + link.length for link in arm.links]
    tip = np.exp(1j * joints[0]) * (reach[0] + 1j * bent[0])
    tip += np.exp(1j * (joints.sum() + bent[1])) * (reach[1] + 1j * bent[2])
    return np.array([tip.real, tip.imag])
