"""zenoh sessions: opening, closing, settings files, conversion of errors, and handles of declared objects.

zenoh puts received data into channels, and daemon threads of this package read the channels. zenoh's callbacks are not
used. One form of callback adds a thread that keeps a failed program from exiting. The other form makes zenoh's receiving
thread wait for the lock of the Python interpreter.
"""

import contextlib
import json
import logging
import re
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import zenoh
from zenoh import handlers

from bridge.bus import zenoh_settings
from bridge.bus.contract import BusError
from bridge.runtime import os_errors
from bridge.toml.loader import nearest

if TYPE_CHECKING:
    from bridge.bus.zenoh_bus import ZenohBus

_T = TypeVar("_T")
_log = logging.getLogger(__name__)

_RETRY_S = 0.1
#: capacity of a channel, in messages; our thread always drains it, because a full channel stops the session's receiving
CHANNEL = 65536
#: poll interval of several empty channels, s
POLL_S = 0.005
#: format of zenoh's message about an invalid file
_MESSAGE = re.compile(r'Message \{ msg: "(?P<words>.*)", location: Some\(Location \{ line: (?P<line>\d+)', re.DOTALL)
_UNKNOWN = re.compile(r"unknown field `(.*?)`, expected (.*)", re.DOTALL)
_NAMES = re.compile(r"`(.*?)`")
#: TLS settings that zenoh prefers to the files of the same names, and omits when it dumps its settings
TLS_INSTEAD = tuple(
    f"{name}_base64"
    for name in (
        "root_ca_certificate",
        *("listen_certificate", "listen_private_key"),
        *("connect_certificate", "connect_private_key"),
    )
)
_PARTS = (
    *("mode", "connect", "listen", "scouting", "adminspace", "timestamping", "qos", "transport", "low_pass_filter"),
    *("access_control", "plugins", "id", "namespace", "downsampling"),
)


def open_session(settings: zenoh_settings.Settings, complaint: str, timeout_s: float = 0.0) -> zenoh.Session:
    """Open a zenoh session with the given settings; retry for timeout_s seconds.

    complaint: beginning of the error message. Raises BusError if zenoh cannot open the session.
    """
    with as_bus_error(complaint):
        config = zenoh.Config.from_json5(json.dumps(settings))
        deadline = time.monotonic() + timeout_s
        while True:
            try:
                return zenoh.open(config)
            except zenoh.ZError:
                if time.monotonic() >= deadline:
                    raise
            time.sleep(_RETRY_S)


def read_settings(path: str) -> zenoh_settings.Settings:
    """Read a zenoh settings file (JSON5) into a dict; settings missing in the file get zenoh's defaults.

    Raises BusError for a file that is unreadable or invalid.
    """
    if words := os_errors.unreadable(Path(path)):
        raise BusError(f"{path}: {words}")
    with as_bus_error(f"{path}: zenoh cannot read it"):
        return _whole(zenoh.Config.from_file(path))


def with_defaults(settings: zenoh_settings.Settings) -> zenoh_settings.Settings:
    """Return zenoh settings completed with zenoh's defaults, as `read_settings` does for a file."""
    return _whole(zenoh.Config.from_json5(json.dumps(settings)))


def _whole(config: zenoh.Config) -> zenoh_settings.Settings:
    said = {part: json.loads(config.get_json(part)) for part in _PARTS}
    tls = said["transport"]["link"]["tls"]
    tls |= {name: json.loads(config.get_json(f"transport/link/tls/{name}")) for name in TLS_INSTEAD}
    return said


def close_session(session: zenoh.Session) -> None:
    """Close a zenoh session, even a broken one. Raises BusError if zenoh fails."""
    with as_bus_error("could not close the session"):
        session.close()  # type: ignore[no-untyped-call]


class Joined(Generic[_T]):
    """Reads several zenoh channels as one, in rotation. Reading raises zenoh.ZError once one of the channels is closed."""

    def __init__(self, channels: Sequence[handlers.Handler[_T]]) -> None:
        self._channels = deque(channels)

    def try_recv(self) -> _T | None:
        """Return the next item of any channel without waiting; None if no item is there."""
        for _ in range(len(self._channels)):
            item = self._channels[0].try_recv()
            self._channels.rotate(-1)
            if item is not None:
                return item
        return None

    def recv(self) -> _T:
        """Wait for the next item of any channel and return it.

        Polls several channels every POLL_S seconds, because zenoh cannot wait for more than one.
        """
        if len(self._channels) == 1:
            return self._channels[0].recv()
        while (item := self.try_recv()) is None:
            time.sleep(POLL_S)
        return item


class Undeclared(Protocol):
    """zenoh's object for a subscriber, publisher, queryable or liveliness token that can be removed."""

    def undeclare(self) -> object:
        """Remove the object from zenoh: it receives and sends nothing more."""


class Declared:
    """Handle of one or several zenoh objects of a bus session, closed together (contract.Declared)."""

    def __init__(self, bus: "ZenohBus", *declared: Undeclared) -> None:
        self._bus, self._declared = bus, declared
        self._lock = threading.Lock()
        self._closed = False
        bus.declared.add(self)

    def close(self) -> None:
        """Remove all zenoh objects of this handle; a second close does nothing."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._bus.forget(self)
            try:
                for one in self._declared:
                    one.undeclare()
            except zenoh.ZError:
                _log.debug("the declaration ended with its session")


@contextlib.contextmanager
def as_bus_error(complaint: str) -> Iterator[None]:
    """Convert every zenoh error inside the `with` block to a BusError.

    complaint: beginning of the error message; the text of zenoh's error follows.
    """
    try:
        yield
    except BaseException as error:
        if not is_zenohs(error):
            raise
        raise BusError(_complaint(complaint, said(error))) from error


def _complaint(complaint: str, words: str) -> str:
    """Append zenoh's message to the complaint, unless zenoh only repeats the endpoints it could not reach."""
    if words.startswith("Unable to connect to any of"):
        return complaint
    if match := _MESSAGE.search(words):
        words = match["words"].replace('\\"', '"')
        if unknown := _UNKNOWN.fullmatch(words):
            words = f"unknown key {unknown[1]!r}; {nearest(unknown[1], _NAMES.findall(unknown[2]))}"
        words = f"line {match['line']}: {words}"
    return f"{complaint} ({words})"


def said(error: BaseException) -> str:
    """Return the text of a zenoh error without the name and line of its source file."""
    return re.sub(r"\s*\bat /\S+\.rs:\d+\.?", "", str(error)).strip()


def is_zenohs(error: BaseException) -> bool:
    """Return True if an error comes from zenoh, including a panic of its Rust code.

    A Rust panic is not a subclass of Exception, and its class cannot be imported, so its name is compared.
    """
    return isinstance(error, zenoh.ZError) or type(error).__name__ == "PanicException"
