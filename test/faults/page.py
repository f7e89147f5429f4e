"""Figures of docs/faults.md: each program prints its own, and writes them there if asked."""

from __future__ import annotations

import os
from pathlib import Path
import re
import subprocess

REPOSITORY = Path(__file__).resolve().parents[2]
PAGE = REPOSITORY / 'docs' / 'faults.md'


def made() -> str:
    """Return a line on the measured code, and on how busy the machine is."""
    commit = subprocess.run(['git', 'rev-parse', '--short', 'HEAD'], cwd=REPOSITORY, text=True,
                            capture_output=True).stdout.strip()
    return f'{commit or "no commit"}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores'


def record(block: str, lines: list[str], write: bool) -> None:
    """
    Print lines, and write them between `<!-- BLOCK -->` and `<!-- end -->` of the page.

    Raises
    ------
    ValueError
        The page has no such block.

    """
    text = '\n'.join([*lines, '', f'({made()})'])
    print(text, flush=True)
    if not write:
        return
    page = PAGE.read_text()
    new, found = re.subn(rf'(<!-- {block} -->\n).*?(<!-- end -->)',
                         lambda match: f'{match[1]}\n{text}\n\n{match[2]}', page, flags=re.S)
    if found != 1:
        raise ValueError(f'{PAGE.name}: expected one block {block}, got {found}')
    PAGE.write_text(new)
