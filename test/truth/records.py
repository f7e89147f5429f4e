"""
Logs of the true arm, from a seed: a TruthCase says what is hidden, a Record is its log.

Two simulators make them. MuJoCo is a development extra; without it its cases cannot be run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import numpy as np

from truth.beam_elements import Array
from truth.configuration import Arm, ROBOTS
from truth.effects import CATALOGUE
from truth.effects.hidden_effect import Parameters
from truth.effects.payload import with_change_as_told
from truth.excitation import set_points
from truth.forms import FORMS
from truth.sensors import amplifier_output, logged_angles, quantise, sensor_noise
from truth.simulation import Motion, simulate
from truth.tolerances import AS_TOLD, GOOD, Spread, with_tolerances

try:
    from truth.mujoco.simulation import simulate as simulate_chain
    HAVE_MUJOCO = True
except ImportError:
    HAVE_MUJOCO = False

FINITE_ELEMENTS, MUJOCO = 'finite_elements', 'mujoco'
NO_MUJOCO = 'MuJoCo is not installed (extra "bench"): no second truth'
# Columns of a log by robot.
COLUMNS = {
    'reference': ('time', 'command_1', 'command_2', 'joint_1', 'joint_2', 'strain_1a',
                  'strain_1b', 'strain_2a', 'strain_2b'),
    'quanser_2dsfl': ('time', 'command_1', 'command_2', 'joint_1', 'joint_2', 'strain_1',
                      'strain_2')}
# Payloads that cases are drawn from, kg; the second robot's nominal is 0.157.
PAYLOAD_RANGE = {'reference': (0.05, 0.2), 'quanser_2dsfl': (0.12, 0.2)}
# Effects that finite elements do not have.
OF_MUJOCO_ALONE = ('base_sliding', 'payload_beside')
# Severity of a distractor; 1 is clear.
DISTRACTOR_SEVERITY = 0.2


@dataclass(frozen=True)
class TruthCase:
    """
    All that a record is made from.

    `effects` are (identifier, parameters) in the truth's terms; payload_true and payload_told are
    in kg; excitation is rich, gentle, rest or one_joint; spread says how far parts are off, good
    or told (`truth.tolerances`); noise scales the sensors' noise (0: neither noise nor
    quantisation); distractors are further effects, too small to be named; simulator makes the
    record, and forms are those of the hidden effects (see `truth.forms`).
    """

    seed: int
    effects: tuple[tuple[str, Parameters], ...] = ()
    robot: str = 'reference'
    duration_s: float = 40.0
    payload_true: float = 0.1
    payload_told: float = 0.1
    excitation: str = 'rich'
    tolerances: bool = True
    noise: float = 1.0
    distractors: tuple[tuple[str, Parameters], ...] = ()
    simulator: str = FINITE_ELEMENTS
    forms: tuple[str, ...] = ()
    spread: str = GOOD

    @property
    def names(self) -> tuple[str, ...]:
        """Identifiers of the hidden effects."""
        return tuple(name for name, _ in self.effects)


@dataclass(frozen=True)
class Record:
    """A log of N samples: time (N,) s, command and joint (N, 2), strain (N, gauges) m/m."""

    time: Array
    command: Array
    joint: Array
    strain: Array
    columns: tuple[str, ...]

    @property
    def table(self) -> Array:
        """All columns side by side, (N, len(columns))."""
        return np.column_stack([self.time, self.command, self.joint, self.strain])

    def write_csv(self, path: str | Path) -> None:
        """Write the log as CSV with its header row."""
        np.savetxt(path, self.table, fmt='%.9g', delimiter=',', header=','.join(self.columns),
                   comments='')


def build_arm(case: TruthCase) -> Arm:
    """Return the arm of `case`: nominal parts, their tolerances, then the hidden effects."""
    arm = ROBOTS[case.robot](case.payload_true)
    if case.tolerances:
        spread = Spread() if case.spread == GOOD else AS_TOLD[case.robot]
        arm = with_tolerances(arm, random_stream(case, 'tolerances'), spread)
    arm = limit_excitation(arm, case)
    for name, parameters in (*case.effects, *case.distractors):
        arm = CATALOGUE[name].apply(arm, parameters)
    arm = replace(arm, payload=with_change_as_told(arm.payload, case.payload_true))
    for form in case.forms:
        arm = FORMS[form](arm)
    if case.noise == 0.0:
        arm = replace(arm, sensors=replace(arm.sensors, angle_step=(0.0, 0.0), strain_step=0.0))
    return arm


def limit_excitation(arm: Arm, case: TruthCase) -> Arm:
    """Return `arm` with set-points that rest, move one joint (drawn by the seed), or gently."""
    if case.excitation == 'rich':
        return arm
    if case.excitation == 'gentle':
        stride, rise = arm.excitation.stride, arm.excitation.rise
        return replace(arm, excitation=replace(
            arm.excitation, stride=(0.25 * stride[0], 0.25 * stride[1]),
            rise=(2.0 * rise[0], 2.0 * rise[1])))
    moving = {'rest': -1, 'one_joint': case.seed % 2}[case.excitation]
    reach = arm.excitation.reach
    kept = (reach[0] * (moving == 0), reach[1] * (moving == 1))
    return replace(arm, excitation=replace(arm.excitation, reach=kept))


def sample_times(arm: Arm, samples: int) -> Array:
    """Return the times of `samples` rows, s."""
    return np.arange(samples, dtype=float) * arm.sample_time


def random_stream(case: TruthCase, purpose: str) -> np.random.Generator:
    """Return the generator for one purpose, so that a change of effect leaves all others alone."""
    return np.random.default_rng([case.seed, crc32(purpose.encode())])


def angle_noise(case: TruthCase, arm: Arm, samples: int) -> Array:
    """Return the noise of the joint readings, rad, (N, 2)."""
    return sensor_noise(random_stream(case, 'angle noise'), (samples, 2),
                        case.noise * arm.sensors.angle_noise, arm.sample_time)


def move(case: TruthCase, command: Array | None = None) -> tuple[Arm, Motion]:
    """Return the arm and its motion, under its controller or under a given `command` (N, 2)."""
    arm = build_arm(case)
    samples = round(case.duration_s / arm.sample_time)
    time = sample_times(arm, samples)
    noise = angle_noise(case, arm, samples)
    reference = set_points(random_stream(case, 'set-points'), time, arm.excitation)
    if case.simulator == FINITE_ELEMENTS:
        return arm, simulate(arm, reference, command, noise)
    if not HAVE_MUJOCO:
        raise RuntimeError(NO_MUJOCO)
    return arm, simulate_chain(arm, reference, command, noise)


def make_record(case: TruthCase, command: Array | None = None) -> Record:
    """Return the log of `case`, under its controller or under a given `command` (N, 2)."""
    arm, motion = move(case, command)
    strain = amplifier_output(motion, arm.sensors, arm.sample_time)
    strain += sensor_noise(random_stream(case, 'strain noise'), strain.shape,
                           case.noise * arm.sensors.strain_noise, arm.sample_time)
    time = sample_times(arm, motion.joint.shape[0])
    joint = logged_angles(motion.joint, angle_noise(case, arm, len(time)), arm.sensors,
                          arm.sample_time)
    return Record(time, motion.command, joint,
                  quantise(strain, arm.sensors.strain_step), COLUMNS[case.robot])


def draw_case(identifier: str | tuple[str, ...] | None, seed: int, robot: str = 'reference',
              severity: float = 1.0, distractors: int = 0, duration_s: float = 40.0,
              excitation: str = 'rich') -> TruthCase:
    """
    Draw a case: the effect or effects named (None for a clean arm), and distractors.

    `severity` 1 is clear, 0 the null; each distractor is another effect at a fifth of that.
    """
    names = () if identifier is None else (
        (identifier,) if isinstance(identifier, str) else tuple(identifier))
    rng = np.random.default_rng([seed, crc32(' '.join(names).encode())])
    told = float(rng.uniform(*PAYLOAD_RANGE[robot]))
    case = TruthCase(seed, (), robot, duration_s, told, told, excitation)
    for name in names:
        case = add_effect(case, name, rng, severity)
    named = case.effects
    others = [name for name in CATALOGUE if name not in (*names, *OF_MUJOCO_ALONE)]
    for name in rng.choice(others, distractors, replace=False):
        case = add_effect(case, str(name), rng, DISTRACTOR_SEVERITY)
    return replace(case, effects=named, distractors=case.effects[len(named):])


def add_effect(case: TruthCase, name: str, rng: np.random.Generator,
               severity: float) -> TruthCase:
    """Return `case` with an effect of drawn size; a wrong payload shows in `payload_true`."""
    nominal = ROBOTS[case.robot](case.payload_true)
    parameters = CATALOGUE[name].draw(rng, nominal, severity)
    if name == 'payload_mass':
        case = replace(case, payload_true=case.payload_told * parameters['factor'])
    return replace(case, effects=(*case.effects, (name, parameters)))
