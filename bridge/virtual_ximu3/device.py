"""Messages and command answers of one device of a ward, shown as an x-IMU3. Pure."""

import hashlib
import json
import math
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
_MAX_NAME = 31


class VirtualXimu3:
    """One device shown as an x-IMU3. Its methods return messages, in order.

    corrected: send corrected rates with the accelerations of the raw samples (zero if there are none); otherwise raw
    rates. The time is the device's own, so that a reader recognises a reboot.
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
        self._temperature_us = -_TEMPERATURE_EVERY_US
        self._quality: Quality | None = None
        self._boot = 0  # boot of the accelerations
        self._numbers, self._accels = np.zeros(0, np.int64), np.zeros((0, 3), np.float32)
        self._sent = (0, 0)  # boot and next sequence number

    def took_raw(self, batch: SampleBatch) -> list[bytes]:
        """Handle a batch of raw samples."""
        time_us = _time_us(batch.ticks, batch.tick_period_s)
        messages = self._temperature(batch, int(time_us[-1]))
        if not self.corrected:
            self._time_us = int(time_us[-1])
            return messages + ximu3_encode.inertial(time_us, batch.gyro, batch.accel)
        if batch.accel is not None:
            if batch.boot != self._boot:
                self._boot, self._numbers, self._accels = batch.boot, self._numbers[:0], self._accels[:0]
            number = batch.sequence + np.arange(len(batch))
            self._numbers = np.concatenate([self._numbers, number])[-_KEPT:]
            self._accels = np.concatenate([self._accels, batch.accel])[-_KEPT:]
        return messages

    def took_corrected(self, batch: CorrectedBatch) -> list[bytes]:
        """Handle a batch of corrected samples; samples that an estimator repeats after a restart are left out."""
        boot, following = self._sent
        known = max(0, following - batch.sequence) if boot == batch.boot else 0
        if known >= len(batch) or not self.corrected:
            return []
        self._sent = batch.boot, batch.sequence + len(batch)
        new = batch.after(known) if known else batch
        time_us = _time_us(new.ticks, new.tick_period_s)
        self._time_us = int(time_us[-1])
        messages = ximu3_encode.inertial(time_us, new.rate, self._accel(new))
        if new.quality is not self._quality:
            self._quality = new.quality
            words = f"quality {new.quality.name.lower().replace('_', ' ')}"
            messages.insert(0, ximu3_encode.notification(int(time_us[0]), words))
        return messages

    def took_info(self, info: DeviceInfo) -> list[bytes]:
        """Handle the bridge's DeviceInfo."""
        self._firmware, self._rate_hz = f"{info.model} {info.firmware}".strip() or "unknown", info.rate_hz
        self.battery_percent, self.charging = info.battery_percent, info.charging
        if math.isnan(self.battery_percent):
            return []
        return [ximu3_encode.battery(self._time_us, self.battery_percent, charging=self.charging)]

    def answer(self, line: bytes) -> bytes:
        """Answer a command; empty if the line is not a command."""
        try:
            command = msgspec.json.decode(line, type=dict[str, Any])
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return b""
        if len(command) != 1:
            return b""
        ((key, value),) = command.items()
        return json.dumps({key: self._answer(plain(key), value)}, separators=(",", ":")).encode() + b"\n"

    def _answer(self, key: str, value: object) -> object:
        if key == "ping":
            return {"interface": "UDP", "name": self.name, "sn": self.serial}
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
        if batch.temperature_c is None or 0 <= time_us - self._temperature_us < _TEMPERATURE_EVERY_US:
            return []
        self._temperature_us = time_us
        return [ximu3_encode.temperature(time_us, float(batch.temperature_c[-1]))]

    def _accel(self, batch: CorrectedBatch) -> NDArray[np.float32]:
        """Accelerations (n, 3), m/s², of the same samples; zero where missing."""
        found = np.zeros((len(batch), 3), np.float32)
        number = batch.sequence + np.arange(len(batch))
        if batch.boot == self._boot:
            _, at, where = np.intersect1d(number, self._numbers, assume_unique=False, return_indices=True)
            found[at] = self._accels[where]
        return found


def _time_us(ticks: NDArray[np.uint64], tick_period_s: float) -> NDArray[np.uint64]:
    return np.asarray(np.rint(ticks * (tick_period_s * 1e6)), np.uint64)
