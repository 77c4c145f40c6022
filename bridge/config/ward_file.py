"""Ward file of a running program: reloads the file when it changes, and rejects the whole file if any part is invalid.

Each program watches its own file, so a reload needs no command and no access right. On the bus, each program reports
the hash of the file content that it read last, and which settings took effect. `truerate reload` and `truerate doctor`
query these reports.
"""

import hashlib
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

from msgspec import Struct
from msgspec.structs import fields

from bridge.bus.contract import Bus, Declared
from bridge.bus.routers import Routers
from bridge.config.schema import Root
from bridge.pki.member import Member, Role
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentence
from bridge.runtime.regular_file import content
from bridge.toml.loader import ConfigError, load
from bridge.wire import keys
from bridge.wire.codec import encode_reply
from bridge.wire.messages import CommandReply

R = TypeVar("R", bound=Root)

#: seconds for which a changed file must stay as it is before it is read, as an editor may still be writing it
SETTLED_S = 0.5
#: most names listed of what was added, removed or changed in one setting
_NAMED = 12
_log = logging.getLogger(__name__)


class WardFile(Generic[R]):
    """Ward file of one running program, which is read again when it changes.

    root: content in force. report: for the content read last, the settings that took effect, or why it was rejected.
    kind: type of the content, Root or a subclass. uses: tables that the program uses in addition to `ward` and `bus`.
    live: settings that take effect without a restart, such as `bridge.devices`.
    check: called with a new content; raises ConfigError if the program could not start with it.
    settled_s: seconds for which a changed file must stay unchanged before it is read.
    The constructor raises ConfigError if the file is invalid.
    """

    def __init__(
        self,
        path: Path,
        kind: type[R],
        uses: Sequence[str],
        live: Sequence[str],
        check: Callable[[R], object] = lambda _: None,
        settled_s: float = SETTLED_S,
    ) -> None:
        self.path, self._kind, self._check, self._settled_s = path, kind, check, settled_s
        self._uses, self._live = ("ward", "bus", *uses), frozenset(live)
        self._read = self._seen = stamp_of(path)  # before reading: a change during the read is then read again
        self._seen_s = time.monotonic()
        digest = digest_of(path)
        self.root = self._started = self._loaded()
        #: digest of the content read last, whether all of it is in force, and what took effect
        self.report = CommandReply(digest, accepted=True, message=(Code.WARD_FILE_IN_FORCE(),))

    def look(self, now: float) -> R | None:
        """Return the new content if the file has changed and is valid, else None. now: seconds of a monotonic clock.

        Call it about once a second. `report` and the log state which settings took effect, or why the file was
        rejected.
        """
        stamp = stamp_of(self.path)
        if stamp != self._seen:
            self._seen, self._seen_s = stamp, now
        if stamp == self._read or now - self._seen_s < self._settled_s:
            return None
        self._read, digest = stamp, digest_of(self.path)
        try:
            root = self._loaded()
        except ConfigError as error:
            self._tell(logging.ERROR, digest, Code.WARD_FILE_REFUSED(error=error))
            return None
        changed = differences(self.root, root)
        taken = [f"{name}{what}" for name, what in changed.items() if name in self._live]
        waits = [name for name in differences(self._started, root) if self._is_ours(name) and name not in self._live]
        said = [Code.WARD_FILE_TAKEN(settings="; ".join(taken))] if taken else []
        said += [Code.WARD_FILE_NEEDS_RESTART(settings=", ".join(waits))] if waits else []
        said = said or [Code.WARD_FILE_IN_FORCE()]
        self._tell(logging.WARNING if waits else logging.INFO, digest, *said)
        self.root = root
        return root

    def answer(self, bus: Bus, routers: Routers, role: Role, name: str) -> Declared:
        """Answer queries on the bus about this program's ward file with `report`. Close the returned handle to stop.

        `truerate reload` and `truerate doctor` send these queries.
        routers: gives the certificate, whose role and name are part of the query key. role, name: used instead if there
        is no certificate. Raises ValueError if the certificate is unreadable or names no role.
        """
        member = member_of(routers) or Member(role, name)
        key = keys.build(self._started.ward, "config", role=member.role.value, name=member.name)
        return bus.answer(key, lambda _key, _payload, reply: reply(encode_reply(self.report)))

    def _loaded(self) -> R:
        root = load(self.path, self._kind)
        self._check(root)
        return root

    def _is_ours(self, name: str) -> bool:
        return name.partition(".")[0] in self._uses

    def _tell(self, level: int, digest: str, *said: Sentence) -> None:
        _log.log(level, "%s", english(*said))
        self.report = CommandReply(digest, accepted=level < logging.WARNING, message=said)


def member_of(routers: Routers) -> Member | None:
    """Return the member (role and name) in the certificate that is used with these routers; None without a certificate.

    Raises ValueError if the certificate is unreadable or names no role.
    """
    if routers.identity is None:
        return None
    from bridge.pki.certificate_checks import member_of as certified  # noqa: PLC0415 - as in bridge.bus.routers

    return certified(routers.identity)


def digest_of(path: Path) -> str:
    """Return the first 32 hexadecimal digits of the SHA-256 hash of a file's content; "" if the file cannot be read."""
    try:
        return hashlib.sha256(content(path)).hexdigest()[:32]
    except OSError:
        return ""


def differences(old: Struct, new: Struct, within: str = "") -> dict[str, str]:
    """Return the settings that differ between two contents of a ward file, by dotted name, such as `bridge.devices`.

    Each value lists the ids added (+), removed (-) and changed (~) in a list or table; it is "" for a single value.
    within: prefix of each name, for an inner table, such as `bridge.`.
    """
    found: dict[str, str] = {}
    for field in fields(type(old)):
        before, after = getattr(old, field.name), getattr(new, field.name)
        name = f"{within}{field.name}"
        if before == after:
            continue
        if isinstance(before, Struct) and type(before) is type(after):
            found |= differences(before, after, f"{name}.")
        else:
            found[name] = _entries(_named(before), _named(after))
    return found


def _entries(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Describe how two tables of entries differ; empty where the setting is a single value."""
    marks = [f"+{name}" for name in after.keys() - before.keys()] + [
        f"-{name}" for name in before.keys() - after.keys()
    ]
    marks += [f"~{name}" for name in before.keys() & after.keys() if before[name] != after[name]]
    shown = sorted(marks, key=lambda mark: mark[1:])
    more = [f"… {len(shown) - _NAMED}"] if len(shown) > _NAMED else []
    return f" {' '.join([*shown[:_NAMED], *more])}" if shown else ""


def _named(value: object) -> Mapping[str, Any]:
    """Return the entries of a setting by id or name. Values are compared, never shown: they may hold a password's hash."""
    if isinstance(value, Mapping):
        return value
    if isinstance(value, tuple):
        return {str(getattr(one, "id", getattr(one, "name", one))): one for one in value}
    return {}


def stamp_of(path: Path) -> tuple[int, int, int] | None:
    """Return (modification time, size, inode) of a file, to detect that it has changed.

    Modification time: ns since the Unix epoch. Size: bytes. None if the file is missing or inaccessible.
    """
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
