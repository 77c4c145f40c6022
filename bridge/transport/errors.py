"""Errors of a transport: a device that cannot be opened, and one that is lost."""

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Sentence


class DeviceUnavailable(Exception):
    """The device cannot be opened now; the reason says what was tried and what to do. Opening is retried.

    reason: sentences. soon: retrying is cheap and disturbs nobody, so the device is tried every 0.1 s.
    """

    def __init__(self, *reason: Sentence, soon: bool = False) -> None:
        super().__init__(english(*reason))
        self.reason, self.soon = reason, soon


class DeviceLost(Exception):
    """An open device went away: unplugged, powered off, end of a file. over: it will not come back.

    reason: sentences for people.
    """

    def __init__(self, *reason: Sentence, over: bool = False) -> None:
        super().__init__(english(*reason))
        self.reason, self.over = reason, over
