"""Many devices on a bus, raw and corrected, as a bridge and an estimator publish them; what was sent when is known."""

import threading
import time
import zlib
from typing import Self

import numpy as np

from bridge.bus.contract import Bus
from bridge.wire import codec, keys
from bridge.wire.messages import BootCause, CorrectedBatch, DeviceInfo, Quality, SampleBatch, State, Status
from tests.sentences import free

WARD, RATE_HZ = "ward", 104.0
TICK_S, STEP = 1e-6, 9615
#: readings by sequence number, over and over; in counts, as devices send them
_GYRO = (np.round(np.random.default_rng(1).normal(0, 100, (4096, 3))) * 1.065e-3).astype(np.float32)
_ACCEL = (np.round(np.random.default_rng(2).normal(0, 800, (4096, 3))) * 1.2e-2).astype(np.float32)
_THREE = np.full(3, 0.01, np.float32)


def samples(device: str, sequence: int, n: int, time_ns: int, boot: int = 7) -> SampleBatch:
    """A batch whose first sample was at time_ns; the same device and number have the same readings."""
    rows = (zlib.crc32(device.encode()) + np.arange(sequence, sequence + n)) % len(_GYRO)
    return SampleBatch(
        device=device,
        boot=boot,
        sequence=sequence,
        receive_time_ns=time_ns + n * STEP * 1000,
        start_time_ns=time_ns,
        tick_period_s=TICK_S,
        clock_rate=1.0,
        ticks=np.arange(sequence + 1, sequence + n + 1, dtype=np.uint64) * np.uint64(STEP),
        gyro=_GYRO[rows],
        accel=_ACCEL[rows],
        temperature_c=np.full(n, 30.5, np.float32),
        flags=np.zeros(n, np.uint32),
        bridge="bridge-1",
    )


def corrected(of: SampleBatch) -> CorrectedBatch:
    """What an estimator makes of a batch: here, twice the rate."""
    return CorrectedBatch(
        of.device, of.boot, of.sequence, of.start_time_ns, of.tick_period_s, of.clock_rate, of.ticks,
        2 * of.gyro, of.flags, Quality.GOOD, _THREE, _THREE, _THREE, _THREE, "0123456789abcdef", _THREE,
    )  # fmt: skip


def info(device: str, time_ns: int, boot: int = 7) -> DeviceInfo:
    return DeviceInfo(
        device, "bridge-1", boot, BootCause.POWER_UP, "lsm9ds1", "1.0", "native", "/dev/x", RATE_HZ, RATE_HZ, 8.7, True,
        True, time_ns,
    )  # fmt: skip


def status(device: str, time_ns: int, boot: int = 7) -> Status:
    three = (0.01, 0.01, 0.01)
    return Status(
        device, boot, time_ns, State.TRACKING, Quality.GOOD, free("tracking"), 1.0, (0, 1, 2), three, three, (1.0, 1.0, 1.0),
        "0123456789abcdef", time_ns, 1.0, 30.5, RATE_HZ, 1, 1,
    )  # fmt: skip


class Crowd:
    """Publishes for so many devices every period_s, in a thread, from `with` to its end."""

    def __init__(self, bus: Bus, devices: int, period_s: float = 0.05) -> None:
        self.names = [f"device-{number:03d}" for number in range(devices)]
        self.sent: list[tuple[float, int]] = []  # monotonic time, and samples of each device that were sent by then
        self._period_s = period_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._raw, self._info, self._corrected, self._status = (
            [
                bus.publisher(keys.build(WARD, what, device=name, **({"bridge": "bridge-1"} if bridge else {})), cache=cache)
                for name in self.names
            ]
            for what, bridge, cache in (
                ("raw", True, 300), ("info", True, 1), ("corrected", False, 300), ("status", False, 1),
            )
        )  # fmt: skip

    def sent_by(self, moment_s: float) -> int:
        """Samples of each device that had been sent at a moment."""
        return max((n for sent_s, n in self.sent if sent_s <= moment_s), default=0)

    def _run(self) -> None:
        begin_s, begin_ns, sequence, told = time.monotonic(), time.time_ns(), 0, 0
        while not self._stop.is_set():
            due = int((time.monotonic() - begin_s) * RATE_HZ)
            n = min(due - sequence, 200)
            if n > 0:
                time_ns = begin_ns + sequence * STEP * 1000
                for name, raw, out in zip(self.names, self._raw, self._corrected, strict=True):
                    batch = samples(name, sequence, n, time_ns)
                    raw.put(codec.encode_samples(batch))
                    out.put(codec.encode_corrected(corrected(batch)))
                sequence += n
                self.sent.append((time.monotonic(), sequence))
            if time.monotonic() - begin_s >= told:
                told += 1
                for name, about, state in zip(self.names, self._info, self._status, strict=True):
                    about.put(codec.encode_info(info(name, time.time_ns())))
                    state.put(codec.encode_status(status(name, time.time_ns())))
            self._stop.wait(self._period_s)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
