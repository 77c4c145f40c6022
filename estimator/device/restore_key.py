"""Restore key: hardware, firmware, range and rate under which a stored calibration applies to a device."""

from collections.abc import Mapping
from typing import Any

from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire.messages import Calibration, DeviceInfo
from estimator.device.same_rate import same_rate


def restore_key(of: Calibration | DeviceInfo) -> dict[str, str | float]:
    """Return the restore key of a calibration or device: model, firmware, gyro_range in rad/s, rate_hz."""
    return {"model": of.model, "firmware": of.firmware, "gyro_range": of.gyro_range, "rate_hz": of.rate_hz}


def differing(then: Mapping[str, Any], info: DeviceInfo) -> dict[str, str | float]:
    """Return the entries of a stored restore key that differ from the device's, with the device's present values.

    then: the stored key. The output data rate is compared only for a device without a clock, because only then does the
    scale depend on it.
    """
    now = restore_key(info)
    if info.has_clock or same_rate(then["rate_hz"], info.rate_hz):
        del now["rate_hz"]
    return {name: value for name, value in now.items() if value != then[name]}


def changed(calibration: Calibration, info: DeviceInfo, *, within_boot: bool = False) -> Sentences:
    """Return the reasons why a calibration does not apply to the device as it is now; empty when it applies.

    within_boot: values unknown in the calibration or in `info` do not count as changed.
    """
    then = restore_key(calibration)
    other = differing(then, info)
    if within_boot:
        other = {name: now for name, now in other.items() if now and then[name]}
    said = tuple(_changed(name, _said(now), _said(then[name])) for name, now in other.items())
    return (*said, Code.CALIBRATE_FROM_SCRATCH()) if said else ()


def _changed(name: str, now: str, then: str) -> Sentence:
    match name:
        case "model":
            return Code.MODEL_CHANGED(now=now, then=then)
        case "firmware":
            return Code.FIRMWARE_CHANGED(now=now, then=then)
        case "gyro_range":
            return Code.RANGE_CHANGED(now_rad_s=now, then_rad_s=then)
        case _:
            return Code.RATE_CHANGED_SINCE(now_hz=now, then_hz=then)


def _said(value: str | float) -> str:
    """Format a value; a question mark stands for an unknown one."""
    return "?" if not value else value if isinstance(value, str) else f"{value:.5g}"
