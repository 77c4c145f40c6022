"""Decodes a capture of a device's bytes, or a text log, to a recording."""

from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from bridge.drivers.byte_stream import Decoder
from bridge.drivers.driver import Event, Identity, Notice, Readings
from bridge.reasons.catalogue import english
from bridge.recording.error import MAX_BYTES, RecordingError, check_file
from bridge.recording.formats.streams import choose_boot
from bridge.recording.reading import Reading
from bridge.recording.recording import Floats, Recording
from bridge.recording.table import Table, recording_of
from bridge.text.line_parser import Refused
from bridge.text.profile import Profile, load_profile
from bridge.toml.loader import ConfigError, nearest

_CHUNK, _SETTLING = 4096, 1 << 16
#: characters shown of a refused line
_SHOWN = 60
#: a decoder that does not know yet whether its device has a clock, or its rate, gets the beginning repeatedly
_NS_A_BYTE, _ROUNDS, _SETTLED_NS = 100_000, 8, 1_000_000_000_000


def load_capture(path: Path, driver: str, profile: str, reading: Reading) -> Recording:
    """Decode a capture (file of a device's raw bytes) to a recording of one boot, by a driver or by a text profile.

    A boot is the time from one power-up or restart of the device to the next. driver, profile: names, of which one is
    "". reading: properties that the file lacks, such as the sample rate in Hz, and which boot to read.
    Raises RecordingError if the file is unreadable, too large, without samples, or lacks a sample rate.
    Raises ConfigError for an unknown driver or profile.
    """
    check_file(path)
    if path.stat().st_size > MAX_BYTES:
        raise RecordingError(
            f"{path}: the file has {path.stat().st_size} bytes; at most {MAX_BYTES} are allowed: split the file"
        )
    data = path.read_bytes()
    if profile:
        known = load_profile(profile)
        if known.time is None and reading.rate_hz is None:
            reading = replace(reading, rate_hz=known.device.rate_hz or None)
        events, faults = _of_lines(known, data, reading)
    else:
        events, faults = _of_driver(path, driver, data)
    return _recording(path, driver or profile, events, faults, reading)


def _of_lines(profile: Profile, data: bytes, reading: Reading) -> tuple[list[Event], list[str]]:
    """Decode lines of text; events, and a text for each kind of refused line, with the first one."""
    from bridge.drivers.text_profile import TextDecoder  # noqa: PLC0415 - a driver's package may be slow to import

    first = dict[str, str]()

    def keep(refused: Refused, text: str) -> None:
        first.setdefault(refused.fault, f"{text[:_SHOWN]!r}: {refused.detail}")

    events, faults = _decoded(TextDecoder(profile, reading.rate_hz or 0.0, refused=keep, captured=True), data)
    return events, [f"{count} ({first[fault]})" if fault in first else count for fault, count in faults.items()]


def _of_driver(path: Path, driver: str, data: bytes) -> tuple[list[Event], list[str]]:
    """Decode bytes by a driver; events, and a text for each kind of undecoded data."""
    from bridge.drivers import registry  # noqa: PLC0415 - as above

    able = {name: kind.decoder for name, kind in registry.kinds().items() if kind.decoder is not None}
    if driver not in able:
        raise ConfigError(f"{path}: --driver {driver!r} cannot decode a file; {nearest(driver, able)}")
    events, faults = _decoded(able[driver](None), data)
    if not any(isinstance(event, Identity) and event.has_clock for event in events):
        decoder = able[driver](None)
        _settle(decoder, data[:_SETTLING])
        events, faults = _decoded(decoder, data)
    return events, list(faults.values())


def _decoded(decoder: Decoder, data: bytes) -> tuple[list[Event], dict[str, str]]:
    """Decode all bytes; events, and a text for each kind of undecoded data, by its label."""
    before = decoder.faults.as_dict()
    decoder.opened()
    events: list[Event] = []
    for at in range(0, len(data), _CHUNK):
        events += decoder.feed(data[at : at + _CHUNK], _SETTLED_NS + at * _NS_A_BYTE)
    events += decoder.finish()
    new = {label: n - before.get(label, 0) for label, n in decoder.faults.as_dict().items()}
    return events, {label: f"{n} {label.replace('_', ' ')}" for label, n in new.items() if n}


def _settle(decoder: Decoder, start: bytes) -> None:
    """Feed the beginning until samples come; otherwise the decoder drops the first ones, as after plugging in."""
    for turn in range(_ROUNDS):
        for at in range(0, len(start), _CHUNK):
            now_ns = (turn * len(start) + at) * _NS_A_BYTE
            if any(isinstance(event, Readings) for event in decoder.feed(start[at : at + _CHUNK], now_ns)):
                return


def _recording(path: Path, by: str, events: list[Event], faults: list[str], reading: Reading) -> Recording:
    boots = dict[int, list[Readings]]()
    identities = {event.boot: event for event in events if isinstance(event, Identity)}
    for event in events:
        if isinstance(event, Readings) and event.boot in identities:
            boots.setdefault(event.boot, []).append(event)
    if not boots:
        why = f": {', '.join(faults)}" if faults else ""
        raise RecordingError(
            f"{path}: no sample found by {by}{why}; find the right driver with `truerate bridge scan --port file://FILE`"
        )
    sizes = [sum(len(part.ticks) for part in parts) for parts in boots.values()]
    boot = list(boots)[choose_boot(path, sizes, reading.boot, "the device")]
    table = _table(path, identities[boot], boots[boot], faults, reading)
    table.notes += [english(event.said) for event in events if isinstance(event, Notice) and event.said]
    return recording_of(path, table, replace(reading, boot=None))


def _table(path: Path, who: Identity, parts: list[Readings], faults: list[str], reading: Reading) -> Table:
    ticks = _unwrapped(np.concatenate([part.ticks for part in parts]), who.tick_bits)
    columns = {"gyro_rad_s": np.concatenate([part.gyro for part in parts]).astype(np.float64)}
    accels = [part.accel for part in parts if part.accel is not None]
    if len(accels) == len(parts):
        columns["accel_m_s2"] = np.concatenate(accels).astype(np.float64)
    temperatures = [part.temperature_c for part in parts if part.temperature_c is not None]
    if len(temperatures) == len(parts):
        columns["temperature_c"] = np.concatenate(temperatures).astype(np.float64)
    notes = [f"{who.model} {who.firmware}".strip(), *([f"bytes not decoded: {', '.join(faults)}"] if faults else [])]
    if who.has_clock:
        columns["t_s"] = (ticks - ticks[0]) * who.tick_period_s
    elif reading.rate_hz is None:
        raise RecordingError(
            f"{path}: its {len(ticks)} samples carry no time: give the device's output data rate with --rate-hz"
            + (f"; not decoded: {', '.join(faults)}" if faults else "")
        )
    else:
        columns["counter"] = ticks
    return Table(columns, model=who.model, notes=notes, tick_s=who.tick_period_s)


def _unwrapped(ticks: NDArray[np.unsignedinteger], bits: int) -> Floats:
    """Ticks (n,) as float64, unwrapped at 2**bits."""
    steps = np.diff(ticks.astype(np.float64))
    most = 2.0**bits
    steps[steps < -most / 2] += most
    return np.concatenate([[float(ticks[0])], float(ticks[0]) + np.cumsum(steps)])
