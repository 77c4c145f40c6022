"""Response types of the HTTP API, in SI units; the OpenAPI document is generated from them. Pure."""

from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from bridge.reasons.catalogue import sentences_as_json
from bridge.reasons.codes import Sentences
from bridge.wire.keys import boot_id
from bridge.wire.messages import SEGMENTS, AccelerometerCalibration, Calibration, Placement
from bridge.wire.placement import MAX_WEARER
from estimator.alerts.outbox import sentence
from estimator.geometry.gyro_model import AXES
from estimator.offline import calibration_file
from estimator.overview.ward import TRACKING, DeviceRow
from estimator.reports.history import iso
from estimator.web.ward_state import Known, Story

#: calibrations per response by default, and at most
PAGE, MOST = 50, 500

Vector = Annotated[list[float], Meta(min_length=3, max_length=3)]
Matrix = Annotated[list[Vector], Meta(min_length=3, max_length=3)]


class Said(Struct, frozen=True):
    """Message: a code and its parameters, as listed in docs/wire.md, and its English text."""

    code: str
    params: dict[str, str]
    text: str


def said(sentences: Sentences) -> list[Said]:
    """Convert sentences of bus messages (code and parameters) into the API's messages, adding the English text."""
    return msgspec.convert(sentences_as_json(sentences), list[Said])


class Worn(Struct, frozen=True):
    """Placement of a device: body segment, side, wearer, who set it and since when.

    `since` is an ISO 8601 time. If segment and wearer are empty, nobody wears the device.
    """

    segment: str
    side: str
    wearer: str
    since: str
    who: str


class Accelerometer(Struct, frozen=True):
    """Calibration of an accelerometer by rests in different poses: corrected = scale × (reading − bias), axis by axis.

    bias_m_s2, scale (3): bias, m/s², and scale factors, no unit. covariance (6, 6): of the three biases (m/s²), then of
    the three scale factors. These three are null if the calibration was not accepted.
    cross_std: standard deviation of the cross-axis sensitivity, the share of another axis' acceleration in an axis'
    reading, no unit. poses: number of different poses.
    """

    verdict: str
    reason: list[Said]
    poses: int
    bias_m_s2: Vector | None
    scale: Vector | None
    covariance: list[list[float]] | None
    cross_std: float


class Device(Struct, frozen=True):
    """State of one device: bias, calibration, sample counts, battery and hardware; null means unknown.

    `bias_rad_s`, `bias_std_rad_s` (3): bias in the sensor frame and its standard deviation, rad/s. `scale` (3): scale
    factors, no unit.
    `calibration`: id of the calibration in use. `calibrated`: when it was made, ISO 8601. `axes_done`: axes (x, y, z)
    of the accepted turns.
    `progress`: completed share of the calibration, 0 to 1. `evidence_age_s`: seconds since the last accepted rest.
    `nis`: mean normalised innovation squared of the bias filter, about 1 if it is consistent.
    `rate_hz`: measured sample rate. `told_rate_hz`: configured output data rate. `battery_percent`: charge, 0 to 100.
    `samples_in`, `samples_out`: numbers of samples received and corrected. `dropped`: numbers of samples not corrected,
    by reason. `events`: numbers of other events, by name.
    `gaps`, `missing_samples`: numbers of gaps and of samples missing in them, since the estimator first saw the device.
    """

    id: str
    state: str
    needs_person: bool
    reason: list[Said]
    notices: list[Said]
    placement: Worn | None
    quality: str | None
    boot: str | None
    bias_rad_s: Vector | None
    bias_std_rad_s: Vector | None
    scale: Vector | None
    calibration: str | None
    calibrated: str | None
    progress: float | None
    axes_done: list[str]
    evidence_age_s: float | None
    nis: float | None
    temperature_c: float | None
    rate_hz: float | None
    told_rate_hz: float | None
    gaps: int
    missing_samples: int
    battery_percent: float | None
    charging: bool
    bridge: str | None
    model: str | None
    firmware: str | None
    samples_in: int
    samples_out: int
    dropped: dict[str, int]
    events: dict[str, int]
    accelerometer: Accelerometer | None


class Standing(Struct, frozen=True):
    """Standing alert (raised and not yet cleared) about a device or an estimator; docs/alerts.md lists the kinds.

    `subject`: id of the device or estimator. Times are ISO 8601. `since`: start of the fault. `raised`: when the alert
    was raised. `acknowledged`: when the person `who` acknowledged the alert; null before.
    """

    subject: str
    kind: str
    since: str
    raised: str
    acknowledged: str | None
    who: str
    message: list[Said]


class Standings(Struct, frozen=True):
    """Standing alerts (raised and not yet cleared) of a ward, those not acknowledged first."""

    alerts: list[Standing]


class Devices(Struct, frozen=True):
    """List of all devices of a ward; devices that need a person come first.

    `of`: number of devices. `tracking`: number of devices in state tracking: calibrated, with the bias tracked.
    `connected`: whether the dashboard is connected to a router.
    `troubles`: faults of the ward itself, not of single devices.
    """

    ward: str
    connected: bool
    tracking: int
    of: int
    troubles: list[Said]
    devices: list[Device]


class Turn(Struct, frozen=True):
    """Turn of a calibration by hand about an axis (x, y or z): angle and closure error in degrees, duration in s.

    closure_error_deg: angle by which the turn misses the attitude at its start.
    """

    axis: str
    angle_deg: float
    closure_error_deg: float
    duration_s: float


class OneCalibration(Struct, frozen=True):
    """Calibration of a gyro, accepted or rejected: corrected = matrix (reading − bias), in rad/s.

    matrix (3, 3), no unit. bias_rad_s, noise_std_rad_s (3): bias, and standard deviation of the white noise of a
    reading, rad/s.
    `covariance` (n, n): of the n `parameters`, in their order: biases in rad/s, the others without unit. Null means
    that there is no estimate.
    `in_use`: whether the estimator corrects the device with this calibration.
    This object, saved as a file, is accepted by `truerate correct --calibration`.
    """

    device: str
    boot: str
    time: str
    who: str | None
    in_use: bool
    format: str
    version: int
    id: str
    method: str
    verdict: str
    reason: list[Said]
    matrix: Matrix | None
    bias_rad_s: Vector | None
    parameters: list[str]
    covariance: list[list[float]] | None
    noise_std_rad_s: Vector | None
    turns: list[Turn]
    model: str
    firmware: str
    gyro_range_rad_s: float
    rate_hz: float
    temperature_c: float | None
    accelerometer: Accelerometer | None


class Calibrations(Struct, frozen=True):
    """Calibrations of one device, accepted or rejected, latest first.

    `next`: value of the query parameter `before` that returns the next older calibrations; null if there are none.
    """

    device: str
    calibrations: list[OneCalibration]
    next: str | None


class Words(Struct, frozen=True, forbid_unknown_fields=True):
    """Request body of a command that takes one line of text.

    `words`: a reason, the text of a note, or the kind of the alert to acknowledge.
    """

    words: Annotated[str, Meta(max_length=500)] = ""


class Placing(Struct, frozen=True, forbid_unknown_fields=True):
    """Request body of the command `place`: where and by whom a device is worn from now on.

    segment: body segment. wearer: a bed or a pseudonym. If all fields are empty, nobody wears the device.
    """

    segment: Literal["", *SEGMENTS] = ""  # type: ignore[valid-type] # the list has one place
    side: Literal["", "left", "right"] = ""
    #: a bed or a pseudonym, never a person's name
    wearer: Annotated[str, Meta(max_length=MAX_WEARER)] = ""


class Reply(Struct, frozen=True):
    """Reply of the estimator to a command: whether it was accepted, and why or why not."""

    accepted: bool
    message: list[Said]


class ErrorWords(Struct, frozen=True):
    """Error of a refused request: a short code for programs, and a text for people.

    reason: the estimator's reply, if it refused the command.
    """

    code: str
    message: str
    reason: list[Said] = []


class Error(Struct, frozen=True):
    """Body of the response to a refused request (status 400 and above)."""

    error: ErrorWords


def devices(known: Known, now: float) -> Devices:
    """Build the response with all devices of the ward. now: monotonic time, s.

    known: collected messages of the ward.
    """
    rows = known.rows(now)
    return Devices(
        ward=known.ward,
        connected=known.connected,
        tracking=sum(row.state == TRACKING for row in rows),
        of=len(rows),
        troubles=said(known.troubles()),
        devices=[device(row, known.stories[row.device]) for row in rows],
    )


def alerts(known: Known, now: float) -> Standings:
    """Build the response with the ward's standing alerts, those not acknowledged first. now: monotonic time, s.

    A standing alert is raised and not yet cleared. known: collected messages of the ward.
    """
    return Standings(
        [
            Standing(
                subject, one.kind, iso(one.since_ns), iso(one.raised_ns),
                iso(one.acknowledged_ns) if one.acknowledged_ns else None, one.who, said((sentence(one.kind, subject),)),
            )
            for subject, _, one in known.alerts(now)
        ]
    )  # fmt: skip


def device(row: DeviceRow, story: Story) -> Device:
    """Build the response for one device, from its row in the ward summary and its collected messages."""
    status, info = story.status, story.info
    return Device(
        id=row.device,
        state=row.state,
        needs_person=row.needs_person,
        reason=said(row.reason),
        notices=said(row.notices),
        placement=_worn(row.placement),
        quality=row.quality or None,
        boot=boot_id(story.boot) if story.boot else None,
        bias_rad_s=list(status.bias) if status else None,
        bias_std_rad_s=list(status.bias_std) if status else None,
        scale=list(status.scale) if status else None,
        calibration=(status.calibration or None) if status else None,
        calibrated=iso(status.calibrated_time_ns) if status and status.calibrated_time_ns else None,
        progress=status.progress if status else None,
        axes_done=[AXES[axis] for axis in status.axes_done] if status else [],
        evidence_age_s=row.evidence_age_s,
        nis=(status.nis or None) if status else None,
        temperature_c=status.temperature_c if status else None,
        rate_hz=((info.measured_rate_hz if info else 0.0) or row.rate_hz) or None,
        told_rate_hz=(info.rate_hz or None) if info else None,
        gaps=row.gaps,
        missing_samples=row.missing_samples,
        battery_percent=row.battery_percent,
        charging=row.charging,
        bridge=info.bridge if info else None,
        model=info.model if info else None,
        firmware=info.firmware if info else None,
        samples_in=status.samples_in if status else 0,
        samples_out=status.samples_out if status else 0,
        dropped=status.dropped if status else {},
        events=status.events if status else {},
        accelerometer=_accelerometer(status.accelerometer if status else None),
    )


def _accelerometer(one: AccelerometerCalibration | None) -> Accelerometer | None:
    return None if one is None else msgspec.convert(calibration_file.accelerometer_as_json(one), Accelerometer)


def _worn(one: Placement | None) -> Worn | None:
    if one is None:
        return None
    return Worn(one.segment, one.side, one.wearer, iso(one.since_ns), one.who)


def calibrations(name: str, story: Story, found: Sequence[Calibration], limit: int) -> Calibrations:
    """Build one page of a device's calibrations, latest first.

    name: device id. story: collected messages of the device. found: its calibrations, oldest first; the page has the
    last `limit` of them.
    """
    in_use = story.status.calibration if story.status else ""
    page = found[-limit:]
    return Calibrations(
        device=name,
        calibrations=[_calibration(c, in_use) for c in reversed(page)],
        next=page[0].id if len(page) < len(found) else None,
    )


def _calibration(c: Calibration, in_use: str) -> OneCalibration:
    about = {
        "device": c.device,
        "boot": boot_id(c.boot),
        "time": iso(c.time_ns),
        "who": c.who or None,
        "in_use": c.id == in_use,
    }
    return msgspec.convert({**calibration_file.as_json(c), **about}, OneCalibration)
