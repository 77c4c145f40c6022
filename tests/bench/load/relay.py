"""What an estimator is held against. A bare relay: the bytes of raw/... put on corrected/... unread.

`recode`: each message is read, the rates of a round are corrected together, and each message is written anew; nothing is checked
or learnt. `python -m tests.bench.load.relay ENDPOINT [recode]`
"""

import sys
from collections.abc import Callable, Sequence

import numpy as np

from bridge.bus.contract import Message, Publisher
from bridge.bus.zenoh_bus import ZenohBus
from bridge.runtime.signals import stopped_by_signal
from bridge.wire import columns_pb2 as columns
from bridge.wire import keys
from bridge.wire.messages import VERSION, Quality
from estimator.geometry.gyro_model import corrected
from estimator.service.device import CACHES
from tests.bench.load.stream import WARD

_THREE = np.ones(3, "<f4").tobytes()
Put = Callable[[bytes], None]


class Recoded:
    """The publisher of one device, and the message whose constant fields all of its messages share."""

    def __init__(self, device: str, boot: int, put: Put) -> None:
        self.put = put
        self.message = columns.CorrectedBatch(
            version=VERSION,
            device=device,
            boot=boot,
            quality=int(Quality.NONE),
            noise_std=_THREE,
            bias_std=_THREE,
            scale_std=_THREE,
            cross_std=_THREE,
            bias=_THREE,
        )


def recode(messages: Sequence[Message], known: dict[str, Recoded], publisher: Callable[[str], Publisher]) -> None:
    """A round of messages."""
    raws = [columns.SampleBatch.FromString(payload) for _, payload in messages]
    reading = np.frombuffer(b"".join([raw.gyro for raw in raws]), "<f4").reshape(-1, 3).astype(float)
    n = len(reading)
    rate = corrected(reading, np.tile(np.eye(3), (n, 1, 1)), np.full((n, 3), 0.01)).astype("<f4").tobytes()
    begin = 0
    for (key, _), raw in zip(messages, raws, strict=True):
        device = known.get(key)
        if device is None:
            device = known[key] = Recoded(raw.device, raw.boot, publisher(key).put)
        message, end = device.message, begin + len(raw.gyro)
        message.sequence = raw.sequence
        message.start_time_ns = raw.start_time_ns
        message.tick_period_s = raw.tick_period_s
        message.clock_rate = raw.clock_rate
        message.ticks = raw.ticks
        message.rate = rate[begin:end]
        begin = end
        device.put(message.SerializeToString())


def main(endpoint: str, how: str = "") -> None:
    """Until a signal comes."""
    with stopped_by_signal() as stop, ZenohBus([endpoint]) as bus:
        raw = bus.subscribe(keys.pattern(WARD, "raw"), history=True)
        puts: dict[str, Put] = {}
        known: dict[str, Recoded] = {}

        def publisher(key: str) -> Publisher:
            device = keys.parse(key).device
            return bus.publisher(keys.build(WARD, "corrected", device=device), cache=CACHES["corrected"])

        while not stop.is_set():
            messages = raw.drain(512, 0.05)
            if how and messages:
                recode(messages, known, publisher)
                continue
            for key, payload in messages:
                put = puts.get(key)
                if put is None:
                    put = puts[key] = publisher(key).put
                put(payload)


if __name__ == "__main__":
    main(*sys.argv[1:])
