"""
Joint drives: DC motor with tacho loop and gear (Appendix A), or a current drive.

A drive turns a command into the torque on a joint; the arm models take its inertia and damping.
"""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class DCMotor:
    """
    A DC motor inside an analog tacho loop behind a stiff gear (Figures 10 and 11).

    Attributes
    ----------
    torque_constant : float
        k_t = k_e, N m/A.
    resistance : float
        R_a, ohm.
    friction : float
        f, N m s/rad, motor side.
    inertia : float
        J, kg m^2, motor side.
    amplifier_gain : float
        k_p, dimensionless.
    tacho_gain : float
        k_tg, V s/rad.
    gear_ratio : float
        N.

    """

    torque_constant: float
    resistance: float
    friction: float
    inertia: float
    amplifier_gain: float
    tacho_gain: float
    gear_ratio: float

    @property
    def loop_damping(self) -> float:
        """Return f + F_t, N m s/rad, with F_t = k_et k_t / R_a."""
        k_et = self.torque_constant + self.amplifier_gain * self.tacho_gain
        return self.friction + k_et * self.torque_constant / self.resistance

    @property
    def time_constant(self) -> float:
        """Return tau_mt = J / (f + F_t), s."""
        return self.inertia / self.loop_damping

    @property
    def velocity_gain(self) -> float:
        """Return k_vmt = k_t / (R_a (f + F_t)), rad/(V s)."""
        return self.torque_constant / (self.resistance * self.loop_damping)

    def drive(self) -> Drive:
        """
        Return the drive seen from the joint, (33).

        Without a tacho the motor is fed k_p times the command, and only its back-EMF and its
        friction brake it.
        """
        steady = self.velocity_gain * self.amplifier_gain / self.gear_ratio
        drive = Drive.velocity_loop(self.inertia * self.gear_ratio**2, self.time_constant, steady)
        return replace(drive, closed_loop=self.tacho_gain > 0.0)


@dataclass(frozen=True)
class Drive:
    """
    A joint's drive: theta'' = k_1 u + k_2 M_b + k_3 theta', (32).

    Attributes
    ----------
    inertia : float
        J_b = N^2 J, kg m^2, joint side.
    torque_gain : float
        J_b k_1: torque at the joint per unit of command, N m.
    damping : float
        -J_b k_3, N m s/rad.
    command_limit : float
        Largest magnitude of the command, in the drive's own unit.
    closed_loop : bool
        Whether a velocity loop ties the torque gain to the damping.
    friction : float
        What of the damping is friction that a velocity loop's error does not hold, N m s/rad.

    """

    inertia: float
    torque_gain: float
    damping: float
    command_limit: float = float('inf')
    closed_loop: bool = False
    friction: float = 0.0

    @classmethod
    def velocity_loop(cls, inertia: float, time_constant: float, steady_gain: float) -> Drive:
        """Return a closed tacho loop with time constant tau_mt, s, and steady gain u -> theta'."""
        damping = inertia / time_constant
        return cls(inertia, steady_gain * damping, damping, closed_loop=True)
