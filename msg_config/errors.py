"""The one error that bad input raises."""


class InputError(ValueError):
    """Bad input: one line that names the file, key, topic or row, what was expected and came."""
