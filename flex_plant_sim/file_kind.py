"""What stands at a path, in words; opening a FIFO would wait for ever."""

from __future__ import annotations

import os
from pathlib import Path
import stat

FILE, FOLDER, NOTHING = 'a file', 'a folder', 'nothing'
OTHERS = {stat.S_IFIFO: 'a FIFO', stat.S_IFSOCK: 'a socket', stat.S_IFCHR: 'a device',
          stat.S_IFBLK: 'a device'}


def file_kind(path: str | Path) -> str:
    """Return FILE, FOLDER, NOTHING, or what else stands where a path, or a link there, leads."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return NOTHING
    if stat.S_ISREG(mode):
        return FILE
    return FOLDER if stat.S_ISDIR(mode) else OTHERS.get(stat.S_IFMT(mode), 'no file')
