"""Mutations of files, as disks, editors, exporters and attackers make them."""

from __future__ import annotations

from collections.abc import Callable
import random

Mutation = Callable[[random.Random, bytes], bytes]
TOKENS = [b'nan', b'inf', b'-inf', b'1e308', b'1e-320', b'-1', b'0', b'', b'"', b'\x00', b'\xff',
          b'1e', b'0x10', b'1,5', b'--1', b'9' * 400, b'true', b'null', b'[', b'{', b'&a', b'*a',
          b'!!python/object:os.system x', b'\xe2\x80\xa8', b'=1+1', b'$x^2$']


def flip_bits(rng: random.Random, data: bytes) -> bytes:
    """Flip up to eight bits."""
    new = bytearray(data)
    for _ in range(rng.randint(1, 8)):
        new[rng.randrange(len(new))] ^= 1 << rng.randrange(8)
    return bytes(new)


def cut(rng: random.Random, data: bytes) -> bytes:
    """Cut the end off."""
    return data[:rng.randrange(len(data))]


def take_out(rng: random.Random, data: bytes) -> bytes:
    """Remove a piece from the middle."""
    start = rng.randrange(len(data))
    return data[:start] + data[start + rng.randint(1, 400):]


def repeat(rng: random.Random, data: bytes) -> bytes:
    """Repeat a piece."""
    start = rng.randrange(len(data))
    piece = data[start:start + rng.randint(1, 400)]
    return data[:start] + piece * rng.randint(2, 5) + data[start:]


def zero(rng: random.Random, data: bytes) -> bytes:
    """Overwrite a block with zeros, as in a torn page."""
    start = rng.randrange(len(data))
    count = min(rng.randint(1, 512), len(data) - start)
    return data[:start] + bytes(count) + data[start + count:]


def insert(rng: random.Random, data: bytes) -> bytes:
    """Insert a token."""
    start = rng.randrange(len(data))
    return data[:start] + rng.choice(TOKENS) + data[start:]


def length(rng: random.Random, data: bytes) -> bytes:
    """Put a huge little-endian length somewhere."""
    start = rng.randrange(max(len(data) - 8, 1))
    value = rng.choice([2**31 - 1, 2**32 - 1, 11 * 2**30, 2**63 - 1, 2**40])
    return data[:start] + value.to_bytes(8, 'little') + data[start + 8:]


BYTES: tuple[Mutation, ...] = (flip_bits, cut, take_out, repeat, zero, insert, length)


def cell(rng: random.Random, data: bytes) -> bytes:
    """Replace a cell of a table."""
    lines = data.split(b'\n')
    row = rng.randrange(len(lines))
    cells = lines[row].split(b',')
    cells[rng.randrange(len(cells))] = rng.choice(TOKENS)
    lines[row] = b','.join(cells)
    return b'\n'.join(lines)


def shorten_cell(rng: random.Random, data: bytes) -> bytes:
    """Cut a number short, in its exponent if it has one."""
    lines = data.split(b'\n')
    row = rng.randrange(1, len(lines))
    cells = lines[row].split(b',')
    k = rng.randrange(len(cells))
    cells[k] = cells[k][:rng.randint(0, max(len(cells[k]) - 1, 0))]
    lines[row] = b','.join(cells)
    return b'\n'.join(lines)


def drop_lines(rng: random.Random, data: bytes) -> bytes:
    """Lose a few lines in a row."""
    lines = data.split(b'\n')
    row = rng.randrange(1, len(lines))
    del lines[row:row + rng.randint(1, 40)]
    return b'\n'.join(lines)


def swap_lines(rng: random.Random, data: bytes) -> bytes:
    """Exchange two lines."""
    lines = data.split(b'\n')
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[a], lines[b] = lines[b], lines[a]
    return b'\n'.join(lines)


def column(rng: random.Random, data: bytes) -> bytes:
    """Scale a column as another unit would, or exchange two names of the header."""
    lines = data.split(b'\n')
    header = lines[0].split(b',')
    k = rng.randrange(len(header))
    if rng.random() < 0.3:
        other = rng.randrange(len(header))
        header[k], header[other] = header[other], header[k]
        return b'\n'.join([b','.join(header), *lines[1:]])
    factor = rng.choice([1e3, 1e6, 1e9, 1e-3, -1.0, 57.2957795])
    for row in range(1, len(lines)):
        cells = lines[row].split(b',')
        try:
            cells[k] = b'%.9g' % (float(cells[k]) * factor)
        except (ValueError, IndexError):
            continue
        lines[row] = b','.join(cells)
    return b'\n'.join(lines)


TABLE: tuple[Mutation, ...] = (cell, shorten_cell, drop_lines, swap_lines, column)


def bomb(rng: random.Random, data: bytes) -> bytes:
    """Put an alias bomb, a deep list or a long one where a value stood."""
    lines = data.split(b'\n')
    keys = [k for k, line in enumerate(lines) if b': ' in line and not line.startswith(b'#')]
    k = rng.choice(keys or [0])
    name = lines[k].split(b':')[0]
    value = rng.choice([
        b'[' * rng.choice([30, 1000]), b'[' + b'1, ' * 20_000 + b'1]',
        b'&a [x, x]', b'{a: &a [1,1,1,1,1,1,1,1], b: &b [*a,*a,*a,*a,*a,*a,*a,*a], '
        b'c: &c [*b,*b,*b,*b,*b,*b,*b,*b], d: &d [*c,*c,*c,*c,*c,*c,*c,*c], '
        b'e: [*d,*d,*d,*d,*d,*d,*d,*d]}', b'"' + b'x' * 100_000 + b'"', b'1' * 5000])
    lines[k] = name + b': ' + value
    return b'\n'.join(lines)


def key_line(rng: random.Random, data: bytes) -> bytes:
    """Repeat, drop or retype a line of YAML, or change its value."""
    lines = data.split(b'\n')
    k = rng.randrange(len(lines))
    way = rng.randrange(4)
    if way == 0:
        lines.insert(k, lines[k])
    elif way == 1:
        del lines[k]
    elif way == 2:
        lines[k] = lines[k].replace(b'_m:', b':').replace(b'length', b'lenght')
    elif b': ' in lines[k]:
        lines[k] = lines[k].split(b': ')[0] + b': ' + rng.choice(
            [*TOKENS, b'2.05e11', b'1e999', b'1_000', b'1:30', b'010', b'yes', b'2'])
    return b'\n'.join(lines)


YAML: tuple[Mutation, ...] = (bomb, key_line)
