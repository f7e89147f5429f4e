"""What made a simulated log, kept beside a CSV file and in a bag's metadata."""

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
        Its name.
    model : str
        A key of extended_arm.MODELS.
    modes : int
        Modes a link.
    coriolis : bool
        Whether Coriolis and centripetal forces acted.

    """

    robot: str
    model: str
    modes: int
    coriolis: bool = False

    def against(self, robot: str, model: str, modes: int, coriolis: bool | None) -> str:
        """
        Return in one line how an arm differs from the one simulated; empty where not.

        Parameters
        ----------
        robot, model, modes
            As the attributes.
        coriolis : bool or None
            None where these forces are estimated.

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
    """Return the file beside a CSV log that says what made it."""
    return log.with_suffix('.origin.yaml')


def write_origin(log: Path, origin: Origin) -> None:
    """
    Write what made a CSV log beside it.

    Raises
    ------
    InputError
        If nothing can be written there.

    """
    with whole_file(origin_path(log)) as temporary:
        temporary.write_text(f'# {MARK}\n{yaml.safe_dump(asdict(origin))}', encoding='utf-8')


def csv_origin(log: Path) -> Origin | None:
    """Return what made a CSV log, where a file beside it says so."""
    path = origin_path(log)
    if not path.is_file():
        return None
    try:
        with open(path, encoding='utf-8') as file:
            return _origin(read_yaml(file.read(MAX_TEXT + 1), str(path)))
    except (OSError, UnicodeDecodeError, InputError):
        return None


def bag_origin(bag: Path) -> Origin | None:
    """Return what made a bag, where its metadata say so."""
    path = (bag if bag.is_dir() else bag.parent) / 'metadata.yaml'
    try:
        with open(path, encoding='utf-8') as file:
            data = read_yaml(file.read(MAX_TEXT + 1), str(path))
        said = data['rosbag2_bagfile_information']['custom_data'][BAG_KEY]
        return _origin(json.loads(said))
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def bag_text(origin: Origin) -> str:
    """Return an origin as a bag's metadata keep it."""
    return json.dumps(asdict(origin))


def _origin(data: Any) -> Origin | None:
    try:
        return Origin(str(data['robot'])[:100], str(data['model'])[:100], int(data['modes']),
                      bool(data.get('coriolis', False)))
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError):
        return None
