"""What can be wrong with a store, in words for a person."""


class StoreError(Exception):
    """The store could not be opened, read or written: which file, why, what to do."""


class Unavailable(StoreError):
    """Not now: the disk is full, read-only or failing, or the file is somebody else's lock. It may work again later."""


class Busy(Unavailable):
    """Somebody else writes to the file, or holds it, for longer than is waited."""
