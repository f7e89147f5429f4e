"""DC motor, tacho loop and gear (Appendix A) against the motor's own differential equation."""

from __future__ import annotations

from dataclasses import replace

from flex_plant_sim.arm.drive import DCMotor, Drive
import numpy as np
from numpy.typing import NDArray
from paper_equations import constants_33
import pytest
from scipy.integrate import solve_ivp

MOTOR = DCMotor(torque_constant=0.046, resistance=2.1, friction=3e-5, inertia=2.4e-5,
                amplifier_gain=7.0, tacho_gain=0.052, gear_ratio=50.0)


def motor_acceleration(motor: DCMotor, rate: float, voltage: float, torque: float) -> float:
    """Return the shaft's acceleration by Newton and Ohm, Figures 10 and 11."""
    armature = motor.amplifier_gain * (voltage - motor.tacho_gain * rate)
    current = (armature - motor.torque_constant * rate) / motor.resistance
    return (torque - motor.friction * rate + motor.torque_constant * current) / motor.inertia


@pytest.mark.parametrize('voltage, torque', [(0.0, 0.0), (3.0, 0.0), (0.0, 1.7), (-2.0, 0.6)])
def test_constants_33_against_the_motor(voltage: float, torque: float) -> None:
    """Behind the gear, theta'' = k_1 V_r + k_2 M_b + k_3 theta', (32)."""
    drive, ratio = constants_33(MOTOR.drive()), MOTOR.gear_ratio
    for rate in (-1.3, 0.0, 0.8):
        joint = drive.k_1 * voltage + drive.k_2 * torque + drive.k_3 * rate
        motor = motor_acceleration(MOTOR, ratio * rate, voltage, torque / ratio) / ratio
        assert joint == pytest.approx(motor, rel=1e-12, abs=1e-12)


def test_time_response_against_the_motor() -> None:
    """A voltage and a load step, 0.2 s: joint angle by (32) and by the motor's equation."""
    drive, ratio = constants_33(MOTOR.drive()), MOTOR.gear_ratio
    voltage, load = 4.0, -3.0

    def motor(_: float, x: NDArray[np.float64]) -> list[float]:
        return [x[1], motor_acceleration(MOTOR, x[1], voltage, load / ratio)]

    end = solve_ivp(motor, (0.0, 0.2), [0.0, 0.0], rtol=1e-11, atol=1e-13).y[:, -1] / ratio
    steady = (drive.k_1 * voltage + drive.k_2 * load) / -drive.k_3
    tau = -1.0 / drive.k_3
    rate = steady * (1.0 - np.exp(-0.2 / tau))
    np.testing.assert_allclose(end, [steady * 0.2 - tau * rate, rate], rtol=1e-8)


def test_closed_forms_of_appendix_a() -> None:
    drive = constants_33(MOTOR.drive())
    k_vm = MOTOR.torque_constant / (MOTOR.torque_constant**2
                                    + MOTOR.friction * MOTOR.resistance)
    k_vmt = k_vm / (1.0 + MOTOR.amplifier_gain * MOTOR.tacho_gain * k_vm)
    assert MOTOR.velocity_gain == pytest.approx(k_vmt, rel=1e-13)
    tau, ratio = MOTOR.time_constant, MOTOR.gear_ratio
    assert drive.k_1 == pytest.approx(k_vmt * MOTOR.amplifier_gain / (ratio * tau), rel=1e-13)
    assert drive.k_2 == pytest.approx(
        k_vmt * MOTOR.resistance / (ratio**2 * MOTOR.torque_constant * tau), rel=1e-13)
    assert drive.k_2 == pytest.approx(1.0 / (MOTOR.inertia * ratio**2), rel=1e-13)
    assert drive.k_3 == pytest.approx(-1.0 / tau, rel=1e-13)


def test_induced_torque_35_is_the_joint_side_one() -> None:
    """
    Misprint 2: what the elbow feels is J_b (…) = J N^2 (…), not J N (…).

    The stator turns with the elbow: it feels minus what accelerates the rotor beyond the load.
    """
    drive, ratio = MOTOR.drive(), MOTOR.gear_ratio
    voltage, rate, load, k = 3.0, 0.7, 1.1, constants_33(drive)
    acceleration = k.k_1 * voltage + k.k_2 * load + k.k_3 * rate
    induced = drive.inertia * acceleration - load
    bracket = k.k_1 * voltage + k.k_3 * rate
    assert induced == pytest.approx(drive.inertia * bracket, rel=1e-12)
    assert induced == pytest.approx(MOTOR.inertia * ratio**2 * bracket, rel=1e-12)
    motor_side = MOTOR.inertia * motor_acceleration(MOTOR, ratio * rate, voltage, load / ratio) \
        - load / ratio
    assert motor_side == pytest.approx(MOTOR.inertia * ratio * bracket, rel=1e-12)
    assert induced == pytest.approx(ratio * motor_side, rel=1e-12)


def test_load_torque_of_the_tacho_loop_has_no_factor() -> None:
    """
    Misprint 12: J theta_m'' + (f + F_t) theta_m' = (k_t k_p / R_a) V_r + M_m.

    As printed M_m bears the factor 1 / (f + F_t), right only after division by f + F_t.
    """
    load, damping = 0.02, MOTOR.loop_damping
    direct = MOTOR.inertia * motor_acceleration(MOTOR, 0.0, 0.0, load)
    assert direct == pytest.approx(load, rel=1e-13)
    assert direct != pytest.approx(load / damping, rel=0.5)
    steady = load / damping
    assert motor_acceleration(MOTOR, steady, 0.0, load) == pytest.approx(0.0, abs=1e-9)
    factor = MOTOR.resistance / MOTOR.torque_constant * MOTOR.velocity_gain
    assert steady == pytest.approx(factor * load, rel=1e-13)


def test_fast_loop_reduces_to_equation_1() -> None:
    """As tau tends to 0, theta' obeys k_3 theta' + k_1 u + k_2 M_b = 0 with the same gain."""
    slow = constants_33(Drive.velocity_loop(0.2, 1e-2, 1.3))
    for tau in (1e-2, 1e-4):
        drive = constants_33(Drive.velocity_loop(0.2, tau, 1.3))
        assert -drive.k_1 / drive.k_3 == pytest.approx(1.3, rel=1e-13)
    fast = constants_33(Drive.velocity_loop(0.2, 1e-6, 1.3))
    # A load moves the fast loop less, in proportion: -k_2 / k_3 = tau / J_b.
    assert (fast.k_2 / fast.k_3) / (slow.k_2 / slow.k_3) == pytest.approx(1e-4, rel=1e-12)


def test_current_drive_of_the_vendor_table() -> None:
    drive = Drive(inertia=0.0635, torque_gain=8.925, damping=4.0)
    assert constants_33(drive) == pytest.approx(
        (8.925 / 0.0635, 1.0 / 0.0635, -4.0 / 0.0635), rel=1e-14)


def test_gear_ratio_scales_as_it_should() -> None:
    """Twice the gear: half the speed per volt, a quarter of the load's effect."""
    once, twice = (constants_33(replace(MOTOR, gear_ratio=factor * MOTOR.gear_ratio).drive())
                   for factor in (1.0, 2.0))
    assert twice.k_1 / twice.k_3 == pytest.approx(0.5 * once.k_1 / once.k_3, rel=1e-13)
    assert twice.k_2 == pytest.approx(0.25 * once.k_2, rel=1e-13)
