"""
Make a measured-looking record of the arm with MuJoCo, hiding one effect; the truth beside it.

`python benchmarks/mujoco_records.py --effect coulomb_friction --seed 3 --out record.csv`
writes `record.csv` (columns of the bench records) and `record.truth.json`. The arm follows random
set-points under P control of the measured angles; parts are within tolerances; sensors are noisy.
Nothing here uses `flex_plant_sim`, so that a diagnosis is tested on dynamics it does not share.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
import json
from pathlib import Path

import mujoco
from mujoco_chain import Arm, build, Chain, run
from mujoco_effects import EFFECTS, GAUGES
from mujoco_scenario import logged_strain, Scenario
import numpy as np
from scipy.signal import lfilter

PERIOD_S = 0.01
COLUMNS = ('time', 'command_1', 'command_2', 'joint_1', 'joint_2', *GAUGES)
# Set-points, gains and noise as seen in the bench records.
POSITION_GAIN = np.array([4.0, 5.0])
SET_POINT_HOLD_S, SET_POINT_LAG_S, SET_POINT_STEP, SET_POINT_LIMIT = 1.3, 0.15, 0.45, 0.9
ANGLE_NOISE, STRAIN_NOISE = 1e-4, 5e-7


def set_points(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return (count, 2) rad: a bounded random walk of steps through a first-order lag."""
    hold = round(SET_POINT_HOLD_S / PERIOD_S)
    target, steps = np.zeros(2), []
    for _ in range(-(-count // hold)):
        target = np.clip(target + rng.uniform(-SET_POINT_STEP, SET_POINT_STEP, 2),
                         -SET_POINT_LIMIT, SET_POINT_LIMIT)
        steps.append(target)
    held = np.repeat(steps, hold, axis=0)[:count]
    keep = np.exp(-PERIOD_S / SET_POINT_LAG_S)
    return lfilter([1 - keep], [1, -keep], held, axis=0)


def draw_arm(rng: np.random.Generator) -> Arm:
    """Return the reference robot with part tolerances and a random payload."""
    nominal = Arm(payload_mass=rng.uniform(0.05, 0.2))
    upper, lower = (replace(link, youngs_modulus=link.youngs_modulus * rng.normal(1, 0.007),
                            damping_ratio=link.damping_ratio * rng.normal(1, 0.08))
                    for link in nominal.links)
    shoulder, elbow = np.asarray(nominal.rotor_inertia) * rng.normal(1, 0.007, 2)
    return replace(nominal, links=(upper, lower), rotor_inertia=(shoulder, elbow))


class Loop:
    """
    The closed loop around the chain: set-points, noisy angles, the drive's imperfections.

    Keeps what the log shows (`commands`, `angles`) and the strains at every sub-step.
    """

    def __init__(self, chain: Chain, scenario: Scenario, reference: np.ndarray,
                 noise: np.ndarray) -> None:
        self.chain, self.reference, self.noise = chain, reference, noise
        self.drive, self.sensors = scenario.drive, scenario.sensors
        self.event = scenario.event(chain.model) if scenario.event else None
        self.commands: list[np.ndarray] = []
        self.angles: list[np.ndarray] = []
        self.fine_strain: list[np.ndarray] = []
        self.lagged = np.zeros(2)

    def command(self, k: int, joint: np.ndarray, _: np.ndarray) -> np.ndarray:
        """Log the P controller's command at sample `k`; return what the drive makes of it."""
        measured = (np.asarray(self.sensors.angle_gain) * joint
                    + np.asarray(self.sensors.angle_offset) + self.noise[k])
        self.angles.append(measured)
        self.commands.append(POSITION_GAIN * (self.reference[k] - measured))
        return self.drive.shape(self.commands[-1])

    def before_step(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Apply the drive and the event, and record the strains, before one sub-step."""
        self.fine_strain.append(self.chain.strain(data.qpos))
        data.ctrl[:] = self._driven(data.time, model.opt.timestep)
        if self.event:
            self.event(model, data)

    def _driven(self, time: float, timestep: float) -> np.ndarray:
        """Return what reaches the velocity loops at `time` s."""
        k = int(np.floor((time - self.drive.delay) / PERIOD_S + 1e-6))
        sent = self.commands[k] if k >= 0 else np.zeros(2)
        shaped, lag = self.drive.shape(sent), np.asarray(self.drive.lag)
        keep = np.where(lag > 0, np.exp(-timestep / np.maximum(lag, 1e-12)), 0.0)
        self.lagged = keep * self.lagged + (1 - keep) * shaped
        return self.lagged


def _needs_every_step(scenario: Scenario) -> bool:
    """Return whether anything changes, or is looked at, within a sample."""
    drive, sensors = scenario.drive, scenario.sensors
    return bool(scenario.event or drive.delay or any(drive.lag)
                or sensors.strain_delay or sensors.filter_frequency)


def make_record(effect: str, seed: int, duration: float = 40.0, n_segments: int = 20,
                substeps: int = 20) -> tuple[np.ndarray, dict]:
    """
    Return the record (N, 9) in the order of `COLUMNS`, and its truth.

    Raises KeyError for an unknown effect.
    """
    draw = EFFECTS[effect]
    rng, noise_rng = (np.random.default_rng([seed, stream]) for stream in (1, 2))
    effect_rng = np.random.default_rng([seed, 3, sorted(EFFECTS).index(effect)])
    count = round(duration / PERIOD_S)
    arm = draw_arm(rng)
    scenario = draw(effect_rng, Scenario(arm, told=arm.payload_mass))
    chain = build(scenario.arm, n_segments, PERIOD_S / substeps)
    loop = Loop(chain, scenario, set_points(rng, count),
                ANGLE_NOISE * noise_rng.standard_normal((count, 2)))
    _, strain = run(chain, loop.command, count, PERIOD_S,
                    loop.before_step if _needs_every_step(scenario) else None)
    fine, stride = (loop.fine_strain, substeps) if loop.fine_strain else (strain, 1)
    strain = logged_strain(np.asarray(fine), scenario.sensors, PERIOD_S / stride, PERIOD_S)
    strain += STRAIN_NOISE * noise_rng.standard_normal((count, 4))
    time = np.arange(count) * PERIOD_S
    numbers = {key: value if isinstance(value, str) else float(value)
               for key, value in scenario.truth.items()}
    truth = {'name': effect, 'effect': numbers, 'payload_told': scenario.told,
             'payload_true': arm.payload_mass, 'site': scenario.site}
    return np.column_stack([time, loop.commands, loop.angles, strain]), truth


def main() -> None:
    """Write one record and its truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--effect', choices=sorted(EFFECTS), default='nothing')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--out', type=Path, required=True)
    parser.add_argument('--duration', type=float, default=40.0, help='s')
    options = parser.parse_args()
    record, truth = make_record(options.effect, options.seed, options.duration)
    np.savetxt(options.out, record, delimiter=',', fmt='%.9g', header=','.join(COLUMNS),
               comments='')
    options.out.with_suffix('.truth.json').write_text(json.dumps(truth, indent=1) + '\n')


if __name__ == '__main__':
    main()
