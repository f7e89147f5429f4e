"""Whatever comes, the readers answer with the truth or with one line; found by hypothesis."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from flex_plant_sim.arm.robot_file import load_robot, parse_robot, robot_text
from flex_plant_sim.arm.safe_yaml import read_yaml
from flex_plant_sim.inputs.resample import BRIDGED, even_grid
from flex_plant_sim.inputs.synchroniser import slop_of, Synchroniser
from flex_plant_sim.logs.read import read_log
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
from msg_config.errors import InputError
from msg_config.input_mapping import InputMapping
import numpy as np
import pytest
import yaml

ROBOT, TEXT = load_robot('reference'), robot_text('reference')
QUICK = settings(max_examples=40, deadline=None, derandomize=True,
                 suppress_health_check=list(HealthCheck))
HEADER = 'time,command_1,command_2,joint_1,joint_2,strain_1a,strain_1b,strain_2a,strain_2b'
KEYS = st.text('abcdefgh_', min_size=1, max_size=6).filter(
    lambda key: key not in ('y', 'n', 'e', 'no', 'on'))
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-10**15, 10**15)
    | st.floats(allow_nan=False, allow_infinity=False) | KEYS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=20)


@QUICK
@given(PLAIN)
def test_yaml_that_another_library_wrote_is_read_as_meant(data: object) -> None:
    assert read_yaml(yaml.safe_dump(data), 'any.yaml') == data


@QUICK
@given(st.binary(max_size=300) | st.text(max_size=300).map(str.encode))
def test_any_text_is_a_robot_or_one_line(raw: bytes) -> None:
    for text in (raw.decode(errors='replace'), TEXT + raw.decode(errors='replace')):
        try:
            parse_robot(text, 'any.yaml')
        except InputError as error:
            assert '\n' not in str(error) and len(str(error)) <= 300


@QUICK
@given(st.lists(st.lists(st.floats(width=32) | st.text(max_size=5), min_size=8, max_size=10),
                max_size=6), st.sampled_from(',;\t'))
def test_any_table_is_a_log_or_one_line(rows: list[list[object]], separator: str) -> None:
    lines = [HEADER.replace(',', separator),
             *(separator.join(map(str, [0.01 * k, *row])) for k, row in enumerate(rows))]
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'log.csv'
        path.write_text('\n'.join(lines) + '\n', encoding='utf-8', errors='replace')
        try:
            log = read_log(path, ROBOT)
        except InputError as error:
            assert '\n' not in str(error) and len(str(error)) <= 300
        else:
            assert np.isfinite(log.output).all() and np.isfinite(log.command).all()
            assert (np.diff(log.time) > 0.0).all()


@QUICK
@given(st.permutations(['joint_1', 'joint_2', 'gripper', 'wrist']), st.integers(0, 4))
def test_joints_are_found_in_any_order_or_refused(names: list[str], kept: int) -> None:
    given_names = names[:kept]
    values = [{'joint_1': 1.0, 'joint_2': 2.0}.get(name, 9.0) for name in given_names]
    channels = InputMapping().joint_channels()
    if {'joint_1', 'joint_2'} <= set(given_names):
        assert list(channels.pick(given_names, values, 'x')) == [1.0, 2.0]
    else:
        with pytest.raises(InputError):
            channels.pick(given_names, values, 'x')


@QUICK
@given(st.sets(st.integers(1, 100), max_size=12), st.integers(30, 100), st.floats(1e-4, 1.0),
       st.floats(0.0, 0.15), st.integers(0, 2**32))
def test_samples_stay_at_their_places(lost: set[int], count: int, interval: float, jitter: float,
                                      seed: int) -> None:
    places = np.array([k for k in range(count) if k not in lost])
    rng = np.random.default_rng(seed)
    time = interval * (places + rng.uniform(-jitter, jitter, len(places)))
    try:
        grid = even_grid(time, 'any')
    except InputError:
        return  # too many were lost
    assert np.array_equal(np.diff(grid.place), np.diff(places[grid.first:grid.last]))
    assert np.diff(grid.place).max(initial=0) <= BRIDGED + 1


@QUICK
@given(st.lists(st.tuples(st.sampled_from(['a', 'b']), st.integers(0, 40)), max_size=60))
def test_pairs_are_near_and_no_message_is_used_twice(events: list[tuple[str, int]]) -> None:
    pairing = Synchroniser(('a', 'b'), slop_of(0.01))
    used = [sample.parts for k, (part, stamp) in enumerate(events)
            if (sample := pairing.add(part, stamp * 1_000_000, (k, stamp))) is not None]
    for parts in used:
        assert abs(parts['a'][1] - parts['b'][1]) <= 4
    for part in ('a', 'b'):
        numbers = [parts[part][0] for parts in used]
        assert len(set(numbers)) == len(numbers)
