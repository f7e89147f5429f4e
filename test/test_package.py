"""package.xml, setup.py, the launch file and the two commands agree with each other."""

from __future__ import annotations

from configparser import ConfigParser
from importlib import import_module
from importlib.metadata import distribution, distributions
import os
from pathlib import Path
import re
import runpy
import subprocess
import sys
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
import pytest

if TYPE_CHECKING:
    from ros_loop import RosLoop

EXECUTABLES = {
    'plant_sim', 'payload_estimator', 'lqg_controller',
    'flex_compile', 'flex_demo', 'flex_diagnose', 'flex_estimate', 'flex_figures', 'flex_fleet',
    'flex_replay', 'flex_robot',
}
PACKAGES = ('flex_plant_sim', 'flex_payload_estimator', 'msg_config')


@pytest.fixture(scope='module')
def manifest(repository: Path) -> ElementTree.Element:
    """Return package.xml."""
    return ElementTree.parse(repository / 'package.xml').getroot()


@pytest.fixture(scope='module')
def built(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder into which setup.py installs as colcon calls it."""
    prefix = tmp_path_factory.mktemp('prefix')
    egg_info = tmp_path_factory.mktemp('egg_info')
    subprocess.run(
        [sys.executable, '-W', 'ignore', 'setup.py', '-q',
         'egg_info', '--egg-base', str(egg_info), 'build', '--build-base', str(prefix / 'build'),
         'install', '--prefix', str(prefix / 'install'),
         '--record', str(prefix / 'record'), '--single-version-externally-managed'],
        cwd=repository, check=True)
    return prefix / 'install'


def test_manifest_is_a_format_3_ament_python_package(manifest: ElementTree.Element) -> None:
    assert manifest.get('format') == '3'
    assert manifest.findtext('name') == 'flex_payload'
    assert manifest.findtext('export/build_type') == 'ament_python'
    assert manifest.findtext('license') == 'Apache-2.0'


def test_version_is_the_same_everywhere(manifest: ElementTree.Element, repository: Path) -> None:
    version = manifest.findtext('version')
    setup = (repository / 'setup.py').read_text(encoding='utf-8')
    assert re.findall(r"version='(.*)'", setup) == [version]
    assert distribution('flex_payload').version == version


def test_every_message_package_of_the_contract_is_a_dependency(
    manifest: ElementTree.Element,
) -> None:
    from msg_config.contract import load_services, load_topics

    types = [topic.type for topic in load_topics().values()]
    types += [service.type for service in load_services().values()]
    dependencies = {node.text for node in manifest.findall('exec_depend')}
    assert {name.split('/')[0] for name in types} < dependencies


def test_the_security_policy_names_the_contract(repository: Path) -> None:
    from msg_config.contract import load_services, load_topics

    policy = ElementTree.parse(repository / 'config' / 'sros2_policy.xml').getroot()
    ros = {'/rosout', '/parameter_events', '~/transition_event'}
    for way in ('publish', 'subscribe'):
        named = {topic.text for topic in policy.findall(f'.//topics[@{way}="ALLOW"]/topic')}
        unheard = {'reference'} if way == 'publish' else {
            'payload', 'payload_stamped', 'innovation', '/diagnostics', 'arm_markers'}
        assert named - ros == set(load_topics()) - unheard
    named = {service.text for service in policy.findall('.//profile[@node="plant_sim"]//service')}
    assert set(load_services()) < named


@pytest.mark.parametrize('kind', ['run', 'test'])
def test_every_extra_that_a_locked_package_asks_for_is_locked(repository: Path, kind: str) -> None:
    """Without the extra pip takes the newest release for it, which has no hash in the lock."""
    text = (repository / 'requirements' / f'{kind}.txt').read_text(encoding='utf-8')
    lines = [Requirement(line.rstrip(' \\')) for line in text.splitlines() if line[:1].isalnum()]
    locked = {canonicalize_name(line.name): line.extras for line in lines
              if line.marker is None or line.marker.evaluate()}
    assert {'numpy', 'scipy'} <= set(locked)
    missing = set()
    for package in distributions():
        owner = canonicalize_name(package.name)
        for line in package.requires or ():
            wanted = Requirement(line)
            applies = owner in locked and (wanted.marker is None or any(
                wanted.marker.evaluate({'extra': extra}) for extra in {'', *locked[owner]}))
            for extra in wanted.extras if applies else ():
                if extra not in locked[canonicalize_name(wanted.name)]:
                    missing.add(f'{owner} asks for {wanted.name}[{extra}]')
    assert not missing


def test_every_folder_of_code_is_a_package(repository: Path) -> None:
    for package in PACKAGES:
        for module in (repository / package).rglob('*.py'):
            assert (module.parent / '__init__.py').is_file(), f'{module.parent}: no __init__.py'


def test_every_console_script_has_its_function() -> None:
    scripts = {entry.name: entry.value for entry in distribution('flex_payload').entry_points
               if entry.group == 'console_scripts'}
    assert set(scripts) == EXECUTABLES
    for value in scripts.values():
        module, function = value.split(':')
        assert callable(getattr(import_module(module), function)), value


@pytest.mark.skipif(sys.prefix == sys.base_prefix, reason="only pip fills an environment's bin/; "
                    'colcon fills lib/flex_payload, see test_colcon_build')
@pytest.mark.parametrize('name', sorted(EXECUTABLES))
def test_the_environment_has_the_console_script(name: str) -> None:
    assert os.access(Path(sys.executable).parent / name, os.X_OK)


def test_setup_installs_where_ros_looks(built: Path) -> None:
    assert {path.name for path in (built / 'lib/flex_payload').iterdir()} == EXECUTABLES
    share = built / 'share'
    assert (share / 'ament_index/resource_index/packages/flex_payload').is_file()
    assert (share / 'flex_payload/package.xml').is_file()
    assert (share / 'flex_payload/launch/flex_payload.launch.py').is_file()


def test_setup_installs_every_data_file(built: Path, repository: Path) -> None:
    installed = next(built.glob('lib/python*/site-packages'))
    for package in PACKAGES:
        for source in (repository / package).rglob('*'):
            if source.suffix in ('.py', '.yaml', '.html'):
                path = installed / source.relative_to(repository)
                assert path.read_bytes() == source.read_bytes(), path


def test_flake8_settings_are_those_of_ament(repository: Path) -> None:
    config = ConfigParser()
    config.read(repository / 'setup.cfg')
    settings = dict(config['flake8'])
    settings.pop('exclude')
    assert settings == {
        'docstring-convention': 'all',
        'extend-ignore': 'C816,D100,D101,D102,D103,D104,D105,D106,D107,D203,D212,D404,I202',
        'import-order-style': 'google',
        'max-line-length': '99',
    }


@pytest.mark.parametrize(('name', 'nodes'), [
    ('flex_payload', ('plant_sim', 'payload_estimator', 'lqg_controller')),
    ('estimator', ('payload_estimator',))])
def test_a_launch_file_names_nodes_and_parameters_that_exist(
    repository: Path, name: str, nodes: tuple[str, ...],
) -> None:
    from msg_config.parameters import load_parameters

    launch = (repository / f'launch/{name}.launch.py').read_text(encoding='utf-8')
    assert tuple(re.findall(r"executable='(\w+)'", launch)) == nodes
    arguments = dict(re.findall(r"^    '(\w+)': \('([\w.]*)'", launch, re.MULTILINE))
    assert set(arguments) >= {'robot', 'namespace', 'params_file', 'use_sim_time', 'record'}
    table = load_parameters()[nodes[0]]
    for given in set(arguments) & set(table):
        assert str(table[given].default) == arguments[given]


@pytest.mark.ros
def test_the_estimator_is_launched_with_other_topics_for_all_that_it_hears(
        repository: Path, loop: RosLoop) -> None:
    from flex_payload_estimator.nodes.payload_estimator_node import PayloadEstimatorNode

    launch = (repository / 'launch/estimator.launch.py').read_text(encoding='utf-8')
    table, = re.findall(r'^TOPICS = \{\n(.*?)^\}', launch, re.MULTILINE | re.DOTALL)
    heard = loop.start(PayloadEstimatorNode, model='paper_reduced', modes=2, estimator='sf1')
    assert dict(re.findall(r"'(\w+)': \('(\w+)'", table)) == {
        name: name for name in heard._subscribed}
    assert 'for name in TOPICS' in launch


@pytest.mark.parametrize('name', ['flex_payload', 'estimator'])
def test_a_launch_file_runs_where_launch_is_installed(repository: Path, name: str) -> None:
    launch = pytest.importorskip('launch', reason='launch is no wheel: a ROS 2 has it')
    pytest.importorskip('launch_ros')
    path = repository / f'launch/{name}.launch.py'
    content = runpy.run_path(str(path))
    context = launch.LaunchContext()
    for argument, (default, _) in content['ARGUMENTS'].items():
        context.launch_configurations[argument] = default
    assert content['generate_launch_description']().entities
    assert len(content['nodes'](context)) == (3 if name == 'flex_payload' else 1)


def _environment(repository: Path, python: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ['.ci/environment', 'test', os.devnull], cwd=repository, text=True, capture_output=True,
        env={**os.environ, 'PYTHON': str(python)})


@pytest.mark.parametrize(('script', 'message'), [
    ('exit 127', r'cannot run .*: install Python 3\.10 or newer'),
    ('case "$2" in *version_info*) exit 1;; esac; [ "$1" = --version ] && echo Python 3.8.1',
     r'Python 3\.8\.1 is too old: install Python 3\.10 or newer'),
    ('case "$2" in *ensurepip*) exit 1;; esac', r'has no venv: install it .*python3-venv'),
    ('case "$2" in *machine*|*rclpy*) exit 1;; esac',
     r'no rclpy here.*: source a ROS 2 first'),
])
def test_a_missing_prerequisite_is_told_in_one_line(
    repository: Path, tmp_path: Path, script: str, message: str,
) -> None:
    python = tmp_path / 'python'
    python.write_text(f'#!/bin/sh\n{script}\nexit 0\n', encoding='utf-8')
    python.chmod(0o755)
    result = _environment(repository, python)
    assert result.returncode == 1
    assert re.fullmatch(rf'flex_payload: .*{message}.*\n', result.stderr), result.stderr


def test_make_help_lists_the_targets(repository: Path) -> None:
    result = subprocess.run(
        ['make', 'help'], cwd=repository, text=True, capture_output=True, check=True)
    listed = [line.split()[0] for line in result.stdout.splitlines() if line and line[0] != 'm']
    phony = re.search(r'^\.PHONY: (.*)$', (repository / 'Makefile').read_text(), re.MULTILINE)
    assert phony is not None and listed == phony[1].split()


def test_too_little_memory_to_load_anything_is_one_line(repository: Path) -> None:
    result = subprocess.run(
        ['bash', '-c', f'ulimit -v 300000; exec {sys.executable} -m flex_plant_sim.tools.robot'],
        cwd=repository, text=True, capture_output=True)
    assert (result.returncode, result.stdout) == (75, '')
    assert result.stderr == 'error: ulimit -v: expected at least 600000, got 300000\n'
