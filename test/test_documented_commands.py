"""Every command of README and docs, run as it is written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import os
from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = ('README.md', 'CONTRIBUTING.md', *sorted(
    f'docs/{path.name}' for path in (ROOT / 'docs').glob('*.md')))
# A fence, what stands before it, its language and its text.
FENCE = re.compile(r'(?P<before>(?:[^\n]*\n)?)^```(?P<kind>[^\n]*)\n(?P<text>.*?)^```$',
                   re.M | re.S)
NOT_RUN = re.compile(r'<!-- not run: (?P<why>.+) -->\n')
OTHER_KINDS = {'yaml', '{toctree}', 'python', 'text', 'math'}
SLOWEST = '600'  # s, with everything to be compiled on a busy machine


@dataclass(frozen=True)
class Block:
    """Commands that stand together on a page; why they are not run, or empty."""

    page: str
    number: int
    commands: str
    why_not: str

    def __str__(self) -> str:
        """Return page and number."""
        return f'{self.page}-{self.number}'


def blocks(page: str) -> Iterator[Block]:
    """Yield the blocks of commands of a page."""
    for number, fence in enumerate(FENCE.finditer((ROOT / page).read_text(encoding='utf-8'))):
        kind = fence['kind'].strip()
        if kind in ('sh', 'console'):
            text = fence['text']
            if kind == 'console':
                text = ''.join(re.findall(r'^\$ (.*\n)', text, re.M))
            reason = NOT_RUN.fullmatch(fence['before'])
            yield Block(page, number, text, reason['why'] if reason else '')
        else:
            assert kind in OTHER_KINDS, f'{page}: a fence of {kind!r}: commands are sh or console'


BLOCKS = [block for page in PAGES for block in blocks(page)]


@pytest.fixture(scope='module')
def folders(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return a folder for every page, made like a fresh checkout with its environment."""
    return {page: checkout(tmp_path_factory.mktemp(Path(page).stem)) for page in PAGES}


def checkout(folder: Path) -> Path:
    """Make a folder like a fresh checkout with its environment; return it."""
    kept = ('.git', '.venv', 'build', 'demo_output', 'report')
    for path in ROOT.iterdir():
        if path.name not in kept:
            (folder / path.name).symlink_to(path)
    environment = folder / '.venv'
    environment.mkdir()
    for path in Path(sys.prefix).iterdir():
        if not path.name.startswith('.'):
            (environment / path.name).symlink_to(path)
    for source in ('wheels', os.environ.get('ROS_DISTRO', 'wheels')):
        for stamp in ('run', 'test'):
            (environment / f'.{source}-{stamp}').touch()
    return folder


def run_as_written(commands: str, folder: Path, domain_id: int) -> str:
    """Run commands in a folder, in a ROS domain of their own; return what they print."""
    environment = {
        **os.environ, 'PATH': f'{Path(sys.executable).parent}:{os.environ["PATH"]}',
        'ROS_DOMAIN_ID': str(domain_id)}
    # The guard of this process would keep the wheels from preparing another.
    environment.pop('_ROS_WHEELS_BOOTSTRAP_COMPLETE', None)
    # The shell's children end with it.
    result = subprocess.run(
        ['timeout', SLOWEST, 'bash', '-euo', 'pipefail', '-c', commands], text=True,
        capture_output=True, cwd=folder, env=environment)
    assert result.returncode == 0, f'{commands}\n{result.stdout}\n{result.stderr}'
    return result.stdout


@pytest.mark.slow
@pytest.mark.parametrize('block', BLOCKS, ids=str)
def test_the_commands_run_as_written(block: Block, folders: dict[str, Path],
                                     domain_id: int) -> None:
    if block.why_not:
        pytest.skip(block.why_not)
    run_as_written(block.commands, folders[block.page], domain_id)


def test_the_tutorial_is_one_page_of_at_most_twelve_commands() -> None:
    lines = [line for block in blocks('docs/tutorial.md')
             for line in block.commands.splitlines() if line.strip()]
    assert 8 <= len(lines) <= 12
    words = (ROOT / 'docs/tutorial.md').read_text(encoding='utf-8').split()
    assert len(words) < 800


def test_commands_that_are_not_run_say_what_they_need() -> None:
    for block in BLOCKS:
        if block.why_not and 'ROS 2' not in block.why_not:
            assert 'test' in block.why_not, f'{block}: {block.why_not}'
