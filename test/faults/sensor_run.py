"""
Sensors that go wrong for good in the running loop: what the controller says, and where it stops.

`python test/faults/sensor_run.py [FAULT ...] [--page]`. The simulated arm is not the controller's
model: more modes, dry friction and a spring in the joints, other links, noise. The first rows are
arms whose sensors are right; none of them may be stopped.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from faults.local_context import local_context
from faults.page import record
from faults.relay import Alter, Relay, remapped
from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode
from flex_plant_sim.nodes.plant_sim_node import PlantSim
from msg_config.messages import stamp_of
import numpy as np
from rclpy.context import Context
from ros_loop import overrides, RosLoop

STEP, START, END = 10_000_000, 330, 1100
EFFECTS = ['coulomb_friction:joint_2:level_n_m=0.4',
           'joint_spring:joint_1:stiffness_n_m_per_rad=1.0,rest_rad=0.1',
           'link_stiffness:link_2:factor=0.96', 'actuator_gain:joint_1:factor=1.04']
PLANT: dict[str, Any] = {'modes': 4, 'payload': 0.22, 'effects': EFFECTS, 'seed': 23}
COMMANDS = 'lqg_controller: command'
SET_POINTS = {'reference_amplitude': 0.4, 'reference_period': 3.6}
# Changes a message; the second number is the time since the fault began, s.
Spoil = Callable[[Any, float], None]


def add(index: int, size: float = 0.0, rate: float = 0.0) -> Spoil:
    """Return an offset that may grow, of a position."""
    def spoil(message: Any, time: float) -> None:
        message.position[index] += size + rate * time
    return spoil


def scaled(index: int, factor: float) -> Spoil:
    """Return a factor of a position."""
    def spoil(message: Any, _: float) -> None:
        message.position[index] *= factor
    return spoil


def held(index: int) -> Spoil:
    """Return a position that stays as it was."""
    kept: list[float] = []

    def spoil(message: Any, _: float) -> None:
        kept.append(message.position[index])
        message.position[index] = kept[0]
    return spoil


def exchanged(one: int, other: int) -> Spoil:
    """Return two positions that change places."""
    def spoil(message: Any, _: float) -> None:
        own = message.position
        own[one], own[other] = own[other], own[one]
    return spoil


def loose(index: int) -> Spoil:
    """Return a position that is there a third of the time, at random, and otherwise zero."""
    random = np.random.default_rng(index)

    def spoil(message: Any, _: float) -> None:
        if random.random() > 1.0 / 3.0:
            message.position[index] = 0.0
    return spoil


def no_velocity(message: Any, _: float) -> None:
    """Take the velocity out."""
    message.velocity = []


@dataclass(frozen=True)
class Case:
    """A topic, what is done to it, whether velocities are taken out, and the nodes' parameters."""

    topic: str = ''
    spoil: Spoil | None = None
    velocity: bool = True
    plant: dict[str, Any] = field(default_factory=dict)
    controller: dict[str, Any] = field(default_factory=dict)


def joint(spoil: Spoil, velocity: bool = True) -> Case:
    """Return a fault of an encoder."""
    return Case('joint_states', spoil, velocity)


def gauge(spoil: Spoil) -> Case:
    """Return a fault of a gauge."""
    return Case('strain', spoil)


HEALTHY: dict[str, Case] = {
    'no payload': Case(plant={'payload': 0.0}),
    '0.3 kg dropped': Case(plant={'payload': 0.3, 'payload_schedule': [4.2, 0.3, 4.2, 0.0]}),
    '0.25 kg picked': Case(plant={'payload': 0.0, 'payload_schedule': [5.3, 0.0, 5.3, 0.25]}),
    'design for 0.3 kg, none there': Case(
        plant={'payload': 0.0}, controller={'adapt': False, 'payload_initial': 0.3}),
    'dry friction of 2 and 6 N m': Case(plant={'effects': [
        'coulomb_friction:joint_2:level_n_m=2.0', 'coulomb_friction:joint_1:level_n_m=6.0']}),
    'drive off by 0.2': Case(plant={'effects': ['actuator_bias:joint_1:bias=0.2']}),
    'air drag, base on springs': Case(plant={'effects': [
        'air_drag:arm:density_times_drag_kg_per_m3=20',
        'base_compliance:arm:compliance_rad_per_n_m=0.003,inertia_kg_m2=0.2']}),
    'steps of 1 rad': Case(controller={'reference_amplitude': 1.0}),
    'torque noise of 2 N m': Case(plant={'process_noise': 2.0})}
FAULTS: dict[str, Case] = {
    'encoder 2 drifts by 0.15 rad/s': joint(add(1, rate=0.15)),
    'encoder 1 drifts by -0.3 rad/s': joint(add(0, rate=-0.3)),
    'the same without velocity': joint(add(0, rate=-0.3), velocity=False),
    'encoder 2 slips by -0.4 rad': joint(add(1, -0.4)),
    'the same without velocity ': joint(add(1, -0.4), velocity=False),
    'encoder 2 slips by 0.12 rad': joint(add(1, 0.12)),
    'encoder 2 stuck': joint(held(1)), 'encoder 2 stuck, no velocity': joint(held(1), False),
    'encoder 1 inverted': joint(scaled(0, -1.0)),
    'encoder 1 inverted, no velocity': joint(scaled(0, -1.0), False),
    'encoders exchanged': joint(exchanged(0, 1)),
    'encoders exchanged, no velocity': joint(exchanged(0, 1), False),
    **{f'gauge {name} dead': gauge(scaled(k, 0.0)) for k, name in enumerate(
        ('1a', '1b', '2a', '2b'))},
    'gauge 1a inverted': gauge(scaled(0, -1.0)), 'gauge 2a inverted': gauge(scaled(2, -1.0)),
    'gauges 1a, 1b exchanged': gauge(exchanged(0, 1)),
    'gauges 1b, 2a exchanged': gauge(exchanged(1, 2)),
    'gauge 1a, cable loose': gauge(loose(0)), 'gauge 2b, cable loose': gauge(loose(3)),
    'gauge 1a stuck': gauge(held(0)), 'gauge 1a off by 2e-5': gauge(add(0, 2e-5))}


def altered(case: Case, topic: str) -> Alter:
    """Return what the relay does with a topic."""
    def alter(message: Any, send: Callable[[Any], None]) -> None:
        late = stamp_of(message) - START * STEP
        if topic == 'joint_states' and not case.velocity:
            no_velocity(message, 0.0)
        if case.spoil is not None and topic == case.topic and late >= 0:
            case.spoil(message, 1e-9 * late)
        send(message)
    return alter


def outcome(case: Case, context: Context) -> tuple[float, float, float, str]:
    """Return the largest angle before and after, the time until the stop, s, and what was said."""
    loop = RosLoop(context)
    topics = ('joint_states', 'strain')
    loop.add(Relay, {topic: altered(case, topic) for topic in topics})
    joints, diagnostics = loop.record('joint_states', 'raw/joint_states'), loop.record(
        '/diagnostics')
    commands = loop.record('command')
    loop.start(LQGControllerNode, **{**SET_POINTS, **case.controller})
    loop.start(PayloadEstimatorNode)
    loop.add(PlantSim, cli_args=remapped(*topics),
             parameter_overrides=overrides({**PLANT, **case.plant}))
    loop.until(lambda: END * STEP in joints.stamps, timeout=600.0)
    heard = len(diagnostics)
    loop.until(lambda: any(status.name.startswith(COMMANDS) for message in diagnostics[heard:]
                           for status in message.status))
    angle = {stamp: float(np.abs(message.position).max())
             for stamp, message in joints.by_stamp().items()}
    moving = [stamp_of(message) for message in commands if any(message.effort)]
    said = [(status.level, status.message) for message in diagnostics for status in message.status
            if status.name.startswith(COMMANDS) and status.level != DiagnosticStatus.STALE]
    loop.close()
    stop = max(moving, default=0)
    text = max(said, key=lambda each: each[0])[1] if said else ''
    return (max(angle[k] for k in angle if k < START * STEP),
            max(angle[k] for k in angle if k >= START * STEP),
            1e-9 * (stop - START * STEP) if stop < (END - 20) * STEP else np.inf, text)


def run(names: list[str], context: Context) -> tuple[list[str], int]:
    """Return the table, and how many were stopped in error or not stopped."""
    lines = ['| what | largest angle before, after, rad | stopped after, s | diagnostics of the '
             'controller |', '|---|---|---|---|']
    wrong = 0
    for name in names:
        case = {**HEALTHY, **FAULTS}[name]
        before, after, stop, text = outcome(case, context)
        wrong += name in HEALTHY and np.isfinite(stop)
        lines.append(f'| {name.strip()} | {before:.2f}, {after:.2f} | '
                     f'{format(stop, ".2f") if np.isfinite(stop) else "–"} | '
                     f'{text.partition(": check")[0]} |')
        print(lines[-1], flush=True)
    return lines, wrong


def main() -> int:
    """Print a table; return 1 where an arm whose sensors are right was stopped."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    options.add_argument('faults', nargs='*', metavar='FAULT')
    options.add_argument('--domain', type=int, default=94)
    options.add_argument('--page', action='store_true', help='write it into docs/faults.md')
    chosen = options.parse_args()
    unknown = [name for name in chosen.faults if name not in (*HEALTHY, *FAULTS)]
    if unknown:
        options.error(f'{unknown[0]}: expected one of {", ".join([*HEALTHY, *FAULTS])}')
    context = local_context(chosen.domain)
    names = chosen.faults or [*HEALTHY, *FAULTS]
    lines, wrong = run(names, context)
    record('sensors', [*lines, '', f'{wrong} of {sum(name in HEALTHY for name in names)} arms '
                                   'whose sensors are right were stopped.'], chosen.page)
    return int(wrong > 0)


if __name__ == '__main__':
    sys.exit(main())
