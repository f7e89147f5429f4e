"""flake8, a quarter faster: the tokens that several plugins ask for are made once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import gc
import tokenize

from flake8.main.cli import main

PLAIN = tokenize.generate_tokens
known: dict[str, list[tokenize.TokenInfo]] = {}


def generate_tokens(readline: Callable[[], str]) -> Iterable[tokenize.TokenInfo]:
    """Return the tokens of a text, from memory if it is that of the last call."""
    if getattr(readline, '__name__', '') == 'next_line':
        # flake8 itself counts the lines while it takes their tokens.
        return PLAIN(readline)
    lines = []
    try:
        while line := readline():
            lines.append(line)
    except StopIteration:
        pass
    text = ''.join(lines)
    if text not in known:
        found = list(PLAIN(iter(lines).__next__))
        known.clear()
        known[text] = found
    return iter(known[text])


if __name__ == '__main__':
    # Syntax trees hold few cycles to look for.
    gc.disable()
    tokenize.generate_tokens = generate_tokens  # type: ignore[assignment]
    raise SystemExit(main())
