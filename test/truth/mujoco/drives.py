"""Forces on the chain at every step: drives, friction, ripple, and the payload's changes."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from truth.beam_elements import Array
from truth.configuration import Arm, INVISIBLE_TRAVEL, Joint
from truth.mujoco.chain import Chain, SOFT_CONTACT

# Overlap at which a soft end is as stiff as the linear one, rad, and its loss, s/rad.
DEPTH, IMPACT_LOSS = 1e-3, 0.5


class Drive:
    """One drive with its friction; keeps the lag, the bristles' bending and the integral."""

    def __init__(self, joint: Joint):
        self.joint = joint
        self.bristles = joint.bristle or joint.presliding > INVISIBLE_TRAVEL
        self.lagged = self.bend = self.asked = 0.0
        self.start: float | None = None

    def torque(self, command: float, theta: float, speed: float, step: float) -> float:
        """Return the torque on the rotor but for viscous damping, N m."""
        joint = self.joint
        if not joint.lag_inside:
            command = self._lag(command, step)
        u = command + joint.bias
        u = math.copysign(max(abs(u) - joint.dead_zone, 0.0), u)
        torque = joint.torque_gain * min(max(u, -joint.saturation), joint.saturation)
        torque += self._integral(torque * step, theta)
        if joint.lag_inside:
            torque = self._lag(torque - joint.damping * speed, step)
        ripple = joint.ripple * math.sin(joint.ripple_order * theta + joint.ripple_phase)
        torque -= joint.spring * (theta - joint.spring_rest)
        return torque + ripple - (self._bristles(speed, step) if self.bristles else 0.0)

    def _integral(self, asked: float, theta: float) -> float:
        """
        Return the torque of the loop's integrator, N m; `asked` N m s is what the step adds.

        The integral of the speed is the angle turned, as an encoder counts it.
        """
        if self.start is None:
            self.start = theta
        self.asked += asked
        turned = self.joint.damping * (theta - self.start)
        return self.joint.integral_rate * (self.asked - turned)

    def _lag(self, signal: float, step: float) -> float:
        keep = math.exp(-step / self.joint.lag) if self.joint.lag > 0.0 else 0.0
        self.lagged = keep * self.lagged + (1.0 - keep) * signal
        return self.lagged

    def level(self, speed: float) -> float:
        """Return the sliding friction at a speed, N m."""
        joint = self.joint
        base = joint.coulomb_forward if speed > 0.0 else joint.coulomb_backward
        return base + joint.stribeck * math.exp(-(speed / joint.stribeck_speed)**2)

    def _bristles(self, speed: float, step: float) -> float:
        """
        Return LuGre's friction, N m: z' = v - |v| z / travel, torque = level z / travel.

        Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE TAC 40 (1995), (1)-(2), without
        their micro-damping; z exact over a step of constant speed.
        """
        decay = abs(speed) * step / self.joint.presliding
        keep = math.exp(-decay)
        self.bend = keep * self.bend + math.copysign(1.0 - keep, speed)
        return self.level(speed) * self.bend


def soft_end(joint: Joint, lead: float, speed: float) -> float:
    """
    Return the torque of a gap's soft ends on the link, N m.

    Hunt and Crossley, J. Appl. Mech. 42 (1975): k x^1.5 (1 + 1.5 a x'), x the overlap, which at
    DEPTH has the stiffness that the configuration states.
    """
    overlap, side = abs(lead) - 0.5 * joint.backlash, math.copysign(1.0, lead)
    if overlap <= 0.0:
        return 0.0
    stiffness = joint.contact_stiffness * joint.inertia / math.sqrt(DEPTH)
    loss = 1.0 + 1.5 * IMPACT_LOSS * side * speed
    return -side * stiffness * overlap**1.5 * max(loss, 0.0)


class Surroundings:
    """Forces and parameters that change while the chain moves."""

    def __init__(self, arm: Arm, chain: Chain):
        self.arm, self.chain = arm, chain
        self.drives = [Drive(joint) for joint in arm.joints]
        model = chain.model
        names = ('payload', 'loose') if arm.payload.loose_frequency > 0.0 else ('payload',)
        share = arm.payload.loose_share if len(names) == 2 else 0.0
        self.bodies = [(model.body(name).id, part)
                       for name, part in zip(names, (1.0 - share, share))]
        self.changes = math.isfinite(arm.payload.event_time)

    def act(self, data: mujoco.MjData, command: Array, time: float, step: float) -> None:
        """Set torques, dry friction and the payload for the step to come."""
        model = self.chain.model
        for drive, address, u in zip(self.drives, self.chain.joint, command):
            theta, speed = float(data.qpos[address]), float(data.qvel[address])
            data.qfrc_applied[address] = drive.torque(float(u), theta, speed, step)
            if not drive.bristles:
                model.dof_frictionloss[address] = drive.level(speed)
        for joint, gear in zip(self.arm.joints, self.chain.gear):
            if joint.backlash > 0.0 and joint.contact_stiffness < SOFT_CONTACT:
                data.qfrc_applied[gear] = soft_end(joint, float(data.qpos[gear]),
                                                   float(data.qvel[gear]))
        for body, share in self.bodies if self.changes else ():
            model.body_mass[body] = max(share * self.arm.payload.mass_at(time), 1e-7)

    def angles(self, data: mujoco.MjData) -> Array:
        """Return the joint angles where their sensors sit, (2,) rad."""
        found = np.array([data.qpos[address] for address in self.chain.joint])
        for j, gear in enumerate(self.chain.gear):
            if gear >= 0 and not self.arm.joints[j].sensor_on_motor:
                found[j] += data.qpos[gear]
        return found
