"""flex_demo: the whole way from options to figures and logs, over topics."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
import json
import os
from pathlib import Path
import re
from typing import Any

from flex_payload_estimator.tools import demo
from flex_payload_estimator.tools.experiment import drawn_arm
from flex_plant_sim.arm.robot_file import load_robot, robot_text
from flex_plant_sim.commissioning.template import template
from flex_plant_sim.logs.read import read_log
from flex_plant_sim.tools import replay
import numpy as np
import pytest
from test_documented_commands import blocks, checkout, run_as_written

PNG = b'\x89PNG\r\n\x1a\n'


@pytest.fixture(scope='module')
def output(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Return the folder and the words of the README's first command."""
    command = next(blocks('README.md')).commands
    assert command.startswith('make demo ')
    folder = checkout(tmp_path_factory.mktemp('demo'))
    # Domains above 101 are free of the tests' locked ones.
    return folder / 'demo_output', run_as_written(command, folder, 150 + os.getpid() % 50)


@pytest.mark.ros
def test_the_demo_estimates_the_payload_and_says_what_to_look_at(
    output: tuple[Path, str],
) -> None:
    folder, words = output
    summary = json.loads((folder / 'summary.json').read_text())
    assert summary['robot'] == 'arm.yaml' and (folder / 'arm.yaml').is_file()
    assert abs(summary['mass_kg'] - 0.1) < 2.5 * summary['std_kg'] < 0.02
    assert summary['at_s']['3'] == pytest.approx(0.1, rel=0.1)
    assert '\nflex_demo: 10 s over ROS 2 topics; rpe tells the controller' in words
    assert "no estimator's own model: n = 8 modes a link" in words
    assert words.count('payload = ') == 21, 'twice a second'
    for text in ('sf1_paper ', 'sf1 ', 'rpe ', 'figure_4.png', 'flex_estimate', 'flex_replay',
                 ' % of its length'):
        assert text in words
    assert '± 0.0000' not in words


@pytest.mark.ros
def test_the_demo_writes_six_figures_and_two_equal_logs(output: tuple[Path, str]) -> None:
    folder, _ = output
    figures = sorted(path.name for path in folder.glob('*.png'))
    assert figures == [*(f'figure_{number}.png' for number in range(4, 10)), 'payload.png']
    for name in figures:
        content = (folder / name).read_bytes()
        assert content.startswith(PNG)
        assert len(content) > 10_000
    robot = load_robot('reference')
    csv, bag = read_log(folder / 'run.csv', robot), read_log(folder / 'run_mcap', robot)
    assert len(csv) == len(bag) == 1001
    np.testing.assert_allclose(csv.output, bag.output, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(csv.command, bag.command, rtol=1e-8, atol=1e-12)
    assert not list(folder.parent.glob('.*demo_output')), 'nothing temporary stays'


@pytest.mark.ros
def test_the_topics_gave_what_the_offline_loop_gives(output: tuple[Path, str]) -> None:
    from flex_payload_estimator.control.loop import run_loop
    from flex_payload_estimator.nodes.node_setup import controller_of, estimator_of, set_points_of
    from flex_plant_sim.simulation.plant_setup import simulator_of

    experiment = demo.Experiment.of(demo.options_of(['--duration', '3']), output[0] / 'arm.yaml')
    record = run_loop(simulator_of(experiment.plant), estimator_of(experiment.estimator),
                      controller_of(experiment.controller),
                      set_points_of(experiment.controller), experiment.duration)
    bag = read_log(output[0] / 'run_mcap', load_robot('reference')).part(0, 301)
    np.testing.assert_allclose(bag.output, record.output, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(bag.command, record.command, rtol=0.0, atol=1e-12)
    summary = json.loads((output[0] / 'summary.json').read_text())
    assert summary['at_s']['3'] == pytest.approx(record.mass[-1], abs=1e-12)


@pytest.mark.ros
def test_another_run_replaces_the_output_and_spares_what_is_not_a_demo_s(
    domain_id: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain_id))
    monkeypatch.chdir(tmp_path)
    options = ['--duration', '0.1', '--figures', '--out']
    for seed in ('1', '2'):
        assert demo.main([*options, 'again', '--seed', seed]) == 0
        assert sorted(path.name for path in (tmp_path / 'again').iterdir()) == [
            'arm.yaml', 'payload.png', 'run.csv', 'run.origin.yaml', 'run_mcap', 'summary.json']
        summary = json.loads((tmp_path / 'again' / 'summary.json').read_text())
        assert summary['seed'] == int(seed)
    (tmp_path / 'mine').mkdir()
    # What has a demo's name may be a user's own log.
    for mine in (tmp_path / 'mine' / 'thesis.txt', tmp_path / 'again' / 'run.csv'):
        mine.write_text('years of work')
        assert demo.main([*options, mine.parent.name]) == 2
        assert mine.read_text() == 'years of work'
    (tmp_path / 'again' / 'summary.json').write_text('{"sha256": []}')
    assert demo.main([*options, 'again']) == 2


@pytest.mark.ros
def test_an_arm_that_sf1_cannot_take_has_a_demo_without_it(
    domain_id: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain_id))
    text = re.sub(r'gauge_positions_m: \[.*?\]', 'gauge_positions_m: []', template())
    (tmp_path / 'bare.yaml').write_text(text)
    assert demo.main(['--robot', str(tmp_path / 'bare.yaml'), '--duration', '0.1', '--figures',
                      '--out', str(tmp_path / 'out')]) == 0
    said = capfd.readouterr().out
    assert 'sf1 is left out: modes: SF1 needs a gauge a mode' in said
    assert 'sf1_paper is left out: ' in said and (tmp_path / 'out' / 'payload.png').exists()


@pytest.mark.parametrize(('arguments', 'text'), [
    (['--robot', 'nobody'], "expected one of .* got 'nobody'"),
    (['--duration', '1', '--drop-at', '5'], 'before the end of the run, 1 s, got 5 s'),
    (['--payload', '0', '--drop-at', '1'], '--drop-at: expected a payload > 0 kg to drop'),
    (['--seed', '1', '--seed', '1'], 'argument --seed: expected once, given again'),
    (['--duration', '-1'], "argument --duration: expected a time > 0 s, .* got '-1'"),
    (['--amplitude', '0'], "argument --amplitude: expected an angle > 0 rad, .* got '0'"),
    (['--amplitude', 'wide'], "expected an angle > 0 rad, .* got 'wide'"),
    (['--payload', 'nan'], "expected a mass >= 0 kg, .* got 'nan'"),
    (['--estimator', 'oracle'], "invalid choice: 'oracle'"),
    (['--estimator', 'sf1_paper', '--model', 'paper'], 'paper_reduced'),
    (['--seed', '-1'], "expected a whole number .* got '-1'"),
    (['--figures', '3'], 'invalid choice: 3'),
    (['--out', 'no/such/folder'], 'no/such/folder: expected an existing folder'),
])
def test_bad_options_are_one_line_with_code_2_and_nothing_written(
    arguments: list[str], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    import re

    monkeypatch.chdir(tmp_path)
    try:
        code: Any = demo.main(arguments)
    except SystemExit as exit_:
        code = exit_.code
    assert code == 2
    error = capsys.readouterr().err
    assert re.search(text, error), error
    assert error.count('\n') == 1
    assert list(tmp_path.iterdir()) == []


def test_the_options_reach_all_three_nodes() -> None:
    experiment = demo.Experiment.of(demo.options_of([
        '--robot', 'quanser_2dsfl', '--model', 'assumed_modes', '--modes', '4', '--seed', '7',
        '--payload', '0.3', '--drop-at', '2', '--duration', '3']))
    for values in (experiment.plant, experiment.estimator, experiment.controller):
        assert (values['robot'], values['model'], values['modes']) == (
            'quanser_2dsfl', 'assumed_modes', 4)
    assert experiment.plant['payload_schedule'] == (2.0, 0.3, 2.0, 0.0)
    assert (experiment.plant['payload'], experiment.plant['seed']) == (0.3, 7)
    assert experiment.samples == 1501, "500 Hz is the robot file's"


@pytest.fixture()
def closing(monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Return a function of the demo's options that returns its last text."""
    monkeypatch.setattr(demo, 'runs_table', lambda *_: '')
    monkeypatch.setattr(demo, 'largest_bend_percent', lambda *_: 1.0)

    def words(*arguments: str) -> str:
        options = demo.options_of(arguments)
        record: Any = Namespace(true_mass=np.ones(1))
        return demo.closing_words(demo.Experiment.of(options), record, [], options)

    return words


def test_the_next_commands_are_right_as_written(closing: Callable[..., str]) -> None:
    log = read_options(closing('--payload', '0.123456789', '--modes', '4', '--matched'))
    assert (log.robot, log.modes, log.payload) == ('reference', 4, 0.123456789)
    log = read_options(closing())
    assert (log.robot, log.modes, log.payload) == ('demo_output/arm.yaml', 5, None)


@pytest.mark.parametrize(('figures', 'named'), [
    (['--figures'], []),
    (['--figures', '4'], ["demo_output/figure_4.png   the paper's figure"]),
    (['--figures', '7', '5', '5'],
     ["demo_output/figure_5.png, figure_7.png   the paper's figures; figure 5 is rpe"]),
    ([], ["demo_output/figure_4.png … figure_9.png   the paper's figures; figure 5 is rpe"]),
])
def test_the_figures_that_are_named_are_those_that_were_drawn(
    figures: list[str], named: list[str], closing: Callable[..., str],
) -> None:
    lines = [line.strip() for line in closing(*figures).splitlines()]
    assert [line for line in lines if 'figure' in line] == named
    assert any(line.startswith('demo_output/run.csv') for line in lines)


def read_options(words: str) -> Namespace:
    """Return the options of the flex_replay command in a text, as that tool reads them."""
    return replay.options().parse_args(words.split('flex_replay ')[1].split('\n')[0].split())


def test_the_summary_tells_when_the_estimate_stays_close() -> None:
    time = np.arange(0.0, 4.0, 0.5)
    mass = np.array([0.0, 0.1, 0.2, 0.104, 0.096, 0.1, 0.1, 0.1])
    record = Namespace(time=time, mass=mass, true_mass=np.full(8, 0.1), variance=np.full(8, 1e-6))
    experiment = demo.Experiment.of(demo.options_of([]))
    summary = demo.summary_of(experiment, record)  # type: ignore[arg-type]
    assert summary['within_5_percent_from_s'] == 1.5
    assert summary['at_s'] == {'1': 0.2, '3': 0.1}
    assert summary['std_kg'] == pytest.approx(1e-3)
    record.mass[-1] = 0.2
    summary = demo.summary_of(experiment, record)  # type: ignore[arg-type]
    assert summary['within_5_percent_from_s'] is None


def test_the_demos_arm_keeps_the_effects_of_its_file(tmp_path: Path) -> None:
    path = tmp_path / 'slack.yaml'
    path.write_text(robot_text('reference') + 'effects:\n- {name: coulomb_friction, '
                    'site: joint_2, level_n_m: 0.2}\n', encoding='utf-8')
    told, arm = load_robot(path), load_robot(drawn_arm(
        Namespace(robot=str(path), seed=3), tmp_path / 'arm.yaml'))
    assert arm.effects == told.effects and arm.effects
    assert arm.links[0].youngs_modulus != told.links[0].youngs_modulus
