"""Rules for which problems need a person. Pure.

One definition for the pages, the API, the reports, the command line, the metrics and the alerts.
"""

from enum import StrEnum

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import DeviceInfo, State, Status

LOW_BATTERY_PERCENT = 15.0
#: reasons of a device that is meant to send no more
_ENDED = (Code.RECORDING_OVER, Code.CAPTURE_OVER, Code.DEVICE_REMOVED, Code.FORGOTTEN)


class Kind(StrEnum):
    """Kind of problem that needs a person.

    LOST to BATTERY_LOW are problems of a device, DISK to BACKUP of an estimator and its machine.
    """

    LOST = "lost"
    UNCALIBRATED = "uncalibrated"
    DEGRADED = "degraded"
    BAD_SAMPLES = "bad_samples"
    BATTERY_LOW = "battery_low"
    DISK = "disk"
    CLOCK = "clock"
    CERTIFICATE = "certificate"
    BACKUP = "backup"


#: states that end well by themselves need nobody; a device that is being turned waits for a hand, also where the hand has gone
_OF_STATE = {State.WARMING: (), State.TRACKING: (), State.LOST: (Kind.LOST,), State.DEGRADED: (Kind.DEGRADED,)}


def ended(reason: Sentences) -> bool:
    """Return whether a reason says that the device will not send again: its recording ended, or it was removed."""
    return any(one.code in _ENDED for one in reason)


def attentions(state: State, reason: Sentences, info: DeviceInfo | None) -> frozenset[Kind]:
    """Return the kinds of problems of a device that need a person now: by state, battery and bad samples; may be empty.

    state, reason: those of the device's status. info: the device's DeviceInfo, None if unknown.
    """
    if state is State.LOST and ended(reason):
        return frozenset()
    found = set[Kind](_OF_STATE.get(state, (Kind.UNCALIBRATED,)))
    for one in complaints(info):
        found.add(Kind.BATTERY_LOW if one.code == Code.LOW_BATTERY else Kind.BAD_SAMPLES)
    return frozenset(found)


def needs_person(status: Status, info: DeviceInfo | None) -> bool:
    """Return whether a device has any problem that a person has to solve. info: the device's own DeviceInfo, or None."""
    return bool(attentions(status.state, status.reason, info))


def complaints(info: DeviceInfo | None) -> Sentences:
    """Return messages about faults of a working device that a person has to remedy; empty if there are none.

    Faults are bad samples, and a battery below LOW_BATTERY_PERCENT that is not charging. info: None if unknown.
    """
    if info is None:
        return ()
    bad = tuple(one for one in info.notices if one.code == Code.SAMPLES_BAD)
    low = info.battery_percent < LOW_BATTERY_PERCENT and not info.charging  # NaN, where unknown, is not low
    return (*bad, Code.LOW_BATTERY(percent=f"{info.battery_percent:.0f}")) if low else bad
