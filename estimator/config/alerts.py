"""Table [alerts] of a ward's file: hold times of faults before an alert, and the addresses that alerts are sent to."""

import os
import re
from datetime import datetime, time

from msgspec import Struct

from bridge.runtime.regular_file import content
from bridge.toml.loader import ConfigError, nearest
from estimator.device.attention import Kind

#: addresses to which alerts are sent, one a line or separated by blanks: as `urls_file`, for services
URLS_VARIABLE = "TRUERATE_ALERT_URLS"
#: how long a trouble holds before it is an alert, s
HOLD_S = {
    Kind.LOST: 60.0,
    Kind.UNCALIBRATED: 900.0,
    Kind.DEGRADED: 300.0,
    Kind.BAD_SAMPLES: 300.0,
    Kind.BATTERY_LOW: 60.0,
    Kind.DISK: 60.0,
    Kind.CLOCK: 3600.0,
    Kind.CERTIFICATE: 60.0,
    Kind.BACKUP: 60.0,
}
_HOURS = re.compile(r"([01]\d|2[0-3]):([0-5]\d)-([01]\d|2[0-3]):([0-5]\d)\Z")


class Alerts(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of alerts: hold times, quiet hours, and addresses to send to. The web page always shows all alerts.

    A comment at each field states its meaning and unit.
    Raises ValueError for an unknown kind of alert, and for a value out of range.
    """

    #: seconds after which a problem becomes an alert, by kind: `{ lost = 120, uncalibrated = 1800 }`; defaults: docs/alerts.md
    hold_s: dict[str, float] = {}
    #: seconds without the problem until its alert is cleared; a problem that returns earlier continues the same alert
    clear_s: float = 60.0
    #: local hours without sound or messages, for example `22:00-06:00`; alerts that still stand are sent afterwards
    quiet_hours: str = ""
    #: file with addresses for apprise, one a line: mail, ntfy, webhook; mode 0600, since an address holds a password
    urls_file: str = ""
    #: language of the messages sent: `en` or `zh`
    language: str = "en"

    def __post_init__(self) -> None:
        for kind, seconds in self.hold_s.items():
            if kind not in HOLD_S:
                raise ValueError(f"hold_s: unknown alert {kind!r}; {nearest(kind, HOLD_S)}")
            if not 0 <= seconds <= 604_800:
                raise ValueError(f"hold_s of {kind} is {seconds:g}; allowed: 0 to 604800 seconds")
        if not 1 <= self.clear_s <= 86_400:
            raise ValueError(f"clear_s is {self.clear_s:g}; allowed: 1 to 86400 seconds")
        if self.quiet_hours and not _HOURS.match(self.quiet_hours):
            raise ValueError(f"quiet_hours is {self.quiet_hours!r}; write for example '22:00-06:00'")
        if self.language not in ("en", "zh"):
            raise ValueError(f"language is {self.language!r}; allowed: 'en' or 'zh'")

    def hold(self, kind: str) -> float:
        """Return the time that a fault of a kind must last before it raises an alert, s."""
        return self.hold_s.get(kind, HOLD_S[Kind(kind)])

    def quiet(self, local: datetime) -> bool:
        """Return True if a local wall-clock time is within the quiet hours, which may span midnight."""
        if (match := _HOURS.match(self.quiet_hours)) is None:
            return False
        numbers = [int(one) for one in match.groups()]
        begin, end, now = time(numbers[0], numbers[1]), time(numbers[2], numbers[3]), local.time()
        return begin <= now < end if begin <= end else now >= begin or now < end

    def urls(self) -> list[str]:
        """Return the addresses that alerts are sent to, from the file `urls_file` and the environment.

        Raises ConfigError if the file cannot be read.
        """
        found = os.environ.get(URLS_VARIABLE, "").split()
        if self.urls_file:
            try:
                lines = content(self.urls_file).decode().splitlines()
            except (OSError, UnicodeDecodeError) as error:
                raise ConfigError(f"[alerts] urls_file {self.urls_file} cannot be read: {error}") from None
            found += [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]
        return found


DEFAULTS = Alerts()
