"""Enrolled devices of a ward: the [devices] table, and an optional separate file that may change at any time."""

from collections.abc import Iterable

from msgspec import Struct

from bridge.runtime import os_errors
from bridge.runtime.regular_file import content
from bridge.wire.keys import check_id
from bridge.wire.refusal import Refusal


class Enrolment(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The devices to accept. Without this table, every device is accepted."""

    #: device ids: `wrist-01` by any bridge, `bridge-1/wrist-01` by that bridge only
    enrolled: tuple[str, ...] = ()
    #: file with more device ids, one per line, `#` begins a comment; read again when it changes
    file: str = ""

    def __post_init__(self) -> None:
        if not self.enrolled and not self.file:
            raise ValueError(
                'give enrolled = ["wrist-01", …] or a file of ids, or remove [devices] to accept every device'
            )
        places(self.enrolled)
        if self.file:
            self.read()

    def read(self) -> dict[str, str]:
        """Return the enrolled devices of the table and its file.

        The result has bridge ids by device id; "" if any bridge may send the device.
        The file is read again at each call. Raises ValueError for an unreadable or invalid file.
        """
        if not self.file:
            return places(self.enrolled)
        try:
            text = content(self.file).decode("utf-8-sig")
            lines = (line.partition("#")[0].strip() for line in text.splitlines())
            return places((*self.enrolled, *filter(None, lines)))
        except UnicodeDecodeError:
            raise ValueError(f"file {self.file!r} is not UTF-8 text: save it as UTF-8 in your editor") from None
        except (OSError, ValueError) as error:
            raise ValueError(
                f"file {self.file!r}: {os_errors.why(error) if isinstance(error, OSError) else error}"
            ) from None


def places(entries: Iterable[str]) -> dict[str, str]:
    """Parse entries `DEVICE` or `BRIDGE/DEVICE` to bridge ids by device id; "" stands for any bridge.

    Raises ValueError for an invalid id, and for a device with two different bridges.
    """
    found: dict[str, str] = {}
    for entry in entries:
        bridge, _, device = entry.rpartition("/")
        try:
            check_id(device, "an enrolled device")
            if bridge or entry.startswith("/"):
                check_id(bridge, "the bridge of an enrolled device")
        except Refusal as refusal:
            raise ValueError(refusal.detail) from None
        if found.setdefault(device, bridge) != bridge:
            raise ValueError(
                f"{device!r} is enrolled twice, for {found[device] or 'any bridge'} and for {bridge or 'any bridge'}: remove one"
            )
    return found
