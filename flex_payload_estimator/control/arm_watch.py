"""Tells sensors that would drive the arm the wrong way: the watches of joints and gauges."""

from __future__ import annotations

from collections.abc import Sequence
import math

from flex_payload_estimator.control.gauge_watch import DEAD, GaugeWatch
from flex_payload_estimator.control.joint_watch import ObedienceWatch, SpeedWatch
from flex_payload_estimator.control.lqg import GATE, LQGController, MOST_DOUBTED, SMALLEST_VARIANCE
from flex_payload_estimator.model.payload_model import SecondOrderModel
from flex_plant_sim.arm.drive import Drive
from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.gate import MAX_SPEED, NOISE_MARGIN
from msg_config.input_mapping import JOINTS
import numpy as np

# Share of the largest command from which a joint must move: friction that holds a joint takes a
# fifth of it on a measured arm.
LARGE = 0.5
# An angle within so much of its prediction is not too far from it, rad.
ANGLE_GATE = GATE * math.sqrt(SMALLEST_VARIANCE)
# Samples after a gap in which the arm may be elsewhere: more than gate and predictor doubt.
RECENT = 3 * MOST_DOUBTED
# Interval between two samples, over the sampling time, from which one is missing.
MISSING = 1.5


class ArmWatch:
    """
    Watches one arm until a fault is found.

    Parameters
    ----------
    robot : Robot
    controller : LQGController
        Whose model and limits hold.
    limit : float
        Largest command of either joint that is sent.

    Attributes
    ----------
    fault : str
        Which sensor is wrong and what to check, in one line; empty while none is.
    gauges : GaugeWatch or None
    unwatched : str
        Why gauges are not watched, in one line; empty where they are.

    """

    def __init__(self, robot: Robot, controller: LQGController, limit: float):
        self._robot, self._controller, self.limit = robot, controller, limit
        self._noise = NOISE_MARGIN * math.sqrt(2.0) * robot.angle_noise
        largest = self._largest()
        link = np.repeat([0, 1], [len(link.gauge_positions) for link in robot.links])
        noise = np.repeat([robot.angle_noise, robot.strain_noise], [2, link.size])
        a_bar, b_bar, _ = controller.transition
        self.gauges: GaugeWatch | None = None
        self.unwatched = 'the gauges are not watched: the reduced model bends unlike an arm'
        if isinstance(controller.model, SecondOrderModel):
            self._watch_gauges(GaugeWatch(
                controller.model, a_bar, b_bar, np.array(largest), controller.payload_max,
                link, noise, robot.sample_time))
        self._speeds = SpeedWatch(
            [_steady_speed(drive, most) for drive, most in zip(robot.drives, largest)],
            robot.sample_time)
        self._obedience = ObedienceWatch()
        self.reset()

    def with_limit(self, limit: float) -> ArmWatch:
        """Return a watch of the same arm for another largest command; a fault stays."""
        other = ArmWatch(self._robot, self._controller, limit)
        other.fault = self.fault
        return other

    def _largest(self) -> list[float]:
        return [min(self.limit, drive.command_limit) for drive in self._robot.drives]

    def _watch_gauges(self, watch: GaugeWatch) -> None:
        """Watch the gauges, unless a payload that is not known does what a dead one does."""
        self.gauges, self.unwatched = (watch, '') if watch.bound < DEAD else (None, (
            'the gauges are not watched: within a sample a payload that is not known changes the '
            f'bending by up to {watch.payload_error:.2g} of it; fewer modes, a smaller '
            'payload_max or a shorter sample_time help'))

    def reset(self) -> None:
        """Forget everything, a fault included."""
        self.fault = ''
        self.restart()

    def restart(self) -> None:
        """Forget what was followed, as after a leap in time; a fault stays."""
        self._time, self._gap_at = -math.inf, -math.inf
        if self.gauges is not None:
            self.gauges.reset()
        self._speeds.reset()
        self._obedience.reset()

    @property
    def gauge_errors(self) -> dict[str, float]:
        """Return the error of each gauge by name, see GaugeWatch."""
        found = [] if self.gauges is None else self.gauges.error.tolist()
        return dict(zip(self._robot.gauge_names, found))

    @property
    def proved(self) -> list[bool]:
        """Return whether the velocity of each joint is used, 2."""
        return self._speeds.proved

    def __call__(self, time: float, output: Array, velocity: Sequence[float], applied: Array,
                 sent: Array, span: float) -> None:
        """
        Look for a fault after the controller has taken the sample.

        Parameters
        ----------
        time : float
            Of the sample, s.
        output : Array
            (theta_1, theta_2, strain…), rad and m/m, (m,); not finite where it says nothing.
        velocity : sequence of float
            rad/s, 2; NaN where it is not measured.
        applied, sent : Array
            The command applied up to this sample, and the one sent last, (2,).
        span : float
            Time that a large command is given to move a joint, s.

        """
        finite = all(map(math.isfinite, output.tolist()))
        gap = time - self._time > MISSING * self._robot.sample_time
        self._time, self._gap_at = time, time if gap else self._gap_at
        if gap and self.gauges is not None:
            self.gauges.reset()
        unbent = self._unbent(output if finite else None, applied)
        if self.fault or not finite:
            return
        angle = output[:2].tolist()
        self.fault = (self._leap(time) or self._disagreement(time, angle, velocity)
                      or self._disobedience(time, angle, sent.tolist(), span)
                      or unbent)

    def _leap(self, time: float) -> str:
        """Say that an angle is elsewhere for good than where samples without a gap had it."""
        leap = self._controller.leap
        joint = int(np.argmax(np.abs(leap)))
        if abs(leap[joint]) < ANGLE_GATE or time - self._gap_at < RECENT * self._robot.sample_time:
            return ''
        return (f'{JOINTS[joint]} is {leap[joint]:+.3g} rad from where its command took it: check '
                'its encoder (slipped, counts lost, zeroed again), and that commands reach the '
                'drive')

    def _disagreement(self, time: float, angle: list[float], velocity: Sequence[float]) -> str:
        found = self._speeds(time, angle, velocity)
        if found is None:
            return ''
        joint, moved, gone = found
        return (f'{JOINTS[joint]}: its angle went {moved:+.3g} rad, its velocity says '
                f'{gone:+.3g} rad: check encoder and tachometer')

    def _disobedience(self, time: float, angle: list[float], sent: list[float], span: float,
                      ) -> str:
        large = [LARGE * most for most in self._largest()]
        way = [int(math.copysign(1.0, own)) if abs(own) >= least else 0
               for own, least in zip(sent, large)]
        joint = self._obedience(time, angle, way, span, self._noise)
        if joint is None:
            return ''
        return (f'{JOINTS[joint]} does not move as its command asks, at least {large[joint]:g} '
                f'for {span:g} s: check its encoder (stuck, inverted, exchanged), its drive, and '
                'what may hold it (a stop, a heavy load, then command_limit)')

    def _unbent(self, output: Array | None, applied: Array) -> str:
        watch, controller = self.gauges, self._controller
        if watch is None:
            return ''
        believed = None if output is None or controller.doubted else (
            controller.model.scale * output)
        gauge = watch(believed, applied, *controller.transition)
        if gauge is None:
            return ''
        link = 1 if gauge < len(self._robot.links[0].gauge_positions) else 2
        return (f'the gauges do not move as the arm bends, {self._robot.gauge_names[gauge]} most, '
                f"by {watch.error[gauge]:.2g} of link {link}'s bending: check the gauges (loose, "
                'inverted, exchanged, unit) and the encoders')


def _steady_speed(drive: Drive, command: float) -> float:
    """Return a joint's speed under its largest command, rad/s."""
    if not drive.damping > 0.0:
        return MAX_SPEED
    return min(MAX_SPEED, drive.torque_gain * command / drive.damping)
