"""Enrolment: the table [devices] of the ward file, which lists the devices to accept."""

from collections.abc import Iterable

from msgspec import Struct

from bridge.wire.keys import check_id
from bridge.wire.refusal import Refusal


class Enrolment(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Table [devices] of the ward file: the devices to accept. Without this table, every device is accepted.

    Raises ValueError for an empty list, an invalid id, and a device listed with two different bridges.
    """

    #: device ids: `wrist-01` by any bridge, `bridge-1/wrist-01` by that bridge only
    enrolled: tuple[str, ...]

    def __post_init__(self) -> None:
        if not self.enrolled:
            raise ValueError(
                'enrolled is empty: give enrolled = ["wrist-01", …], or remove [devices] to accept every device'
            )
        places(self.enrolled)

    @property
    def places(self) -> dict[str, str]:
        """Bridge id of each enrolled device, by device id; "" if any bridge may send the device."""
        return places(self.enrolled)


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
                f"{device!r} is enrolled twice, for {found[device] or 'any bridge'} and for {bridge or 'any bridge'}: remove "
                "one of the two entries"
            )
    return found
