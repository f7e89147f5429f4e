"""A name that the robot file gives to one channel is no other channel's: messages, bags, CSV."""

from __future__ import annotations

from pathlib import Path

from flex_plant_sim.arm.robot_file import parse_robot, robot_text
from flex_plant_sim.logs.read import read_log
from msg_config.errors import InputError
import numpy as np
import pytest
from test_log_bag import GAUGES, joint_state, record, strains, ticks

# The robot file names one channel; the other one may bear its drive's name, but not this one.
ONE_NAMED = parse_robot(f'{robot_text("reference")}\ninputs: {{joints: {{joint_1: elbow}}}}\n',
                        'arm.yaml')
COMMAND_NAMED = parse_robot(
    f'{robot_text("reference")}\ninputs: {{commands: {{joint_2: shoulder}}}}\n', 'arm.yaml')
DRIVES = ['shoulder', 'elbow']


def test_a_name_that_the_file_gives_away_is_no_alias_of_the_other_joint() -> None:
    for channels in (ONE_NAMED.inputs.joint_channels(), ONE_NAMED.inputs.command_channels()):
        with pytest.raises(InputError, match='expected elbow, joint_2; joint_2 is missing from '
                                             'shoulder, elbow'):
            channels.pick(DRIVES, [1.0, 2.0], 'joint_states: position')
        assert channels.pick(['joint_2', 'elbow'], [1.0, 2.0], '').tolist() == [2.0, 1.0]


def test_a_command_s_name_is_no_alias_of_the_other_command() -> None:
    channels = COMMAND_NAMED.inputs.command_channels()
    with pytest.raises(InputError, match='joint_1 is missing from shoulder, x'):
        channels.pick(['shoulder', 'x'], [1.0, 2.0], 'command: effort')
    assert channels.pick(['joint_1', 'shoulder'], [1.0, 2.0], '').tolist() == [1.0, 2.0]
    assert channels.pick(['joint_1', 'elbow'], [1.0, 2.0], '').tolist() == [1.0, 2.0]


@pytest.mark.parametrize('named', ['joint_2', 'strain_1b'])
def test_a_channel_s_own_name_is_not_given_away(named: str) -> None:
    kind, other = ('joints', 'joint_1') if named == 'joint_2' else ('gauges', 'strain_1a')
    with pytest.raises(InputError, match=f"expected each name once, got '{named}' for "
                                         f'{kind}.{other} and {kind}.{named}'):
        parse_robot(f'{robot_text("reference")}\ninputs: {{{kind}: {{{other}: {named}}}}}\n',
                    'arm.yaml')


def test_a_bag_whose_names_leave_a_joint_out_is_refused(tmp_path: Path) -> None:
    states = [('/arm/joint_states', t, joint_state(t, DRIVES, [0.1, -0.1], [0.0, 0.0]))
              for t in ticks(5)]
    with pytest.raises(InputError, match='joint_2 is missing from shoulder, elbow'):
        read_log(record(tmp_path / 'bag', [*states, *strains(5)]), ONE_NAMED)


def test_a_table_whose_names_leave_a_joint_out_is_refused(tmp_path: Path) -> None:
    header = ','.join(['time', 'command_1', 'command_2', *DRIVES, *GAUGES])
    np.savetxt(tmp_path / 'log.csv', np.arange(45.0).reshape(5, 9), delimiter=',', header=header,
               comments='')
    with pytest.raises(InputError, match='joint_2'):
        read_log(tmp_path / 'log.csv', ONE_NAMED)
