"""Messages in a file, for subscribers without zenoh: length of key and of payload (u32, little-endian), key, payload; and so on.

    python -m tests.other_languages.dump WARD FILE [SECONDS] [ROUTER]

writes what is published in a ward.
"""

import struct
import sys
from collections.abc import Iterable
from pathlib import Path

from bridge.bus.contract import Message
from bridge.bus.zenoh_bus import ZenohBus
from bridge.config.schema import LOCAL
from bridge.wire import keys

KINDS = ("corrected", "revision", "status", "@windowed")


def pack(messages: Iterable[Message]) -> bytes:
    """The file of these messages."""
    return b"".join(
        struct.pack("<II", len(key.encode()), len(payload)) + key.encode() + payload for key, payload in messages
    )


def main(ward: str, file: str, seconds: str = "10", router: str = LOCAL) -> None:
    """Listen and write."""
    with ZenohBus([router]) as bus, Path(file).open("wb") as out:
        subscriptions = [bus.subscribe(keys.pattern(ward, kind), history=kind not in keys.BY_NAME) for kind in KINDS]
        for _ in range(round(float(seconds) * 10)):
            out.writelines(pack(subscription.drain(4096, 0.1 / len(KINDS))) for subscription in subscriptions)


if __name__ == "__main__":
    main(*sys.argv[1:])
