"""The error that bad input raises everywhere, exit codes, and text safe for any terminal."""

# Exit codes: 1 as Python itself uses, 2 as argparse, and EX_TEMPFAIL of sysexits.h.
UNFORESEEN, BAD_INPUT, MACHINE = 1, 2, 75
# Largest number of characters of an error: four lines of a terminal.
LONGEST = 300


def printable(text: str) -> str:
    """Return a text with spaces for unprintable characters, which a file name may contain."""
    return ''.join(c if c.isprintable() else ' ' for c in text)


class InputError(ValueError):
    """
    Bad input: one line that names the file, key, topic or row, what was expected and what came.

    If it exceeds LONGEST characters, its middle is left out.
    """

    def __init__(self, message: object = ''):
        line = ' '.join(printable(str(message)).split())
        if len(line) > LONGEST:
            line = f'{line[:200]} … {line[203 - LONGEST:]}'
        super().__init__(line)
