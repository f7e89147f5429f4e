"""The nodes take a diagnosed robot's file, and plant_sim any effect of the catalogue."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Any, TYPE_CHECKING

from flex_payload_estimator.model.payload_model import payload_model
from flex_payload_estimator.nodes.node_setup import controller_of, estimator_of, set_points_of
from flex_payload_estimator.tools import estimate
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.effects import catalogue, sites
from flex_plant_sim.simulation.plant_setup import simulator_of
from flex_plant_sim.simulation.simulator import simulate
from msg_config.parameters import check_parameters
import numpy as np
import pytest
from simulated_records import simulated, write

if TYPE_CHECKING:
    from ros_loop import RosLoop

FOUND = """
effects:
  - {name: coulomb_friction, site: joint_2, level_n_m: 0.3}
  - {name: input_delay, site: arm, delay_s: 0.02}
  - {name: link_stiffness, site: link_2, factor: 0.8}
  - {name: payload_mass, site: arm, deviation_kg: 0.05}
"""
SAMPLES = 121
COMMANDS = np.random.default_rng(0).uniform(-1.0, 1.0, (12, 2)).repeat(10, axis=0)


@pytest.fixture
def extended(tmp_path: Path) -> str:
    """Return the reference robot's file with effects."""
    text = (resources.files('flex_plant_sim') / 'robots' / 'reference.yaml').read_text()
    (tmp_path / 'extended.yaml').write_text(text + FOUND)
    return str(tmp_path / 'extended.yaml')


def outputs(**values: Any) -> np.ndarray:
    """Return what a plant without noise measures under COMMANDS."""
    table = check_parameters('plant_sim', {'angle_noise': 0.0, 'strain_noise': 0.0, 'modes': 2,
                                           **values})
    return simulate(simulator_of(table), COMMANDS)[0]


def test_effects_of_the_file_and_of_the_parameters_are_the_same(extended: str) -> None:
    by_parameter = outputs(effects=[
        'coulomb_friction:joint_2:level_n_m=0.3', 'input_delay:arm:delay_s=0.02',
        'link_stiffness:link_2:factor=0.8', 'payload_mass:arm:deviation_kg=0.05'])
    np.testing.assert_array_equal(outputs(robot=extended), by_parameter)
    difference = np.abs(by_parameter - outputs()).max(axis=0)
    assert difference[0] > 1e-3
    assert difference[1] > 1e-3


def test_coriolis_forces_act_unless_switched_off() -> None:
    named, off = ['coriolis_centripetal:arm:share=1'], outputs(coriolis=False)
    np.testing.assert_array_equal(outputs(), outputs(coriolis=False, effects=named))
    np.testing.assert_array_equal(outputs(), outputs(effects=named))
    assert np.abs(outputs() - off).max() > 1e-6
    for model in ('paper', 'paper_reduced'):
        np.testing.assert_array_equal(outputs(model=model), outputs(model=model, coriolis=False))


@pytest.mark.parametrize('identifier', catalogue())
def test_plant_sim_starts_with_every_effect(identifier: str) -> None:
    effect, robot = catalogue()[identifier], load_robot('reference')
    site = sites(effect, robot)[0]
    # A discrete parameter has no null.
    pairs = ','.join(f'{p.name}={p.starts[0] if p.discrete else p.null!r}'
                     for p in effect.at(site, robot))
    text = f'{identifier}:{site}:{pairs}'
    assert np.all(np.isfinite(outputs(effects=[text])[:5]))


def model_of(user: str, robot: str) -> tuple[Any, float]:
    """Return an estimator's or the controller's model, and its largest payload, kg."""
    values = {'robot': robot, 'model': 'paper_reduced', 'modes': 2}
    if user == 'lqg_controller':
        controller = controller_of(check_parameters(user, values))
        return controller.model, controller.payload_max
    table = check_parameters('payload_estimator', {**values, 'estimator': user})
    estimator: Any = estimator_of(table)
    return estimator.model, estimator.payload_max


@pytest.mark.parametrize('user', ['sf1', 'sf1_paper', 'lqg_controller'])
def test_a_linear_model_takes_the_parameters_that_were_found(user: str, extended: str) -> None:
    robot = load_robot('reference')
    softer = robot.with_link(1, youngs_modulus=0.8 * robot.links[1].youngs_modulus)
    (found, largest), (plain, told) = model_of(user, extended), model_of(user, 'reference')
    for cosine in (-0.4, 1.0):
        a, wanted = (model.matrices(cosine, 0.1)[0]
                     for model in (found, payload_model(softer, 'paper_reduced', 2)))
        np.testing.assert_allclose(a, wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max())
        assert np.abs(a - plain.matrices(cosine, 0.1)[0]).max() > 0.01 * np.abs(a).max()
    assert largest == told, 'the payload that the file says is what is looked for'


def test_what_a_linear_model_leaves_out_is_said(
        extended: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = '; of the robot file it leaves out coulomb_friction:joint_2, input_delay:arm'
    log = str(write(simulated(duration=2.0), tmp_path / 'log.csv'))
    for robot, estimator, said in ((extended, 'sf1', told), (extended, 'rpe', ''),
                                   ('reference', 'sf1', '')):
        arguments = ['--robot', robot, '--estimator', estimator, '--modes', '2']
        assert estimate.main([log, *arguments]) == 0
        line = capsys.readouterr().out.splitlines()[0]
        assert line.partition(';')[1] + line.partition(';')[2] == said


@pytest.mark.ros
def test_the_loop_runs_with_an_extended_robot_as_offline(loop: RosLoop, extended: str) -> None:
    from flex_payload_estimator.control.loop import run_loop
    from flex_payload_estimator.nodes.lqg_controller_node import LQGControllerNode
    from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode
    from flex_plant_sim.nodes.plant_sim_node import PlantSim

    common = {'robot': extended, 'modes': 2}
    tables = {'plant_sim': {**common, 'seed': 4}, 'lqg_controller': {**common, 'watchdog': 0.0},
              'payload_estimator': {**common, 'estimator': 'sf1'}}
    inertia, commands = loop.record('payload/inertia'), loop.record('command')
    for kind, values in zip((PlantSim, LQGControllerNode, PayloadEstimatorNode),
                            tables.values()):
        loop.start(kind, **values)
    loop.until(lambda: min(len(inertia.stamps), len(commands.stamps)) >= SAMPLES)
    plant, controller, estimator = (check_parameters(name, own) for name, own in tables.items())
    record = run_loop(simulator_of(plant), estimator_of(estimator), controller_of(controller),
                      set_points_of(controller), 0.01 * (SAMPLES - 1))
    mass = [m.inertia.m for m in inertia.by_stamp().values()][:SAMPLES]
    sent = [m.effort for m in commands.by_stamp().values()][:SAMPLES]
    np.testing.assert_allclose(mass, record.mass, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.array(sent), record.command, rtol=0.0, atol=1e-12)
