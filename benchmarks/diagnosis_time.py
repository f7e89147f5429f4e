"""
Print the cost of a diagnosis with the whole catalogue: on a 40 s log, and one ten times as long.

`python benchmarks/diagnosis_time.py` makes two logs of the reference robot with dry friction in
its elbow, gives each to `flex_diagnose` in two processes, and samples the memory of all of them
(proportional set size, so that shared pages count once). Then it searches the short log in one
process and prints passes through the record and CPU time up to each step. With `--log` it gives
`flex_diagnose` that log alone, with the `--robot` and `--payload` named.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any

from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.diagnosis.causes.search import search
from flex_plant_sim.diagnosis.prediction.predictor import Predictor
from flex_plant_sim.diagnosis.record.data import Data
from flex_plant_sim.diagnosis.record.windows import Record
from flex_plant_sim.diagnosis.verdict.verdict import nominal_base, slowest_frequency
from flex_plant_sim.effects import build, parse
from flex_plant_sim.logs.csv_log import write_csv
from flex_plant_sim.logs.log import Log
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.simulation.simulator import Noise, simulate, Simulator
import numpy as np

ROBOT = load_robot('reference')
HIDDEN = ('coulomb_friction:joint_2:level_n_m=0.3', 'coriolis_centripetal:arm:share=1')
# Time for which a random set-point is held, and interval at which memory is sampled, s.
HOLD = 0.9
SAMPLING = 0.1


def write_record(path: Path, duration: float, seed: int) -> None:
    """Write a log of random steps of both joints, with sensor noise, `duration` s long."""
    rng = np.random.default_rng(seed)
    count, hold = round(duration / ROBOT.sample_time), round(HOLD / ROBOT.sample_time)
    levels = rng.uniform(-0.6, 0.6, (count // hold + 2, 2))
    levels[1::2] = -levels[::2][:len(levels[1::2])]
    command = np.repeat(levels, hold, axis=0)[:count]
    effects = tuple(build(parse(text), ROBOT) for text in HIDDEN)
    simulator = Simulator(ExtendedArm(ROBOT, 'assumed_modes', 3, 0.1, effects),
                          noise=Noise(1e-4, 5e-7), seed=seed)
    output, _ = simulate(simulator, command)
    time_s = ROBOT.sample_time * np.arange(count, dtype=float)
    write_csv(path, Log(path.name, time_s, command, output[:, :2], output[:, 2:],
                        ROBOT.gauge_names))


def memory(pid: int) -> float:
    """Return the memory of a process and its descendants, MB."""
    try:
        children = Path(f'/proc/{pid}/task/{pid}/children').read_text().split()
        rollup = Path(f'/proc/{pid}/smaps_rollup').read_text()
    except OSError:
        return 0.0
    own = next((int(line.split()[1]) for line in rollup.splitlines() if line.startswith('Pss:')),
               0)
    return own / 1024.0 + sum(memory(int(child)) for child in children)


def diagnose(path: Path, jobs: int, options: Sequence[str]) -> tuple[float, float, str]:
    """Return time (s), highest memory (MB) and the answer's first line."""
    started, highest = time.perf_counter(), 0.0
    with subprocess.Popen(
            [sys.executable, '-m', 'flex_payload_estimator.tools.diagnose', str(path),
             '--jobs', str(jobs), *options],
            stdout=subprocess.PIPE, text=True) as process:
        while process.poll() is None:
            highest = max(highest, memory(process.pid))
            time.sleep(SAMPLING)
        assert process.stdout is not None
        text = process.stdout.read()
    if process.returncode != 0:
        raise SystemExit(f'{path.name}: flex_diagnose ended with {process.returncode}')
    return time.perf_counter() - started, highest, text.splitlines()[0]


def passes(path: Path) -> None:
    """Print the cost of each step of a search: passes through the record, and s of CPU."""
    log, base = read_log(path, ROBOT), nominal_base(ROBOT, 'assumed_modes', 3)
    record = Record(path.name, log.time, log.command, log.output, 0.1)
    data = Data.of([record], slowest_frequency(base, 0.1), ROBOT.sample_time)
    count, whitened, started = [0], Predictor.whitened_residual, time.process_time()
    seen: set[str] = set()

    def counted(*arguments: Any, **named: Any) -> Any:
        count[0] += 1
        return whitened(*arguments, **named)

    def told(step: str, share: float) -> None:
        if step not in seen:
            print(f'{count[0]:6d} passes {time.process_time() - started:6.1f} s before: {step}')
        seen.add(step)

    Predictor.whitened_residual = counted  # type: ignore[method-assign]
    with np.errstate(all='ignore'):
        search(data, base, 1, told)
    told('the end', 1.0)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--jobs', type=int, default=2, help='processes (default: 2)')
    parser.add_argument('--seed', type=int, default=0, help='of the records (default: 0)')
    parser.add_argument('--log', type=Path, help='a log of your own')
    parser.add_argument('--robot', default='reference', help='of that log (default: reference)')
    parser.add_argument('--payload', help='of that log, kg (default: as the log has it)')
    chosen = parser.parse_args()
    told = ['--robot', chosen.robot, *(('--payload', chosen.payload) if chosen.payload else ())]
    if chosen.log:
        taken, highest, answer = diagnose(chosen.log, chosen.jobs, told)
        print(f'{taken:.1f} s, {highest:.0f} MB: {answer}')
        return
    found = []
    print(f'{"log":>6} {"time":>9} {"of it":>8} {"memory":>9}  answer')
    with TemporaryDirectory() as folder:
        for duration in (40.0, 400.0):
            path = Path(folder) / f'record_{duration:.0f}.csv'
            write_record(path, duration, chosen.seed)
            taken, highest, answer = diagnose(path, chosen.jobs,
                                              ('--robot', 'reference', '--payload', '0.1'))
            found.append(taken)
            print(f'{duration:4.0f} s {taken:7.1f} s {taken / duration:8.2f} {highest:6.0f} MB  '
                  f'{answer[:60]}', flush=True)
        print(f'ten times the log: {found[1] / found[0]:.1f} times the time')
        passes(Path(folder) / 'record_40.csv')


if __name__ == '__main__':
    main()
