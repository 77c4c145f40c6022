"""What an estimator is held against. A bare relay: the bytes of raw/... put on corrected/... unread.

`recode`: each message read, its rates corrected, those of a round together, and written anew; nothing is checked, nothing learnt.
`filter`: and a step of filterpy's Kalman filter, as it comes, once a second of each device: what a bias that drifts asks for. An
estimator of these messages in Python cannot do with less. `python -m tests.bench.load.relay ENDPOINT [recode|filter]`
"""

import sys
from collections.abc import Callable, Sequence

import numpy as np
from filterpy.kalman import KalmanFilter

from bridge.bus.contract import Message, Publisher
from bridge.bus.zenoh_bus import ZenohBus
from bridge.process import stopped_by_signal
from bridge.wire import columns_pb2 as columns
from bridge.wire import keys
from bridge.wire.messages import VERSION, Quality
from estimator.gyro import corrected
from estimator.service.device import CACHES
from tests.bench.load.stream import WARD

_THREE = np.ones(3, "<f4").tobytes()
#: states of a bias and its slope by temperature, and what a rest measures of them
_STATES, _MEASURED = 6, 3
_SECOND_NS, _SAMPLE_BYTES = 1_000_000_000, 12
Put = Callable[[bytes], None]


class Recoded:
    """Puts of one device, the message that all of its have in common, and its filter."""

    def __init__(self, device: str, boot: int, put: Put) -> None:
        self.put = put
        self.filter = KalmanFilter(_STATES, _MEASURED)
        self.filter.H = np.eye(_MEASURED, _STATES)
        self.due_ns = 0
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


def recode(
    messages: Sequence[Message], known: dict[str, Recoded], publisher: Callable[[str], Publisher], *, filters: bool
) -> None:
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
        if filters and raw.start_time_ns >= device.due_ns:
            device.due_ns = raw.start_time_ns + _SECOND_NS
            device.filter.predict()
            device.filter.update(reading[begin // _SAMPLE_BYTES - 1])


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
                recode(messages, known, publisher, filters=how == "filter")
                continue
            for key, payload in messages:
                put = puts.get(key)
                if put is None:
                    put = puts[key] = publisher(key).put
                put(payload)


if __name__ == "__main__":
    main(*sys.argv[1:])
