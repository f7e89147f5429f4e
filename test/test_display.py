"""URDF against the model's rigid kinematics and inertia; display layouts against the topics."""

from __future__ import annotations

import json
import math
from pathlib import Path
import re
from typing import Any
from xml.etree import ElementTree

from flex_plant_sim.arm.assumed_modes import assumed_modes
from flex_plant_sim.arm.robot_file import load_robot
from flex_plant_sim.commissioning.urdf import urdf
from flex_plant_sim.nodes.arm_markers import FRAME
from flex_plant_sim.simulation.arm_shape import ArmShape
from flex_plant_sim.simulation.extended_arm import ExtendedArm
from flex_plant_sim.tools.robot import main
from msg_config.contract import load_topics
import numpy as np
import pytest
import yaml

ROBOTS = ['reference', 'quanser_2dsfl']
# Published by robot_state_publisher, not by this package.
FOREIGN = {'/robot_description'}


def _x(element: ElementTree.Element) -> float:
    origin = element.find('origin')
    return 0.0 if origin is None else float(origin.attrib['xyz'].split()[0])


def _chain(root: ElementTree.Element, angles: dict[str, float]
           ) -> dict[str, tuple[complex, float]]:
    """Return place (complex) and angle of every link's frame."""
    frames = {'base': (0j, 0.0)}
    for joint in root.findall('joint'):
        parent, child = joint.find('parent'), joint.find('child')
        assert parent is not None and child is not None
        place, angle = frames[parent.attrib['link']]
        place += _x(joint) * complex(math.cos(angle), math.sin(angle))
        frames[child.attrib['link']] = (place, angle + angles.get(joint.attrib['name'], 0.0))
    return frames


@pytest.mark.parametrize('name', ROBOTS)
def test_the_tip_is_where_the_markers_end(name: str) -> None:
    robot = load_robot(name)
    frames = _chain(ElementTree.fromstring(urdf(robot)), {'joint_1': 0.4, 'joint_2': -0.9})
    arm = ExtendedArm(robot)
    state = np.zeros(arm.form.order)
    state[:2] = 0.4, -0.9
    end = ArmShape.of(arm).lines(state)[1, -1]
    assert frames['tip'][0] == pytest.approx(complex(*end), abs=1e-9)
    assert FRAME == 'base'


@pytest.mark.parametrize('name', ROBOTS)
def test_the_skeleton_has_the_rigid_inertia_of_the_arm(name: str) -> None:
    """About the shoulder, for several elbow angles, from the XML alone; rotors left out."""
    robot = load_robot(name)
    root = ElementTree.fromstring(urdf(robot))
    form = assumed_modes(robot, 1)
    for elbow in (0.0, 1.1):
        frames, total = _chain(root, {'joint_2': elbow}), 0.0
        for link in root.findall('link'):
            inertial = link.find('inertial')
            if inertial is None:
                continue
            place, angle = frames[link.attrib['name']]
            centre = place + _x(inertial) * complex(math.cos(angle), math.sin(angle))
            mass, moment = inertial.find('mass'), inertial.find('inertia')
            assert mass is not None and moment is not None
            total += float(mass.attrib['value']) * abs(centre)**2 + float(moment.attrib['izz'])
        model = form.mass_at(math.cos(elbow), robot.payload_mass)[0, 0] - robot.drives[0].inertia
        assert total == pytest.approx(model, rel=1e-6)


def test_the_prefix_stands_before_every_frame(tmp_path: Path) -> None:
    file = tmp_path / 'arm.urdf'
    assert main(['urdf', 'reference', '--prefix', 'left_', '--output', str(file)]) == 0
    root = ElementTree.parse(file).getroot()
    assert [link.attrib['name'] for link in root.findall('link')] == [
        'left_base', 'left_upper', 'left_lower', 'left_tip']
    assert [joint.attrib['name'] for joint in root.findall('joint')] == [
        'joint_1', 'joint_2', 'tip']


def test_limits_of_the_file_are_limits_of_the_joints(tmp_path: Path) -> None:
    file = tmp_path / 'arm.yaml'
    assert main(['template', '--output', str(file)]) == 0
    joint = ElementTree.fromstring(urdf(load_robot(file))).find('joint')
    assert joint is not None and joint.attrib['type'] == 'revolute'
    limit = joint.find('limit')
    assert limit is not None
    assert (limit.attrib['lower'], limit.attrib['upper']) == ('-1.5', '1.5')
    assert float(limit.attrib['velocity']) == pytest.approx(3.0)


def _texts(item: Any) -> list[str]:
    if isinstance(item, dict):
        return [text for key, value in item.items() for text in (str(key), *_texts(value))]
    if isinstance(item, list):
        return [text for value in item for text in _texts(value)]
    return [str(item)]


def _known(topic: str) -> bool:
    names = {f'/{name.strip("/")}' for name in load_topics()} | FOREIGN
    return any(topic == name or topic.startswith((f'{name}.', f'{name}/')) for name in names)


def test_rviz_shows_topics_of_the_contract(repository: Path) -> None:
    layout = yaml.safe_load((repository / 'config/flex_payload.rviz').read_text())
    assert layout['Visualization Manager']['Global Options']['Fixed Frame'] == FRAME
    topics = [text for text in _texts(layout) if text.startswith('/')]
    assert '/arm_markers' in topics and all(map(_known, topics)), topics


def test_foxglove_shows_topics_of_the_contract(repository: Path) -> None:
    layout = json.loads((repository / 'config/foxglove.json').read_text())
    topics = [text for text in _texts(layout['configById']) if re.match(r'/\w', text)]
    assert {'/arm_markers', '/diagnostics'} <= set(topics) and all(map(_known, topics)), topics
    named = [text for text in _texts(layout['layout']) if '!' in text]
    assert sorted(named) == sorted(layout['configById'])


def test_plotjuggler_shows_topics_of_the_contract(repository: Path) -> None:
    layout = ElementTree.parse(repository / 'config/plotjuggler.xml')
    curves = [curve.attrib['name'] for curve in layout.iter('curve')]
    assert len(curves) > 5 and all(map(_known, curves)), curves
