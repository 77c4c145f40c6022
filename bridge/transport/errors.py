"""Errors of a transport: a device that cannot be opened, and one that is lost."""

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Sentence


class DeviceUnavailable(Exception):
    """A device cannot be opened now; the caller tries again later.

    reason: sentences for people: what was tried, and what to do. soon: True if opening is tried again every 0.1 s,
    because an attempt is cheap and disturbs nobody.
    """

    def __init__(self, *reason: Sentence, soon: bool = False) -> None:
        super().__init__(english(*reason))
        self.reason, self.soon = reason, soon


class DeviceLost(Exception):
    """An open device went away: unplugged, powered off, or at the end of a file.

    reason: sentences for people. over: True if the device will not come back.
    """

    def __init__(self, *reason: Sentence, over: bool = False) -> None:
        super().__init__(english(*reason))
        self.reason, self.over = reason, over
