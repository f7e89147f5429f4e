"""Records made by the package's own simulator, for tests of what is done with a record."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flex_plant_sim.arm.robot import Robot
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.diagnosis.prediction.base_model import BaseModel
from flex_plant_sim.diagnosis.prediction.free_run import free_run
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.sensor_noise import measurement_noise
from flex_plant_sim.diagnosis.record.windows import Indices, Record, Windows
from flex_plant_sim.effects import build, parse
from flex_plant_sim.effects.base import Effect
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.simulation.simulator import Noise, simulate, Simulator
import numpy as np

REFERENCE = load_robot('reference')
SLOWEST = 10.0


def effects(*texts: str, robot: Robot = REFERENCE) -> tuple[Effect, ...]:
    """Return effects named as identifier:site:parameter=number."""
    return tuple(build(parse(text), robot) for text in texts)


def commands(robot: Robot, duration: float, seed: int = 0) -> Array:
    """Return random steps of both commands, held for about a second, (N, 2)."""
    rng = np.random.default_rng(seed)
    count = round(duration / robot.sample_time)
    hold = round(0.9 / robot.sample_time)
    levels = rng.uniform(-0.6, 0.6, (count // hold + 1, 2))
    levels[1::2] = -levels[::2][:len(levels[1::2])]
    return np.repeat(levels, hold, axis=0)[:count]


def simulated(hidden: Sequence[Effect] = (), duration: float = 24.0, noise: float = 1.0,
              robot: Robot = REFERENCE, seed: int = 0, substeps: int = 1,
              command: Array | None = None) -> Record:
    """Return the record of an arm with effects; its sensors' noise is scaled."""
    arm = BaseModel(robot, effects=tuple(hidden)).arm(robot.payload_mass).finer(substeps)
    simulator = Simulator(arm, noise=Noise(noise * 1e-4, noise * 5e-7), seed=seed)
    if command is None:
        command = commands(robot, duration, seed)
    output, _ = simulate(simulator, command)
    time: Array = robot.sample_time * np.arange(len(command), dtype=float)
    return Record('simulated', time, command, output, robot.payload_mass)


def predictor(record: Record, assumed: Sequence[Effect] = (), robot: Robot = REFERENCE,
              locked: bool = True, slowest: float = SLOWEST,
              noise_shares: tuple[float, float] = BaseModel.noise_shares) -> Predictor:
    """Return the predictor of an arm with effects over a record's locked or other windows."""
    cut = Windows.cut(record, slowest, robot.sample_time)
    noise = np.maximum(measurement_noise(record.output), 1e-9)
    base = BaseModel(robot, effects=tuple(assumed), noise_shares=noise_shares)
    return Predictor(base, cut[1 if locked else 0], noise)


def free_run_errors(p: Predictor, starts: Indices, steps: int) -> Array:
    """Return measured minus simulated over free runs, (steps, S, m); NaN beyond the end."""
    rows = np.minimum(starts + np.arange(steps)[:, None], len(p.record.time) - 1)
    found: Array = p.record.output[rows] - free_run(p, starts, steps)
    return found


def write(record: Record, path: Path, robot: Robot = REFERENCE) -> Path:
    """Write a record as a CSV log; return its path."""
    write_csv(path, Log(str(path), record.time, record.command, record.output[:, :2],
                        record.output[:, 2:], robot.gauge_names))
    return path
