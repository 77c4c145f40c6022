"""MQTT messages as JSON: mean rates of each device, and its status. Rates in rad/s, times in ISO 8601. Pure."""

from datetime import UTC, datetime

import msgspec
import numpy as np
from numpy.typing import NDArray

from bridge.reasons.catalogue import sentences_as_json
from bridge.wire.keys import boot_id
from bridge.wire.messages import Status, WindowBatch, combined_std

#: number of windows a second in a WindowBatch
_WINDOWS_HZ = 10


class Decimation:
    """Averager that reduces each device's windows (mean rates over 0.1 s, rad/s) to `hz` JSON messages a second."""

    def __init__(self, hz: int) -> None:
        self._most = _WINDOWS_HZ // hz
        self._held: dict[str, list[tuple[WindowBatch, int]]] = {}

    def take(self, batch: WindowBatch) -> list[bytes]:
        """Add a batch of windows, and return the JSON messages that are complete; repeated windows are left out.

        docs/mqtt.md, "Rates", lists the keys of a message; rates and biases are in rad/s.
        """
        found = list[bytes]()
        held = self._held.setdefault(batch.device, [])
        for i in range(len(batch)):
            if held and held[-1][0].boot != batch.boot:
                held.clear()
            # Two estimators may send the same windows while one takes a device over.
            if held and batch.sequences[i] <= held[-1][0].sequences[held[-1][1]]:
                continue
            if len(held) >= self._most:
                held.clear()
            held.append((batch, i))
            if len(held) == self._most:
                found.append(_rate_json(held))
        return found

    def leave(self, device: str) -> None:
        """Forget the windows held for a device."""
        self._held.pop(device, None)


def _rate_json(windows: list[tuple[WindowBatch, int]]) -> bytes:
    """One message of consecutive windows: mean over all their samples, with its standard deviation."""
    last, at = windows[-1]
    samples = np.array([batch.samples[i] for batch, i in windows], float)
    mean = np.average([batch.rate_mean[i] for batch, i in windows], axis=0, weights=samples)
    noise = last.noise_std / np.sqrt(samples.sum())
    std = combined_std(mean[None], noise, last.bias_std, last.scale_std, last.cross_std, last.flicker_std)[0]
    return msgspec.json.encode(
        {
            "device": last.device,
            "boot": boot_id(last.boot),
            "sequence": int(last.sequences[at]),
            "time": _iso(int(last.times_ns[at])),
            "quality": last.quality.name,
            "samples": int(samples.sum()),
            "flags": int(np.bitwise_or.reduce([batch.flags[i] for batch, i in windows])),
            "rate": _digits(mean),
            "rate_std": _digits(std),
            "rate_min": _digits(np.min([batch.rate_min[i] for batch, i in windows], axis=0)),
            "rate_max": _digits(np.max([batch.rate_max[i] for batch, i in windows], axis=0)),
            "bias": _digits(last.bias),
            "bias_std": _digits(last.bias_std),
        }
    )


def summary(status: Status) -> tuple[object, ...]:
    """Return the parts of a status that trigger a new message when they change.

    The parts are boot, state, quality, reason and calibration.
    """
    return status.boot, status.state, status.quality, status.reason, status.calibration


def status_json(status: Status) -> bytes:
    """Encode a status as JSON, with its reasons as codes and as text; docs/mqtt.md, "Statuses", lists the keys.

    The bias and its standard deviation are in rad/s, sensor frame.
    """
    return msgspec.json.encode(
        {
            "device": status.device,
            "boot": boot_id(status.boot),
            "time": _iso(status.time_ns),
            "state": status.state.name,
            "quality": status.quality.name,
            "reason": sentences_as_json(status.reason),
            "calibration": status.calibration,
            "bias": list(status.bias),
            "bias_std": list(status.bias_std),
        }
    )


def _digits(vector: NDArray[np.floating]) -> list[float]:
    """Seven significant digits: those of the wire's float32."""
    return [float(f"{value:.7g}") for value in vector]


def _iso(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns * 1e-9, UTC).isoformat(timespec="milliseconds")
