"""The one error that bad input raises."""

LONGEST = 300


class InputError(ValueError):
    """
    Bad input: one line that names the file, key, topic or row, what was expected and came.

    What does not fit a line of LONGEST characters is left out of its middle.
    """

    def __init__(self, message: object = ''):
        line = ' '.join(''.join(c if c.isprintable() else ' ' for c in str(message)).split())
        if len(line) > LONGEST:
            line = f'{line[:200]} … {line[203 - LONGEST:]}'
        super().__init__(line)
