"""
The origin of a simulated log, kept beside a CSV file and in a bag's metadata.

The tools compare it with the model they are told to use.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
import json
from pathlib import Path
from typing import Any

from flex_plant_sim.arm.safe_yaml import MAX_TEXT, read_yaml
from flex_plant_sim.atomic_file import MARK, whole_file
from flex_plant_sim.effects.structure.coriolis_centripetal import coriolis_words
from msg_config.errors import InputError
import yaml

BAG_KEY = 'flex_payload_origin'


@dataclass(frozen=True)
class Origin:
    """
    The simulation that made a log.

    Attributes
    ----------
    robot : str
        Name of the robot.
    model : str
        A key of models.MODELS.
    modes : int
        Modes per link.
    coriolis : bool
        Whether Coriolis and centripetal forces acted.

    """

    robot: str
    model: str
    modes: int
    coriolis: bool = False

    def against(self, robot: str, model: str, modes: int, coriolis: bool | None) -> str:
        """
        Return in one line how a model differs from the one simulated, or '' if it does not.

        Parameters
        ----------
        robot, model, modes
            As the attributes.
        coriolis : bool or None
            None if these forces are estimated.

        """
        forced = self.coriolis if coriolis is None else coriolis
        if (self.robot, self.model, self.modes, self.coriolis) == (robot, model, modes, forced):
            return ''
        forces = '' if forced == self.coriolis else f', {coriolis_words(forced)}'
        simulated = f', {coriolis_words(self.coriolis)},' if forces else ','
        return (f'simulated with --robot {self.robot} --model {self.model} --modes {self.modes}'
                f'{simulated} read with {robot}, {model}, {modes}{forces}: the difference biases '
                'what is found')


def origin_path(log: Path) -> Path:
    """Return the path of the file beside a CSV log that holds its origin."""
    return log.with_suffix('.origin.yaml')


def write_origin(log: Path, origin: Origin) -> None:
    """
    Write the origin of a CSV log to the file beside it.

    Raises
    ------
    InputError
        Nothing can be written there.

    """
    with whole_file(origin_path(log)) as temporary:
        temporary.write_text(f'# {MARK}\n{yaml.safe_dump(asdict(origin))}', encoding='utf-8')


def csv_origin(log: Path) -> Origin | None:
    """Return the origin of a CSV log from the file beside it, or None."""
    path = origin_path(log)
    if not path.is_file():
        return None
    try:
        with open(path, encoding='utf-8') as file:
            return _origin(read_yaml(file.read(MAX_TEXT + 1), str(path)))
    except (OSError, UnicodeDecodeError, InputError):
        return None


def bag_origin(bag: Path) -> Origin | None:
    """Return the origin of a bag from its metadata, or None."""
    path = (bag if bag.is_dir() else bag.parent) / 'metadata.yaml'
    try:
        with open(path, encoding='utf-8') as file:
            data = read_yaml(file.read(MAX_TEXT + 1), str(path))
        said = data['rosbag2_bagfile_information']['custom_data'][BAG_KEY]
        return _origin(json.loads(said))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def bag_text(origin: Origin) -> str:
    """Return an origin as the text for a bag's metadata."""
    return json.dumps(asdict(origin))


def _origin(data: Any) -> Origin | None:
    try:
        return Origin(str(data['robot'])[:100], str(data['model'])[:100], int(data['modes']),
                      bool(data.get('coriolis', False)))
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        return None
