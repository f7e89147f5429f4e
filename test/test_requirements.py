"""The locked requirements hold all that setup.py asks for, with hashes, and nothing unpinned."""

from __future__ import annotations

from importlib.metadata import requires
import json
from pathlib import Path
import re
import subprocess
import sys

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
import pytest

LOCKS = {'run': ('bags', 'fleet', 'report', 'speed', 'ros'),
         'test': ('bags', 'fleet', 'report', 'speed', 'ros', 'test')}


def _locked(repository: Path, kind: str) -> list[Requirement]:
    text = (repository / 'requirements' / f'{kind}.txt').read_text()
    lines = re.findall(r'^[a-z0-9].*?(?= \\)', text, re.M)
    return [Requirement(line) for line in lines]


def _asked(extras: tuple[str, ...]) -> list[Requirement]:
    everything = [Requirement(line) for line in requires('flex_payload') or ()]
    return [item for item in everything if item.marker is None
            or any(item.marker.evaluate({'extra': extra}) for extra in extras)]


@pytest.mark.parametrize('kind', LOCKS)
def test_the_lock_holds_what_setup_asks_for(repository: Path, kind: str) -> None:
    locked = [item for item in _locked(repository, kind)
              if item.marker is None or item.marker.evaluate()]
    pins = {canonicalize_name(item.name): next(iter(item.specifier)) for item in locked}
    for asked in _asked(LOCKS[kind]):
        pin = pins.get(canonicalize_name(asked.name))
        assert pin is not None, f'{asked.name}: make lock'
        assert pin.operator == '==' and asked.specifier.contains(pin.version), asked.name


@pytest.mark.parametrize('kind', LOCKS)
def test_every_locked_version_has_hashes(repository: Path, kind: str) -> None:
    text = (repository / 'requirements' / f'{kind}.txt').read_text()
    entries = re.split(r'\n(?=[a-z0-9])', text.strip())
    assert len(entries) == len(_locked(repository, kind))
    for entry in entries:
        assert '--hash=sha256:' in entry, entry.splitlines()[0]
    assert '://' not in text


def test_a_bill_of_materials_names_every_locked_package(repository: Path, tmp_path: Path) -> None:
    file, lock = tmp_path / 'sbom.json', tmp_path / 'run.txt'
    # Without most hashes, which take nine tenths of the time to read.
    text = (repository / 'requirements' / 'run.txt').read_text()
    lock.write_text(re.sub(r'( \\\n +--hash=\S+)( \\\n +--hash=\S+)+', r'\1', text))
    subprocess.run([sys.executable, '-m', 'cyclonedx_py', 'requirements', '--no-validate', '-o',
                    str(file), str(lock)], check=True)
    components = json.loads(file.read_text())['components']
    named = {(item['name'], item['version']) for item in components}
    assert named == {(item.name, next(iter(item.specifier)).version)
                     for item in _locked(repository, 'run')}
