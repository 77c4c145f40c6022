"""Table [recorder] of a ward's file; arguments of the command line take precedence."""

import re

from msgspec import Struct

from bridge.ros import messages
from bridge.wire.keys import check_id
from bridge.wire.refusal import Refusal

_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86_400.0}
_DURATION = re.compile(r"(\d+(?:\.\d+)?) ?(s|min|h|d)")
_SHORTEST_S, _SMALLEST_MB = 10.0, 1.0


def seconds(text: str, key: str) -> float:
    """Parse a duration such as 90s, 10min, 1h or 1d to seconds; `never` gives infinity.

    key: name of the setting in the error. Raises ValueError for any other text.
    """
    if text == "never":
        return float("inf")
    match = _DURATION.fullmatch(text)
    if match is None:
        raise ValueError(f"{key} is {text!r}: give a time such as 90s, 10min or 1h, or never")
    return float(match[1]) * _UNITS[match[2]]


class Recorder(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of a recorder: folder, devices, when a new file begins, and when old files are deleted.

    A comment at each field states its meaning and unit.
    Raises ValueError for a setting that is out of range or invalid.
    """

    #: folder of the recordings; relative to the folder the recorder is started in
    folder: str = "recordings"
    #: duration after which a new file begins: `30s`, `10min`, `1h` or `never`
    rotate: str = "1h"
    #: size after which a new file begins, megabytes
    rotate_mb: float = 500.0
    #: megabytes of the disk that are left free
    keep_free_mb: float = 200.0
    #: days after which a finished recording is deleted; 0: never
    keep_days: float = 0.0
    #: most gigabytes of the ward's recordings in the folder; above, the oldest finished recording is deleted; 0: no limit
    keep_gb: float = 0.0
    #: seconds to wait for a router and a device before giving up
    wait_s: float = 10.0
    #: ids of the devices to record; default: all
    devices: tuple[str, ...] = ()
    #: write each sample also as one ROS 2 message, for programs that plot
    per_sample: bool = False

    def __post_init__(self) -> None:
        if not self.folder:
            raise ValueError("folder is empty: name a folder, such as 'recordings'")
        if self.rotate_s < _SHORTEST_S:
            raise ValueError(f"rotate is {self.rotate!r}: use {_SHORTEST_S:g}s or more, or never")
        if not _SMALLEST_MB <= self.rotate_mb <= 1e6:
            raise ValueError(f"rotate_mb is {self.rotate_mb:g}: use {_SMALLEST_MB:g} to 1000000")
        if not 0 <= self.keep_free_mb <= 1e9:
            raise ValueError(f"keep_free_mb is {self.keep_free_mb:g}: use 0 or more")
        if not 0 <= self.keep_days <= 36_500:
            raise ValueError(f"keep_days is {self.keep_days:g}: use 0 (for ever) to 36500")
        if self.keep_gb and not 2 * self.rotate_mb / 1000 <= self.keep_gb <= 1e6:
            raise ValueError(
                f"keep_gb is {self.keep_gb:g}: use 0 (no limit), or at least {self.rotate_mb / 500:g}, which is twice rotate_mb"
            )
        if not 0 < self.wait_s <= 86_400:
            raise ValueError(f"wait_s is {self.wait_s:g}: use a number above 0, up to 86400")
        if self.per_sample and not messages.available():
            raise ValueError(f"per_sample {messages.NEEDS}")
        for device in self.devices:
            try:
                check_id(device, "a device in devices")
            except Refusal as refusal:
                raise ValueError(refusal.detail) from None

    @property
    def rotate_s(self) -> float:
        """Duration after which a new file begins, s; infinite for `never`."""
        return seconds(self.rotate, "rotate")
