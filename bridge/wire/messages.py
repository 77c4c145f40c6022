"""Message types: frozen dataclasses, validated by the codec.

`sample_messages` has those with sample arrays, `calibration_messages` the calibrations. Rates are in rad/s, times in
seconds unless the name says otherwise.
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
    """How the bridge noticed a boot: POWER_UP, by the device itself; PORT_OPENED, assumed when the port was opened."""

    UNKNOWN = 0
    POWER_UP = 1
    PORT_OPENED = 2


class State(IntEnum):
    """Life state of a device: from warming up through lying still and turning (its calibration) to tracking.

    DEGRADED: calibrated, but evidence is old or contradicts. LOST: the device sends nothing.
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
    """Device information that its bridge publishes: identity, settings, and counts of this boot.

    rate_hz: as the device states it; measured_rate_hz: by the bridge, 0 until known. gyro_range: full scale in rad/s, 0
    if unknown. time_ns: since the Unix epoch. samples: number published in this boot. dropped, events: counts by label.
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
    """Where on a body a device is worn, and by whom; each field may be empty, for unknown.

    A placement counts as false if nobody wears the device.
    segment: of SEGMENTS. side: of SIDES. wearer: a bed or a pseudonym.
    since_ns: ns since the Unix epoch. who: the person who said so.
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
        """Name of the worn segment in an OpenSim model, such as `femur_r`; empty if unknown."""
        return f"{self.segment}_{self.side[0]}" if self.side else self.segment

    def __str__(self) -> str:
        where = f"{self.segment} {self.side}".strip()
        return ", ".join(filter(None, (where, self.wearer))) or "nobody"


@dataclass(frozen=True, slots=True)
class Alert:
    """Standing alert of a device or an estimator; docs/alerts.md lists the kinds. Times are ns since the Unix epoch.

    since_ns: when the cause began. raised_ns: when the cause had lasted for its hold time. acknowledged_ns: when the
    person `who` acknowledged the alert; 0 until then.
    """

    kind: str
    since_ns: int
    raised_ns: int
    acknowledged_ns: int = 0
    who: str = ""


#: evidence_age_s of a device without a known rest, s
NO_REST_S = 1e12


class Receipt(NamedTuple):
    """What the bias filter did with one measurement; innovation = measured - predicted.

    time_ns: since the Unix epoch. kind: of evidence. innovation, innovation_std: 1 to 3 values, rad/s.
    nis: normalised innovation squared. test_ratio: NIS / gate. reason: why refused, or accepted beyond the gate; or
    empty.
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
    """Status of a device, sent by its estimator at every change and once a second. Times are ns since the Unix epoch.

    bias, bias_std (3): rad/s. scale (3): diagonal of the matrix in use. progress: of the calibration, 0 to 1.
    axes_done: axes of accepted turns, 0 x, 1 y, 2 z. calibrated_time_ns: 0 if never in this boot.
    evidence_age_s: s since the last accepted rest. temperature_c: °C, NaN if unknown. rate_hz: measured sample rate.
    samples_in = samples_out + sum of dropped, numbers of samples. dropped, events: counts by label.
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


class Holding(NamedTuple):  # a NamedTuple for speed: hundreds of them, five times a second
    """A device owned by an estimator since `epoch`.

    Samples of this boot numbered below `next` are corrected and published.
    epoch: number of the ownership; a higher one is later. busy: a calibration is under way; a takeover now would lose
    its turns.
    """

    device: str
    epoch: int
    boot: int
    next: int
    busy: bool = False


@dataclass(frozen=True, slots=True)
class Move:
    """Change of an estimator's devices: how many came and left, when (ns since the Unix epoch), and why."""

    time_ns: int
    came: int
    left: int
    reason: Sentences


@dataclass(frozen=True, slots=True)
class Owned:
    """Devices owned by an estimator, published in `parts` messages; this is number `part`, counted from 0.

    load: processor seconds per second of the estimator's process. time_ns: since the Unix epoch.
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
    """Checkpoint of a device: calibration, filter state and last answers, from which another estimator can take over.

    epoch: number of the ownership. time_ns: since the Unix epoch.
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
    """Note of a person (`who`) about a device, with its time in ns since the Unix epoch."""

    device: str
    boot: int
    time_ns: int
    who: str
    text: str


@dataclass(frozen=True, slots=True)
class Command:
    """Command of a person or a program to a device's estimator, with an id for its reply; the key holds the verb."""

    request_id: str
    who: str
    reason: str
    placement: Placement | None = None  # for the verb `place`


@dataclass(frozen=True, slots=True)
class CommandReply:
    """Reply to the command of the same request_id: accepted or not; `message` gives the reason."""

    request_id: str
    accepted: bool
    message: Sentences
