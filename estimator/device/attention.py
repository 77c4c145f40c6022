"""Whether a device needs a person: one definition for the pages, the API, the reports, the command line and the metrics. Pure."""

from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import DeviceInfo, State, Status

LOW_BATTERY_PERCENT = 15.0
#: states that end well by themselves; a device that is being turned waits for a hand, also where the hand has gone
_BY_ITSELF = (State.WARMING, State.TRACKING)
#: reasons of a device that is meant to send no more
_ENDED = (Code.RECORDING_OVER, Code.CAPTURE_OVER, Code.DEVICE_REMOVED, Code.FORGOTTEN)


def ended(reason: Sentences) -> bool:
    """Whether a device sends no more for one of these reasons, and nothing is wrong with that."""
    return any(one.code in _ENDED for one in reason)


def needs_person(status: Status, info: DeviceInfo | None) -> bool:
    """Whether a person has to do something: to the device, to its battery, or to what makes its samples bad."""
    if status.state is State.LOST and ended(status.reason):
        return False
    return status.state not in _BY_ITSELF or bool(complaints(info))


def complaints(info: DeviceInfo | None) -> Sentences:
    """What a person has to mend though the device works: bad samples, or a low battery that is not charging."""
    if info is None:
        return ()
    bad = tuple(one for one in info.notices if one.code == Code.SAMPLES_BAD)
    low = info.battery_percent < LOW_BATTERY_PERCENT and not info.charging  # NaN, where unknown, is not low
    return (*bad, Code.LOW_BATTERY(percent=f"{info.battery_percent:.0f}")) if low else bad
