"""The one error that bad input raises, and text that any file and terminal takes."""

# Characters of an error: four lines of a terminal.
LONGEST = 300


def printable(text: str) -> str:
    """Return a text with a space for what has no look: the name of a file may be any bytes."""
    return ''.join(c if c.isprintable() else ' ' for c in text)


class InputError(ValueError):
    """
    Bad input: one line that names the file, key, topic or row, what was expected and came.

    What does not fit a line of LONGEST characters is left out of its middle.
    """

    def __init__(self, message: object = ''):
        line = ' '.join(printable(str(message)).split())
        if len(line) > LONGEST:
            line = f'{line[:200]} … {line[203 - LONGEST:]}'
        super().__init__(line)
