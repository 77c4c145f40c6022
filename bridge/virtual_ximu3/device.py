"""What one device of a ward says as an x-IMU3, and answers, without I/O."""

import hashlib
import json
import math
from collections import deque
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from bridge.framing import ximu3_encode
from bridge.framing.ximu3 import plain
from bridge.wire.messages import CorrectedBatch, DeviceInfo, Quality, SampleBatch

_SAMPLES_HZ = 400.0
_KEPT = 8192  # samples whose accelerations wait for their corrected rates
_TEMPERATURE_EVERY_US = 1_000_000
_ANEW_NS = 1_000_000_000
_MAX_NAME = 31


class VirtualXimu3:
    """One device. What its methods return is a message each, in order.

    corrected: it sends corrected rates with the accelerations of the raw samples, zero where there are none; else raw
    rates. Its time is the device's own, so that a reboot is seen as one.
    """

    def __init__(self, ward: str, device: str, *, corrected: bool) -> None:
        self.name = device[:_MAX_NAME]
        digits = hashlib.sha256(f"{ward}/{device}".encode()).hexdigest()[:16].upper()
        self.serial = "-".join(digits[i : i + 4] for i in range(0, 16, 4))
        self.corrected = corrected
        self.battery_percent, self.charging = math.nan, False
        self._firmware = "unknown"
        self._rate_hz = 0.0
        self._time_us = 0
        self._temperature_us: int | None = None
        self._quality: Quality | None = None
        self._accels: deque[tuple[int, int, NDArray[np.float32]]] = deque()  # boot, first number, (n, 3)
        self._kept = 0
        self._sent = (0, 0, 0)  # boot, next number, time of the latest batch

    def took_raw(self, batch: SampleBatch) -> list[bytes]:
        """A batch of raw samples came."""
        if batch.accel is not None and self.corrected:
            self._keep(batch.boot, batch.sequence, batch.accel)
        time_us = _time_us(batch.ticks, batch.tick_period_s)
        messages = self._temperature(batch, int(time_us[-1]))
        if self.corrected:
            return messages
        self._time_us = int(time_us[-1])
        return messages + ximu3_encode.inertial(time_us, batch.gyro, batch.accel)

    def took_corrected(self, batch: CorrectedBatch) -> list[bytes]:
        """A batch of corrected samples came; what an estimator repeats after a restart is left out."""
        new = self._new_part(batch)
        if new is None or not self.corrected:
            return []
        time_us = _time_us(new.ticks, new.tick_period_s)
        self._time_us = int(time_us[-1])
        messages = ximu3_encode.inertial(time_us, new.rate, self._accel(new))
        if new.quality is not self._quality:
            self._quality = new.quality
            words = f"quality {new.quality.name.lower().replace('_', ' ')}"
            messages.insert(0, ximu3_encode.notification(int(time_us[0]), words))
        return messages

    def took_info(self, info: DeviceInfo) -> list[bytes]:
        """What the bridge says of the device came."""
        self._firmware, self._rate_hz = f"{info.model} {info.firmware}".strip() or "unknown", info.rate_hz
        self.battery_percent, self.charging = info.battery_percent, info.charging
        if math.isnan(self.battery_percent):
            return []
        return [ximu3_encode.battery(self._time_us, self.battery_percent, charging=self.charging)]

    def answer(self, line: bytes, interface: str) -> bytes:
        """The answer to a command, which came by `interface`; empty where it is none."""
        try:
            command = msgspec.json.decode(line, type=dict[str, Any])
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return b""
        if len(command) != 1:
            return b""
        ((key, value),) = command.items()
        return json.dumps({key: self._answer(plain(key), value, interface)}, separators=(",", ":")).encode() + b"\n"

    def _answer(self, key: str, value: object, interface: str) -> object:
        if key == "ping":
            return {"interface": interface, "name": self.name, "sn": self.serial}
        if key == "apply":
            return None
        settings: dict[str, object] = {
            "devicename": self.name,
            "serialnumber": self.serial,
            "firmwareversion": self._firmware,
            "hardwareversion": "truerate",
            "binarymodeenabled": True,
            "inertialmessageratedivisor": max(1, round(_SAMPLES_HZ / self._rate_hz)) if self._rate_hz else 8,
            "gyroscopeoffsetcorrectionenabled": self.corrected,
            "axesalignment": 0,
        }
        if key not in settings:
            return {"error": "Unknown command"}
        return settings[key] if value is None else {"error": "Read-only"}

    def _temperature(self, batch: SampleBatch, time_us: int) -> list[bytes]:
        since_us = None if self._temperature_us is None else time_us - self._temperature_us
        if batch.temperature_c is None or (since_us is not None and 0 <= since_us < _TEMPERATURE_EVERY_US):
            return []
        self._temperature_us = time_us
        return [ximu3_encode.temperature(time_us, float(batch.temperature_c[-1]))]

    def _new_part(self, batch: CorrectedBatch) -> CorrectedBatch | None:
        """Without the samples that were sent. Low numbers at a later time: the device began anew under the same boot."""
        boot, following, last_ns = self._sent
        start_ns, end = batch.start_time_ns, batch.sequence + len(batch)
        if boot != batch.boot or (end <= following and start_ns > last_ns + _ANEW_NS):
            following = batch.sequence
        known = max(0, following - batch.sequence)
        if known >= len(batch):
            return None
        self._sent = batch.boot, end, start_ns
        return batch.after(known) if known else batch

    def _keep(self, boot: int, first: int, accel: NDArray[np.float32]) -> None:
        self._accels.append((boot, first, accel))
        self._kept += len(accel)
        while self._kept > _KEPT and len(self._accels) > 1:
            self._kept -= len(self._accels.popleft()[2])

    def _accel(self, batch: CorrectedBatch) -> NDArray[np.float32]:
        """(n, 3) m/s² of the same samples."""
        found = np.zeros((len(batch), 3), np.float32)
        for boot, first, accel in self._accels:
            low = max(first, batch.sequence)
            high = min(first + len(accel), batch.sequence + len(batch))
            if boot == batch.boot and low < high:
                found[low - batch.sequence : high - batch.sequence] = accel[low - first : high - first]
        return found


def _time_us(ticks: NDArray[np.uint64], tick_period_s: float) -> NDArray[np.uint64]:
    return np.asarray(np.rint(ticks * (tick_period_s * 1e6)), np.uint64)
