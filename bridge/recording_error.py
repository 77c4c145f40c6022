"""The one way a recording is refused."""


class RecordingError(Exception):
    """A recording cannot be used: the file, what is in it, and what was expected."""
