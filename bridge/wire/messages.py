"""Message types of the bus: frozen dataclasses, validated by the codec.

`sample_messages` has the types with sample arrays, `calibration_messages` those of calibrations. Rates are in rad/s,
times in s unless the name says otherwise.
"""

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

from bridge.reasons.codes import Sentences
from bridge.wire.calibration_messages import AccelerometerCalibration, Calibration, DeviceCalibration, Turn, Verdict
from bridge.wire.sample_messages import (
    STEADY,
    BiasRevision,
    CorrectedBatch,
    Floats,
    OrientationBatch,
    Quality,
    SampleBatch,
    SampleFlag,
    WindowBatch,
    combined_std,
    frequent,
)

__all__ = [
    "NO_REST_S",
    "SEGMENTS",
    "SIDES",
    "STEADY",
    "VERSION",
    "AccelerometerCalibration",
    "Alert",
    "BiasRevision",
    "BootCause",
    "Calibration",
    "Checkpoint",
    "Command",
    "CommandReply",
    "CorrectedBatch",
    "DeviceCalibration",
    "DeviceInfo",
    "Floats",
    "Holding",
    "Move",
    "Note",
    "OrientationBatch",
    "Owned",
    "Placement",
    "Quality",
    "Receipt",
    "SampleBatch",
    "SampleFlag",
    "State",
    "Status",
    "Turn",
    "Verdict",
    "WindowBatch",
    "combined_std",
]

VERSION = 1


class BootCause(IntEnum):
    """Evidence by which the bridge noticed a boot.

    POWER_UP: the device reported it. PORT_OPENED: assumed, because the port was opened.
    """

    UNKNOWN = 0
    POWER_UP = 1
    PORT_OPENED = 2


class State(IntEnum):
    """Calibration state of a device, from warming up to tracking its bias.

    WARMING: warming up after a boot. AWAITING_STILL: waiting for a rest. BIAS_ONLY: bias known from a rest; the
    turns are still to be made.
    TURNING: a calibration turn is under way. TRACKING: calibrated, bias tracked.
    DEGRADED: calibrated, but the evidence is old or contradicts the estimate. LOST: the device sends nothing.
    """

    UNKNOWN = 0
    WARMING = 1
    AWAITING_STILL = 2
    BIAS_ONLY = 3
    TURNING = 4
    TRACKING = 5
    DEGRADED = 6
    LOST = 7


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """Device information that its bridge publishes: identity, settings, and sample counts of this boot.

    boot: 64-bit boot number. rate_hz: output data rate stated by the device. measured_rate_hz: measured by the bridge;
    0 until known. gyro_range: full-scale range, rad/s; 0 if unknown. time_ns: when it was sent, ns since the Unix
    epoch.
    samples: number of samples published in this boot. dropped: number of samples not published, by reason.
    events: number of other events, such as reconnections, by label.
    """

    device: str
    bridge: str
    boot: int
    boot_cause: BootCause
    model: str
    firmware: str
    driver: str
    port: str
    rate_hz: float
    measured_rate_hz: float
    gyro_range: float
    has_accel: bool
    has_temperature: bool
    time_ns: int
    samples: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    events: dict[str, int] = field(default_factory=dict)
    trouble: Sentences = ()  # why the device cannot be read; empty when all is well
    battery_percent: float = math.nan  # NaN when unknown
    charging: bool = False
    notices: Sentences = ()  # what a person should know about the device
    has_clock: bool = True  # ticks are device time; False: the bridge derived them from the sample count
    calibration: DeviceCalibration | None = None  # the latest that the device made itself in this boot


#: segments of a body, by their names in OpenSim models, and whether there is a left and a right one
SEGMENTS = {
    "head": False,
    "torso": False,
    "pelvis": False,
    "humerus": True,
    "radius": True,
    "hand": True,
    "femur": True,
    "tibia": True,
    "calcn": True,
}
SIDES = ("left", "right")


@dataclass(frozen=True, slots=True)
class Placement:
    """Place of a device on a body, and its wearer; an empty field is unknown.

    segment: body segment, one of SEGMENTS. side: one of SIDES. wearer: a bed or a pseudonym.
    since_ns: begin, ns since the Unix epoch. who: name of the person who stated it.
    bool(placement) is False if nobody wears the device.
    """

    segment: str = ""
    side: str = ""
    wearer: str = ""
    since_ns: int = 0
    who: str = ""

    def __bool__(self) -> bool:
        return bool(self.segment or self.wearer)

    @property
    def body(self) -> str:
        """Name of the segment on which the device is worn, in an OpenSim model, such as `femur_r`; empty if unknown."""
        return f"{self.segment}_{self.side[0]}" if self.side else self.segment

    def __str__(self) -> str:
        where = f"{self.segment} {self.side}".strip()
        return ", ".join(filter(None, (where, self.wearer))) or "nobody"


@dataclass(frozen=True, slots=True)
class Alert:
    """Standing alert of a device or an estimator: raised, and not yet cleared; docs/alerts.md lists the kinds.

    Times are in ns since the Unix epoch. since_ns: when the cause began. raised_ns: when the cause had lasted for its
    hold time. acknowledged_ns: when the person `who` acknowledged the alert; 0 before.
    """

    kind: str
    since_ns: int
    raised_ns: int
    acknowledged_ns: int = 0
    who: str = ""


#: evidence_age_s of a device without a known rest, s
NO_REST_S = 1e12


class Receipt(NamedTuple):
    """Receipt of one measurement update of the bias filter: innovation, test and verdict.

    time_ns: time of the measurement, ns since the Unix epoch. kind: name of the kind of measurement, such as
    `zaru level` (zero angular rate, horizontal part). innovation: measured - predicted, 1 to 3 values, rad/s.
    innovation_std: standard deviations of the innovation, rad/s. nis: normalised innovation squared, without unit.
    test_ratio: nis divided by the gate (the limit of nis). accepted: True if the measurement was used.
    reason: why the measurement was refused, or accepted beyond the gate; else empty.
    """

    time_ns: int
    kind: str
    innovation: tuple[float, ...]
    innovation_std: tuple[float, ...]
    nis: float
    test_ratio: float
    accepted: bool
    reason: str = ""


@frequent(eq=True)
class Status:
    """Status of a device, which its estimator sends at every change and once a second.

    time_ns, calibrated_time_ns: ns since the Unix epoch; calibrated_time_ns is 0 if never calibrated in this boot.
    bias, bias_std (3,): rad/s. scale (3,): diagonal of the calibration matrix in use, without unit.
    progress: share of the calibration done, 0 to 1. axes_done: axes of accepted turns: 0 x, 1 y, 2 z.
    evidence_age_s: time since the last accepted rest. temperature_c: NaN if unknown. rate_hz: measured sample rate.
    samples_in, samples_out: numbers of samples received and published; samples_in = samples_out + sum of dropped.
    dropped: number of samples not published, by reason. events: number of other events, by label.
    """

    device: str
    boot: int
    time_ns: int
    state: State
    quality: Quality
    reason: Sentences
    progress: float
    axes_done: tuple[int, ...]
    bias: tuple[float, ...]
    bias_std: tuple[float, ...]
    scale: tuple[float, ...]
    calibration: str
    calibrated_time_ns: int
    evidence_age_s: float  # NO_REST_S when no rest is known in this boot
    temperature_c: float
    rate_hz: float
    samples_in: int
    samples_out: int
    dropped: dict[str, int] = field(default_factory=dict)
    events: dict[str, int] = field(default_factory=dict)
    bridge: str = ""  # the bridge whose samples are used
    refused_bridges: tuple[str, ...] = ()  # other bridges that send the same device now
    epoch: int = 0  # as in CorrectedBatch
    placement: Placement | None = None  # None: nobody said who wears the device
    alerts: tuple[Alert, ...] = ()
    accelerometer: AccelerometerCalibration | None = None  # None before the first rest, and without an accelerometer
    nis: float = 0.0  # mean NIS per degree of freedom of the latest rests; 0: unknown
    receipts: tuple[Receipt, ...] = ()  # of the bias filter since the status before, oldest first


class Holding(NamedTuple):  # a NamedTuple for speed: hundreds of them, four times a second
    """Device that an estimator owns: it alone processes the device's samples.

    epoch: number of the period of ownership; a later period has a higher number. boot: 64-bit boot number.
    next: number of the first sample of this boot that is not yet corrected and published.
    busy: True during a calibration. Its turns would be lost if another estimator took over.
    """

    device: str
    epoch: int
    boot: int
    next: int
    busy: bool = False


@dataclass(frozen=True, slots=True)
class Move:
    """Change of the list of devices whose samples one estimator alone processes, with the reason.

    came, left: number of devices gained and given up. time_ns: ns since the Unix epoch.
    """

    time_ns: int
    came: int
    left: int
    reason: Sentences


@dataclass(frozen=True, slots=True)
class Owned:
    """List of the devices that an estimator owns: it alone processes their samples.

    A list is published in `parts` messages. part: number of this message, from 0. time_ns: ns since the Unix epoch.
    epoch: highest number of a period of ownership that the estimator has received or used.
    load: processor time used by the estimator's process, s per s.
    holdings: the devices. moves: latest changes of the list. alerts: those of the estimator itself.
    """

    estimator: str
    time_ns: int
    epoch: int  # the highest epoch that the estimator has received or used
    load: float
    holdings: tuple[Holding, ...]
    moves: tuple[Move, ...] = ()
    part: int = 0
    parts: int = 1
    alerts: tuple[Alert, ...] = ()  # of the estimator itself


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """Checkpoint of a device, from which another estimator can take over: calibration, filter state, last replies.

    epoch: number of the period in which the estimator owns the device; a later period has a higher number.
    time_ns: ns since the Unix epoch. answers: verb and reply of the last commands. state: the filter state, encoded.
    """

    device: str
    boot: int
    epoch: int
    time_ns: int
    bridge: str = ""  # the bridge whose samples are used
    calibration: Calibration | None = None  # in use: from this boot or an earlier one
    answers: tuple[tuple[str, "CommandReply"], ...] = ()  # the last few commands: verb and reply
    boot_repeated: bool = False  # an earlier power-up had the same boot id, and this one is not calibrated yet
    state: bytes = b""  # state of the estimator's session: see DeviceSession.restored
    placement: Placement | None = None  # the latest that was set, also that nobody wears the device
    alerts: tuple[Alert, ...] = ()


@dataclass(frozen=True, slots=True)
class Note:
    """Note that a person attaches to a moment of a device.

    time_ns: ns since the Unix epoch. who: name of the person. text: the note.
    """

    device: str
    boot: int
    time_ns: int
    who: str
    text: str


@dataclass(frozen=True, slots=True)
class Command:
    """Command of a person or a program to the estimator of a device; the bus key contains the verb.

    request_id: id that the reply repeats. who: name of the person or program. reason: free text.
    """

    request_id: str
    who: str
    reason: str
    placement: Placement | None = None  # for the verb `place`


@dataclass(frozen=True, slots=True)
class CommandReply:
    """Reply to a command.

    request_id: id of the command. accepted: True if the command is carried out. message: the reason, for people.
    """

    request_id: str
    accepted: bool
    message: Sentences
