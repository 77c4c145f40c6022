"""Documents of the stream: corrected samples and reports of missed samples, as JSON or protobuf. Pure."""

from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from bridge.wire import codec
from bridge.wire.keys import boot_id
from bridge.wire.messages import CorrectedBatch
from estimator.web.api.answers import Vector
from estimator.web.stream.cursor import Missed, Place


class Samples(Struct, frozen=True, tag="samples", tag_field="type"):
    """Consecutive corrected samples of one boot; or their mean, as one sample, if the request has `hz`.

    Sample i of n has the number `sequence` + i in its boot.
    `time_s` (n): host time, s since the Unix epoch. `device_time_s` (n): the device's own clock, s; integrate rates
    with it.
    `rate_rad_s`, `rate_std_rad_s` (n, 3): corrected rates in the sensor frame and their standard deviations, rad/s.
    `bias_rad_s`, `bias_std_rad_s` (3): reading at zero rate and its standard deviation, rad/s.
    `flags` (n): see docs/wire.md. `after`: value of the query parameter `after` that resumes after these samples.
    """

    device: str
    boot: str
    sequence: int
    time_s: list[float]
    device_time_s: list[float]
    rate_rad_s: list[Vector]
    rate_std_rad_s: list[Vector]
    bias_rad_s: Vector
    bias_std_rad_s: Vector
    quality: str
    calibration: str | None
    flags: list[int]
    after: str


class MissedSamples(Struct, frozen=True, tag="missed", tag_field="type"):
    """Samples of a boot that the reader does not get: `count` of them from number `first` on.

    If `count` is null, the number is unknown: all samples up to the end of that boot.
    """

    device: str
    boot: str
    first: int
    count: int | None


class Answer(Struct, frozen=True):
    """Response to a long poll: documents in order, possibly none, and the positions to resume from.

    `after`: pass each of these texts as a query parameter `after` of the next request.
    """

    documents: list[Samples | MissedSamples]
    after: Annotated[list[str], Meta(min_length=1)]


def document(one: CorrectedBatch | Missed) -> Samples | MissedSamples:
    """Convert corrected samples, or a report of missed ones, into a document of the API."""
    if isinstance(one, Missed):
        return MissedSamples(one.device, boot_id(one.boot), one.first, one.count)
    return Samples(
        device=one.device,
        boot=boot_id(one.boot),
        sequence=one.sequence,
        time_s=(one.sample_time_ns / 1e9).tolist(),
        device_time_s=one.device_time.tolist(),
        rate_rad_s=one.rate.tolist(),
        rate_std_rad_s=one.rate_std.tolist(),
        bias_rad_s=one.bias.tolist(),
        bias_std_rad_s=one.bias_std.tolist(),
        quality=one.quality.name,
        calibration=one.calibration or None,
        flags=one.flags.tolist(),
        after=said(one.device, Place(one.boot, one.sequence + len(one))),
    )


def message(one: CorrectedBatch | Missed, *, protobuf: bool) -> str | bytes:
    """Encode one message of the WebSocket: JSON as text; with `protobuf`, samples as the bytes of a CorrectedBatch.

    A report of missed samples is always JSON.
    """
    if protobuf and isinstance(one, CorrectedBatch):
        return codec.encode_corrected(one)
    return msgspec.json.encode(document(one)).decode()


def said(device: str, place: Place) -> str:
    """Format a position as a query parameter `after`: device, boot and number of the last sample read.

    For example chest.0000000000000005.1239. The number is -1 before the first sample of a boot.
    """
    return f"{device}.{boot_id(place.boot)}.{place.next - 1}"
