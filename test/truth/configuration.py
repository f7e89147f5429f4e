"""
The parts of the true arm, with every imperfection, which is null unless set.

The numbers repeat the project's data sheets on purpose: the truth reads no file of the package.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from truth.beam_elements import BeamMesh

GRAVITY = 9.81
# Travel over which dry friction builds up by default, rad: half the angle sensors' noise.
INVISIBLE_TRAVEL = 5e-5


@dataclass(frozen=True)
class Link:
    """One link: a rigid hub of radius m, then a uniform beam clamped to it (SI units)."""

    length: float
    thickness: float
    height: float
    youngs_modulus: float
    density: float
    damping_ratio: float
    gauges: tuple[float, ...]
    hub_radius: float = 0.0
    clamp_stiffness: float = float('inf')

    @property
    def mass_per_length(self) -> float:
        """Mass per length, kg/m."""
        return self.density * self.thickness * self.height

    @property
    def bending_stiffness(self) -> float:
        """Bending stiffness EI, N m^2."""
        return self.youngs_modulus * self.height * self.thickness**3 / 12.0

    @property
    def first_frequency(self) -> float:
        """First clamped-free frequency, rad/s: (gamma L)^2 sqrt(EI / (rho A L^4))."""
        scale = (self.bending_stiffness / (self.mass_per_length * self.length**4)) ** 0.5
        return 1.8751040687119611**2 * scale

    def mesh(self, elements: int = 20) -> BeamMesh:
        """Return the finite-element mesh of the beam."""
        return BeamMesh(self.length, self.mass_per_length, self.bending_stiffness, elements)


@dataclass(frozen=True)
class Joint:
    """
    One drive and gear: torque = torque_gain u - damping theta_dot, and its imperfections.

    Units: inertia kg m^2, torque_gain N m per command unit, damping and viscous N m s/rad,
    coulomb_forward, coulomb_backward, stribeck and ripple N m, stribeck_speed rad/s,
    ripple_order cycles per radian of the joint, lag s, backlash rad (whole gap), gear_stiffness
    and spring (about spring_rest rad) N m/rad; bias, dead_zone and saturation in the command's
    unit; integral_rate 1/s, at which the loop integrates torque_gain u - damping theta_dot.

    The form of the imperfections: `presliding` rad is the travel over which dry friction builds
    up, with `bristle` as LuGre's bristles do; the lag delays the command or, with
    `lag_inside`, the torque of the loop; `output_share` of the inertia sits behind the gear;
    `contact_stiffness` 1/s^2 is that of a gap's ends per inertia; the angle sensor sits behind
    the gear or, with `sensor_on_motor`, before it.
    """

    inertia: float
    torque_gain: float
    damping: float
    viscous: float = 0.0
    coulomb_forward: float = 0.0
    coulomb_backward: float = 0.0
    stribeck: float = 0.0
    stribeck_speed: float = 0.05
    ripple: float = 0.0
    ripple_order: float = 0.0
    ripple_phase: float = 0.0
    bias: float = 0.0
    dead_zone: float = 0.0
    saturation: float = float('inf')
    lag: float = 0.0
    backlash: float = 0.0
    gear_stiffness: float = float('inf')
    spring: float = 0.0
    spring_rest: float = 0.0
    integral_rate: float = 0.0
    presliding: float = INVISIBLE_TRAVEL
    bristle: bool = False
    lag_inside: bool = False
    output_share: float = 0.05
    contact_stiffness: float = 6e4
    sensor_on_motor: bool = False


@dataclass(frozen=True)
class Payload:
    """
    The payload: mass kg, rotary inertia kg m^2, an event, a loose mounting.

    Its centre is `beyond_tip` m farther out than the lower link ends, and `beside_tip` m beside it
    on the side of positive angles.

    From `event_time` s on (over `event_duration` s, 0 for a step) the mass becomes `event_mass`.
    With a `leak` s what is left to change falls by the factor e in that time instead.
    `loose_frequency` rad/s (0 for a rigid grip) is that of the held mass on its spring;
    `loose_share` of the mass hangs on it.
    """

    mass: float
    inertia: float = 0.0
    event_time: float = float('inf')
    event_mass: float = 0.0
    event_duration: float = 0.0
    loose_frequency: float = 0.0
    loose_damping_ratio: float = 0.0
    loose_share: float = 1.0
    leak: float = 0.0
    beyond_tip: float = 0.0
    beside_tip: float = 0.0

    def mass_at(self, time: float) -> float:
        """Return the mass at `time` s, kg."""
        if time < self.event_time:
            return self.mass
        share = 1.0
        if self.leak > 0.0:
            share = 1.0 - math.exp(-(time - self.event_time) / self.leak)
        elif self.event_duration > 0.0:
            share = min(1.0, (time - self.event_time) / self.event_duration)
        return self.mass + share * (self.event_mass - self.mass)


@dataclass(frozen=True)
class Structure:
    """
    Elbow, base and surroundings: masses kg, inertias kg m^2, stiffness N m/rad, tilt rad.

    A base that slides has `slide_stiffness` N/m both ways, `base_mass` kg and
    `slide_damping` N s/m.

    `air_drag` N s^2/m^3 is the force per length and squared transverse speed.

    A hose of `hose_stiffness` N/m leads from `hose_reach` m to the left of the elbow to as far
    along the forearm; it is neither stretched nor pressed at the elbow's angle `hose_rest` rad.
    """

    elbow_mass: float
    elbow_inertia: float
    tilt_x: float = 0.0
    tilt_y: float = 0.0
    base_stiffness: float = float('inf')
    base_inertia: float = 0.0
    base_damping: float = 0.0
    air_drag: float = 0.0
    slide_stiffness: float = float('inf')
    base_mass: float = 0.0
    slide_damping: float = 0.0
    hose_stiffness: float = 0.0
    hose_reach: float = 0.1
    hose_rest: float = 0.0


@dataclass(frozen=True)
class Sensors:
    """
    Angle sensors and strain gauges; one entry a joint or a gauge, noise in rad and m/m.

    Channel `crosstalk_to` also reads `crosstalk` of channel `crosstalk_from`. The amplifier has a
    low pass of `filter_cutoff` rad/s (0 for none) and `filter_damping`, or one of first order;
    filter and delay act on the gauges `late` (none named: on all).
    """

    angle_gain: tuple[float, ...]
    angle_offset: tuple[float, ...]
    strain_gain: tuple[float, ...]
    strain_bias: tuple[float, ...]
    strain_drift: tuple[float, ...]
    angle_step: tuple[float, ...]
    strain_step: float
    angle_noise: float
    strain_noise: float
    crosstalk: float = 0.0
    crosstalk_from: int = 0
    crosstalk_to: int = 1
    filter_cutoff: float = 0.0
    filter_damping: float = 0.8
    filter_first_order: bool = False
    strain_delay: float = 0.0
    angle_delay: tuple[float, float] = (0.0, 0.0)
    gain_warming: float = 0.0
    late: tuple[int, ...] = ()


@dataclass(frozen=True)
class Excitation:
    """
    Random set-points: a new one every `hold` s (low, high), reached in `rise` s (low, high).

    Each differs from the last by at most `stride` rad and stays within `reach` rad of zero, per
    joint; a joint with no reach stays at rest.
    """

    hold: tuple[float, float]
    rise: tuple[float, float]
    stride: tuple[float, float]
    reach: tuple[float, float]


@dataclass(frozen=True)
class Arm:
    """The whole true arm, with the sampling of its log and the position controller's gains."""

    links: tuple[Link, Link]
    joints: tuple[Joint, Joint]
    structure: Structure
    payload: Payload
    sensors: Sensors
    sample_time: float
    step: float
    shapes: tuple[int, int]
    position_gain: tuple[float, float]
    command_limit: tuple[float, float]
    excitation: Excitation
    input_delay: float = 0.0
    late_drives: tuple[int, ...] = (0, 1)


def clean_sensors(gauges: int, angle_step: tuple[float, ...], strain_step: float,
                  angle_noise: float, strain_noise: float) -> Sensors:
    """Return ideal sensors but for noise and quantisation."""
    zeros, ones = (0.0,) * gauges, (1.0,) * gauges
    return Sensors((1.0, 1.0), (0.0, 0.0), ones, zeros, zeros, angle_step, strain_step,
                   angle_noise, strain_noise)


def reference_arm(payload: float) -> Arm:
    """Return the reference robot: velocity loops, four gauges, 100 Hz."""
    links = (Link(0.6, 0.003, 0.05, 70e9, 2700.0, 0.01, (0.03, 0.30)),
             Link(0.5, 0.0018, 0.05473, 70e9, 2700.0, 0.01, (0.025, 0.25)))
    joints = (Joint(0.2, 0.2 / 0.01, 0.2 / 0.01), Joint(0.05, 0.05 / 0.01, 0.05 / 0.01))
    return Arm(links, joints, Structure(0.6, 6e-4), Payload(payload),
               clean_sensors(4, (5e-5, 5e-5), 1e-8, 1e-4, 5e-7), sample_time=0.01, step=0.001,
               shapes=(5, 5), position_gain=(4.0, 4.0), command_limit=(1.5, 1.5),
               excitation=Excitation((0.9, 1.8), (0.4, 0.8), (0.55, 0.55), (0.9, 0.9)))


def quanser_arm(payload: float) -> Arm:
    """Return the Quanser arm with the vendor's nominal values: current drives, two gauges."""
    links = (Link(0.202, 1.27e-3, 76.2e-3, 2.068e11, 7850.0, 0.01, (0.0,), 0.079),
             Link(0.20185, 0.889e-3, 38.1e-3, 2.068e11, 7850.0, 0.01, (0.0,), 0.079))
    joints = (Joint(0.0635, 8.925, 4.0), Joint(0.00302, 0.870, 1.5))
    # All of stage 2 weighs 1.578 kg; what is left of its 0.1704 kg m^2 about the shoulder.
    structure = Structure(elbow_mass=1.3673, elbow_inertia=1.4e-3)
    return Arm(links, joints, structure, Payload(payload),
               clean_sensors(2, (1.53e-5, 3.07e-5), 1e-10, 2e-6, 2e-9), sample_time=0.002,
               step=0.0005, shapes=(3, 3), position_gain=(3.0, 3.0),
               command_limit=(0.94, 1.2),
               excitation=Excitation((1.5, 3.0), (0.4, 1.0), (0.7, 0.35), (0.5, 0.3)))


ROBOTS = {'reference': reference_arm, 'quanser_2dsfl': quanser_arm}
