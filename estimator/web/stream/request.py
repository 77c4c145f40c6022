"""Parameters of a request for the stream: parsed and checked."""

import re
from dataclasses import dataclass
from http import HTTPStatus
from math import isfinite

from starlette.datastructures import QueryParams

from bridge.wire.keys import check_id
from bridge.wire.refusal import Refusal
from estimator.web.http_error import Fault
from estimator.web.stream.cursor import Place

#: most devices named in a request
DEVICES = 32
#: least and greatest `hz`: means a second, in place of every sample
SLOWEST_HZ, FASTEST_HZ = 0.1, 1000.0
#: longest and usual wait of a request for samples, s
LONGEST_S, USUAL_S = 20.0, 10.0
#: a place: device, boot, and number of the last sample, as `documents.said` writes it
PLACE = re.compile(r"([a-z0-9][a-z0-9_-]{0,31})\.([0-9a-f]{16})\.(-1|[0-9]{1,19})")
FORMATS = ("json", "protobuf")


@dataclass(frozen=True, slots=True)
class Asked:
    """Checked parameters of a request for the stream.

    devices: ids; empty means all. after: positions to resume from, by device. If it is empty, reading begins with the
    first kept sample; if None, with the first sample that arrives from now on.
    hz: mean values a second; None for every sample. protobuf: whether samples are sent as protobuf. wait_s: longest
    wait for samples, s.
    """

    devices: tuple[str, ...]
    after: dict[str, Place] | None
    hz: float | None
    protobuf: bool
    wait_s: float


def asked_of(query: QueryParams) -> Asked:
    """Parse and check the parameters of a request for the stream. Raises Fault for an invalid one."""
    devices = tuple(dict.fromkeys(query.getlist("device")))
    if len(devices) > DEVICES:
        raise _bad(f"'device' is given {len(devices)} times: give at most {DEVICES}, or none for the whole ward.")
    for device in devices:
        try:
            check_id(device, "device")
        except Refusal as refusal:
            raise Fault(HTTPStatus.BAD_REQUEST, "bad_id", refusal.detail) from None
    if (form := query.get("format", FORMATS[0])) not in FORMATS:
        raise _bad(f"'format' is {form[:40]!r}: use json or protobuf.")
    hz = _number(query, "hz", SLOWEST_HZ, FASTEST_HZ) if "hz" in query else None
    wait_s = _number(query, "wait_s", 0.0, LONGEST_S) if "wait_s" in query else USUAL_S
    return Asked(devices, _after(query.getlist("after"), devices), hz, form == "protobuf", wait_s)


def _after(texts: list[str], devices: tuple[str, ...]) -> dict[str, Place] | None:
    if not texts:
        return None
    places = {}
    for text in filter(None, texts):
        found = PLACE.fullmatch(text)
        if found is None:
            raise _bad(f"'after' is {text[:60]!r}: use DEVICE.BOOT.NUMBER, as in `after` of an earlier answer.")
        device, boot, number = found.groups()
        if not devices or device in devices:
            places[device] = Place(int(boot, 16), int(number) + 1)
    return places


def _number(query: QueryParams, name: str, least: float, most: float) -> float:
    text = query[name]
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not (isfinite(value) and least <= value <= most):
        raise _bad(f"'{name}' is {text[:40]!r}: use a number from {least:g} to {most:g}.")
    return value


def _bad(words: str) -> Fault:
    return Fault(HTTPStatus.BAD_REQUEST, "bad_parameter", words)
