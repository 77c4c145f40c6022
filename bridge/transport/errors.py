"""Errors of a transport: a device that cannot be opened, and one that is lost."""

from bridge.reasons.catalogue import english
from bridge.reasons.codes import Sentence


class DeviceUnavailable(Exception):
    """Error: a device cannot be opened now; the caller may try again later.

    reason: sentences for the user, which state the cause and what to do. soon: True if the caller may try again every
    0.1 s, because an attempt is cheap and disturbs nobody.
    """

    def __init__(self, *reason: Sentence, soon: bool = False) -> None:
        super().__init__(english(*reason))
        self.reason, self.soon = reason, soon


class DeviceLost(Exception):
    """Error: an open device is gone, for example unplugged or switched off, or was closed, or its file has ended.

    reason: sentences for the user, which state the cause. over: True if the device will not come back.
    """

    def __init__(self, *reason: Sentence, over: bool = False) -> None:
        super().__init__(english(*reason))
        self.reason, self.over = reason, over
