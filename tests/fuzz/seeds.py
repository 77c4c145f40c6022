"""What each protocol looks like when all is well: whole messages, to be damaged."""

import numpy as np

from bridge.framing.deframer import frame
from bridge.framing.packets import Data, Hello, encode_data, encode_hello

_ONES = np.ones((3, 3), np.float32)


def _native(sequence: int) -> bytes:
    ticks = (np.arange(3) * 9600 + sequence).astype(np.uint32)
    return frame(encode_data(Data(1, sequence, ticks, _ONES, 9 * _ONES, 20 * _ONES[:, 0])))


# A list of messages for each driver that has a decoder.
SEEDS: dict[str, list[bytes]] = {
    "native": [frame(encode_hello(Hello(1, 1e-6, 104.0, 4.3, True, True, "model", "1.2"))), _native(0), _native(3)],
}
