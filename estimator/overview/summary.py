"""Summary of a ward: numbers of devices, devices that need a person, and samples unaccounted for. Pure."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from bridge.ingest import duplicate_bridges
from bridge.reasons.catalogue import english, in_words, sentences_as_json
from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire.messages import DeviceInfo, Placement, State, Status
from estimator.device.admission import ELSEWHERE
from estimator.device.attention import complaints, ended, needs_person
from estimator.overview.ward import listed
from estimator.service import overload
from estimator.service.periodic_checks import EVENT
from estimator.service.quota import FLOODED

_MOST = 3  # most reasons shown
#: settings of the ward's file that are probably wrong where several devices give the same reason
_SETTINGS = {
    Code.NOT_ONE_TURN: "model",
    Code.SENSITIVITY_WRONG: "model",
    Code.RATE_WRONG: "rate_hz",
    Code.RATE_OFF_BY_TWO: "rate_hz",
}
#: notices that a device's rate is not as expected
_OF_RATE = (Code.RATE_CHANGED, Code.RATE_DIFFERS, Code.CLOCK_DIFFERS)
_URGENT = (
    State.UNKNOWN,
    State.LOST,
    State.AWAITING_STILL,
    State.BIAS_ONLY,
    State.DEGRADED,
    State.TURNING,
    State.WARMING,
    State.TRACKING,
)


@dataclass(frozen=True, slots=True)
class Need:
    """Device that needs a person: its state, the reasons, and where it is worn."""

    device: str
    state: State
    reason: Sentences
    placement: Placement | None = None


@dataclass(frozen=True, slots=True)
class WardSummary:
    """Summary of a ward: numbers of devices and samples, devices that need a person, and faults of the ward.

    devices: number of devices whose data has not ended. ended: number of the others. tracking: number of devices in
    state TRACKING: calibrated, with the bias tracked.
    needs: devices that need a person, most urgent first. troubles: faults of the ward itself.
    samples_in, samples_out, dropped: numbers of samples received, published and dropped by the estimators.
    law: by device, a sentence for each device where samples_in differs, or has differed, from samples_out + dropped.
    unused: number of samples that estimator or bridge did not use, by device and reason; the device with most first.
    told: by device, English text on other events that its bridge counted, and on an unexpected sample rate.
    bridges, estimators: ids of those alive.
    """

    ward: str
    devices: int
    ended: int
    tracking: int
    needs: Sequence[Need]
    samples_in: int
    samples_out: int
    dropped: int
    unused: Mapping[str, Mapping[str, int]]
    told: Mapping[str, str]
    law: Mapping[str, Sentence]
    bridges: Sequence[str]
    estimators: Sequence[str]
    troubles: Sentences

    @property
    def well(self) -> bool:
        """True if nobody has to do anything.

        No device needs a person, every received sample was published or counted as dropped, and the ward has no fault.
        """
        return not (self.needs or self.law or self.troubles)


def summarise(
    ward: str,
    statuses: Mapping[str, Status],
    infos: Mapping[str, DeviceInfo],
    bridges: Sequence[str],
    estimators: Sequence[str],
) -> WardSummary:
    """Summarise a ward: numbers of devices and samples, devices that need a person, and faults.

    statuses, infos: latest status and info of each device, by device id. bridges, estimators: ids of those alive.
    """
    names = sorted({*statuses, *infos})
    needs = [need for name in names if (need := _need(name, statuses.get(name), infos.get(name))) is not None]
    over = sum(ended(_said(statuses.get(name), infos.get(name))) for name in names)
    troubles = [] if estimators else [Code.NO_ESTIMATOR()]
    troubles += [] if bridges else [Code.NO_BRIDGE()]
    troubles += [
        *duplicate_bridges.found(statuses.values()),
        *overload.found(statuses.values()),
        *overload.unkept(statuses.values()),
        *_alike(statuses),
    ]
    return WardSummary(
        ward=ward,
        devices=len(names) - over,
        ended=over,
        tracking=sum(s.state is State.TRACKING for s in statuses.values()),
        needs=sorted(needs, key=lambda need: _URGENT.index(need.state)),
        samples_in=sum(s.samples_in for s in statuses.values()),
        samples_out=sum(s.samples_out for s in statuses.values()),
        dropped=sum(sum(s.dropped.values()) for s in statuses.values()),
        unused=_unused(names, statuses, infos),
        told={name: words for name in names if name in infos and (words := told(infos[name]))},
        law={name: broken for name, status in sorted(statuses.items()) if (broken := _law(name, status))},
        bridges=sorted(bridges),
        estimators=sorted(estimators),
        troubles=tuple(troubles) if names else (*troubles, Code.NO_DEVICE(), *_misnamed(ward, bridges, estimators)),
    )


def _alike(statuses: Mapping[str, Status]) -> Sentences:
    """Settings that are doubted, as several devices are refused for the same reason."""
    found: dict[str, list[str]] = {}
    for name, status in sorted(statuses.items()):
        for setting in {_SETTINGS[Code(one.code)] for one in status.reason if one.code in _SETTINGS}:
            found.setdefault(setting, []).append(name)
    return tuple(
        Code.SETTING_DOUBTED(devices=len(names), names=listed(names), setting=setting)
        for setting, names in found.items()
        if len(names) > 1
    )


def _misnamed(ward: str, bridges: Sequence[str], estimators: Sequence[str]) -> Sentences:
    return () if bridges or estimators else (Code.WARD_EMPTY(ward=ward),)


def as_json(seen: WardSummary) -> dict[str, Any]:
    """Return the summary of a ward as one JSON-compatible object.

    The keys are the fields of WardSummary, with three exceptions. `well` is added. `law` contains the sample counts,
    whether they agree (holds), and sentences by device where they do not (broken). `unused` contains the totals by
    reason (all), and the counts by device and reason (devices).
    """
    return {
        "ward": seen.ward,
        "well": seen.well,
        "devices": seen.devices,
        "ended": seen.ended,
        "tracking": seen.tracking,
        "needs": [
            {
                "device": n.device,
                "state": n.state.name.lower(),
                "reason": sentences_as_json(n.reason),
                "placement": placement_as_json(n.placement),
            }
            for n in seen.needs
        ],
        "law": {
            "holds": not seen.law,
            "samples_in": seen.samples_in,
            "samples_out": seen.samples_out,
            "dropped": seen.dropped,
            "broken": {name: sentences_as_json((broken,)) for name, broken in seen.law.items()},
        },
        "unused": {"all": dict(total(seen.unused)), "devices": {name: dict(why) for name, why in seen.unused.items()}},
        "told": dict(seen.told),
        "bridges": list(seen.bridges),
        "estimators": list(seen.estimators),
        "troubles": sentences_as_json(seen.troubles),
    }


def placement_as_json(placement: Placement | None) -> dict[str, Any] | None:
    """Return a placement as a JSON-compatible object with its fields; None if nobody has recorded one for the device."""
    return None if placement is None else asdict(placement)


def total(unused: Mapping[str, Mapping[str, int]]) -> Counter[str]:
    """Return the number of samples of all devices that estimator or bridge did not use, by reason.

    unused: number of these samples by device and reason.
    """
    return sum(map(Counter, unused.values()), Counter())


def most(reasons: Mapping[str, int]) -> str:
    """Format the three most frequent reasons with their counts, and the count of all others: `5 late, 2 repeated`."""
    found = Counter(reasons).most_common()
    said = [f"{n} {why}" for why, n in found[:_MOST]]
    left = sum(n for _, n in found[_MOST:])
    return ", ".join([*said, *([f"{left} for other reasons"] if left else [])])


def told(info: DeviceInfo) -> str:
    """Format the events that a device's bridge counted, and an unexpected sample rate, in English; may be empty.

    Only the most frequent events are named.
    """
    counts = most({in_words(label): n for label, n in info.events.items() if n})
    rate = english(*(notice for notice in info.notices if notice.code in _OF_RATE))
    return " ".join(filter(None, (rate, counts)))


def _unused(
    names: Sequence[str], statuses: Mapping[str, Status], infos: Mapping[str, DeviceInfo]
) -> dict[str, dict[str, int]]:
    found = {name: reasons for name in names if (reasons := _reasons(statuses.get(name), infos.get(name)))}
    return dict(sorted(found.items(), key=lambda one: -sum(one[1].values())))


def _reasons(status: Status | None, info: DeviceInfo | None) -> dict[str, int]:
    """Return the numbers of samples that the estimator and the bridge did not use, by reason."""
    reasons: Counter[str] = Counter()
    if status is not None:
        reasons.update({in_words(label): n for label, n in status.dropped.items()})
        elsewhere = {
            label.removeprefix(ELSEWHERE): n for label, n in status.events.items() if label.startswith(ELSEWHERE)
        }
        reasons.update({f"also sent by {bridge}": n for bridge, n in elsewhere.items()})
        reasons.update({"messages above its quota": status.events.get(FLOODED, 0)})
    if info is not None:
        reasons.update({f"{in_words(label)} (at {info.bridge})": n for label, n in info.dropped.items()})
    return {why: n for why, n in reasons.most_common() if n}


def _need(name: str, status: Status | None, info: DeviceInfo | None) -> Need | None:
    if ended(_said(status, info)):
        return None
    trouble = info.trouble if info else ()
    if status is None or (trouble and status.state is State.LOST):
        return Need(name, State.UNKNOWN if status is None else State.LOST, trouble or (Code.NEVER_HEARD(),))
    if not needs_person(status, info):
        return None
    why = () if status.state is State.TRACKING else status.reason
    return Need(name, status.state, why + complaints(info), status.placement)


def _said(status: Status | None, info: DeviceInfo | None) -> Sentences:
    """State of a device in words, from its status; without a status, from the bridge's info."""
    if status is not None:
        return status.reason
    return () if info is None else info.trouble


def _law(name: str, status: Status) -> Sentence | None:
    lost = status.samples_in - status.samples_out - sum(status.dropped.values())
    if lost:
        dropped = sum(status.dropped.values())
        return Code.SAMPLES_UNACCOUNTED(
            device=name, taken=status.samples_in, out=status.samples_out, dropped=dropped, lost=lost
        )
    times = status.events.get(EVENT, 0)
    return Code.SAMPLES_WERE_UNACCOUNTED(device=name, times=times) if times else None
