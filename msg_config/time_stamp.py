"""The stamp of a header as a number; it needs no message package."""

# Nanoseconds per second.
NANOSECONDS = 1_000_000_000


def valid_stamp(seconds: int, nanoseconds: int) -> bool:
    """Return whether a header's stamp is a valid time, 1970 or later."""
    return seconds >= 0 and 0 <= nanoseconds < NANOSECONDS
