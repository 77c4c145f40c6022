"""Restore with a key: under what a calibration of an earlier boot, or of this one, still holds; and in words, why not."""

from collections.abc import Mapping
from typing import Any

from bridge.wire.messages import Calibration, DeviceInfo
from estimator.same_rate import same_rate

_UNITS = {"gyro_range": " rad/s", "rate_hz": " Hz"}
_WORDS = {"gyro_range": "range", "rate_hz": "rate"}


def restore_key(of: Calibration | DeviceInfo) -> dict[str, str | float]:
    """What it was, beside its name."""
    return {"model": of.model, "firmware": of.firmware, "gyro_range": of.gyro_range, "rate_hz": of.rate_hz}


def differing(then: Mapping[str, Any], info: DeviceInfo) -> dict[str, str | float]:
    """What of a restore key is otherwise now.

    A device with a clock may be told another rate, as for a calibration; without one its scale hangs on its rate.
    """
    now = restore_key(info)
    if info.has_clock or same_rate(then["rate_hz"], info.rate_hz):
        del now["rate_hz"]
    return {name: value for name, value in now.items() if value != then[name]}


def changed(calibration: Calibration, info: DeviceInfo, *, within_boot: bool = False) -> str:
    """Why the calibration does not hold for what the device is now, for a person; empty when it does.

    within_boot: what was not known then, or is not now, has not changed.
    """
    then = restore_key(calibration)
    other = differing(then, info)
    if within_boot:
        other = {name: now for name, now in other.items() if now and then[name]}
    said = [
        f"{_WORDS.get(name, name)} is {_said(name, now)}, was {_said(name, then[name])}" for name, now in other.items()
    ]
    return f"its {', its '.join(said)} when it was calibrated: from scratch" if said else ""


def _said(name: str, value: str | float) -> str:
    if isinstance(value, str):
        return value or "not known"
    return f"{value:.5g}{_UNITS[name]}" if value else "not known"
