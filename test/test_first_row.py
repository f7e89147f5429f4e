"""A first row that is no reading, and records that begin in any motion."""

from __future__ import annotations

from pathlib import Path

from extended_arms import arm
from flex_plant_sim.arm.second_order import Array
from flex_plant_sim.inputs.first_row import LEAPS, off_channel
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.simulation.simulator import simulate, Simulator
import numpy as np
import pytest
from simulated_records import REFERENCE
from truth.records import draw_case, make_record, Record

HEADER = 'time,command_1,command_2,joint_1,joint_2,strain_1a,strain_1b,strain_2a,strain_2b'
OUTPUTS = 6


@pytest.fixture(scope='module')
def record() -> Record:
    return make_record(draw_case('coulomb_friction', 52, duration_s=10.0))


@pytest.mark.parametrize('first', [0, 137, 402, 700])
@pytest.mark.parametrize('channel', range(OUTPUTS))
def test_a_stale_first_reading_is_told_wherever_the_arm_is(record: Record, first: int,
                                                           channel: int) -> None:
    time, output = record.time[first:], np.hstack([record.joint, record.strain])[first:]
    assert off_channel(time, output) is None
    stale = output.copy()
    stale[0, channel] += 0.2 * np.ptp(output[:, channel])
    assert off_channel(time, stale) == channel


def test_a_second_reading_that_is_off_does_not_cost_the_first(record: Record) -> None:
    output = np.hstack([record.joint, record.strain])
    output[1, 1] += 0.3
    assert off_channel(record.time, output) is None


def test_an_arm_that_a_leap_of_the_command_starts_has_a_first_reading() -> None:
    time = np.linspace(0.0, 9.99, 1000)
    quick = arm(*(f'drive_bandwidth:joint_{j}:time_constant_factor=0.7' for j in (1, 2)))
    for joint in (0, 1):
        command = np.zeros((len(time), 2))
        command[:, joint] = 0.9 * np.exp(-time)
        output = simulate(Simulator(quick), command)[0]
        change = np.abs(np.diff(output[:, joint], 2))
        assert change[0] > LEAPS * change[1:].max(), 'else it would not look so'
        assert off_channel(time, output) is None


@pytest.mark.parametrize('step', [1.0, 1e-6])
def test_noise_alone_seldom_looks_so(step: float) -> None:
    rng, time = np.random.default_rng(3), np.linspace(0.0, 4.0, 400)
    for _ in range(300):
        rounded: Array = step * np.rint(rng.normal(size=(400, OUTPUTS)) / step)
        assert off_channel(time, rounded) is None


def test_the_log_begins_with_the_next_row_and_says_so(record: Record, tmp_path: Path) -> None:
    table = record.table.copy()
    table[0, 4] = 0.3
    path = tmp_path / 'log.csv'
    np.savetxt(path, table, fmt='%.9g', delimiter=',', header=HEADER, comments='')
    log = read_log(path, REFERENCE)
    assert len(log) == len(table) - 1
    np.testing.assert_allclose(log.joint[:, 1], table[1:, 4], atol=1e-8)
    note, = (note for note in log.notes if 'left out' in note)
    assert note.startswith('line 2 left out: joint_2 is 0.3 rad off the next row')
