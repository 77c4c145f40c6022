"""Values of a BLE device's characteristics in one byte stream, without I/O: one value in each COBS frame.

    payload of a frame = number of the characteristic, 16 bits, little-endian; value

A frame sent to the device writes the value; without a value, it requests to read the characteristic. The frames can be
captured in a file, and decoded from any point on.
"""

from bridge.framing.cobs_frames import Deframer, frame
from bridge.wire.refusal import Tally

_NUMBER_BYTES = 2


def encode(number: int, value: bytes = b"") -> bytes:
    """Encode a BLE characteristic's 16-bit number and value as a COBS frame; without value, the request to read it."""
    return frame(number.to_bytes(_NUMBER_BYTES, "little") + value)


class GattValues:
    """Decoder of BLE characteristic values in a byte stream of COBS frames; memory is bounded.

    faults: number of damaged frames, by label.
    """

    def __init__(self, faults: Tally) -> None:
        self._deframer = Deframer()
        self._deframer.faults = faults

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Decode received bytes; return (characteristic number, value) of each frame that they complete, in order."""
        return [
            (int.from_bytes(payload[:_NUMBER_BYTES], "little"), payload[_NUMBER_BYTES:])
            for payload in self._deframer.feed(data)
        ]


def decode(data: bytes) -> list[tuple[int, bytes]]:
    """Return (characteristic number, value) of each frame in these bytes, which contain whole frames only."""
    return GattValues(Tally()).feed(data)
