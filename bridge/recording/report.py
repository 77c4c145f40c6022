"""Report of a survey of recordings: as printed tables, or as JSON."""

from datetime import UTC, datetime
from typing import Any

from rich.console import Console

from bridge.reasons.catalogue import english, sentences_as_json
from bridge.recording.survey import Boot, Device, Survey
from bridge.terminal.plurals import count
from bridge.terminal.tables import Column, Columns
from bridge.wire.keys import boot_id

_COLUMNS = (
    Column("device", least=20),
    Column("boot", number=True, spare=3),
    Column("from", number=True, spare=4),
    Column("seconds", number=True, spare=2),
    Column("Hz", number=True, spare=1),
    *(Column(heading, number=True) for heading in ("samples", "missing", "corrected", "good")),
)


def show(console: Console, survey: Survey) -> None:
    """Print a survey of recordings: a table of boots, then calibrations and notes, refused messages and damage."""
    wards = ", ".join(sorted(survey.wards)) or "?"
    console.print(
        f"ward {wards}: {count(len(survey.devices), 'device')}, {_clock(survey.first_ns)} to {_clock(survey.last_ns)} UTC, "
        f"{survey.duration_s:.1f} s, {count(survey.messages, 'message')}, {survey.size / 1e6:.1f} MB",
        highlight=False,
        soft_wrap=True,
    )
    table = Columns(_COLUMNS)
    for name, device in survey.devices.items():
        for boot in _boots(device):
            table.add(name, *_row(boot))
    console.print(table)
    for name, device in survey.devices.items():
        for line in _told(device):
            console.print(f"{name}: {line}", highlight=False, soft_wrap=True)
    if refused := survey.refused.as_dict():
        counts = ", ".join(f"{n} {reason}" for reason, n in refused.items())
        console.print(f"messages not understood: {counts}", highlight=False, soft_wrap=True)
    for words in survey.trouble:
        console.print(f"{words}; make a complete file with truerate recording recover", highlight=False, soft_wrap=True)


def as_json(survey: Survey) -> dict[str, Any]:
    """Return a survey of recordings as one JSON-compatible object.

    Keys, with the values of `Survey`: wards, first_ns, last_ns, duration_s, messages, bytes (size of the files),
    refused, trouble, and devices by id.
    Keys of a device: model, firmware, rate_hz, boots (as in `survey.Boot`), calibrations (as in `Calibration`) and
    notes (time_ns, who, text). Times in ns are host times since the Unix epoch. Biases are in rad/s, sensor frame.
    """
    return {
        "wards": sorted(survey.wards),
        "first_ns": survey.first_ns,
        "last_ns": survey.last_ns,
        "duration_s": survey.duration_s,
        "messages": survey.messages,
        "bytes": survey.size,
        "refused": survey.refused.as_dict(),
        "trouble": survey.trouble,
        "devices": {name: _device(device) for name, device in survey.devices.items()},
    }


def _device(device: Device) -> dict[str, Any]:
    info = device.info
    about = {} if info is None else {"model": info.model, "firmware": info.firmware, "rate_hz": info.rate_hz}
    return {
        **about,
        "boots": [
            {
                "boot": boot_id(boot.boot),
                "first_ns": boot.first_ns,
                "last_ns": boot.last_ns,
                "samples": boot.samples,
                "missing": boot.missing,
                "gaps": boot.gaps,
                "repeated": boot.repeated,
                "measured_rate_hz": boot.rate_hz,
                "corrected": dict(boot.corrected),
            }
            for boot in _boots(device)
        ],
        "calibrations": [
            {
                "id": c.id,
                "boot": boot_id(c.boot),
                "time_ns": c.time_ns,
                "method": c.method,
                "verdict": c.verdict.name.lower(),
                "reason": sentences_as_json(c.reason),
                "matrix": c.matrix.tolist(),
                "bias_rad_s": c.bias.tolist(),
                "who": c.who,
            }
            for c in device.calibrations.values()
        ],
        "notes": [{"time_ns": n.time_ns, "who": n.who, "text": n.text} for n in device.notes.values()],
    }


def _boots(device: Device) -> list[Boot]:
    """Boots with readings; other boots are of corrected rates from before the recording, which the bus had kept."""
    return [boot for boot in device.boots.values() if boot.samples] or list(device.boots.values())


def _row(boot: Boot) -> tuple[str, ...]:
    corrected = boot.corrected.total()
    return (
        boot_id(boot.boot)[:8],
        _clock(boot.first_ns)[-8:],
        f"{(boot.last_ns - boot.first_ns) * 1e-9:.1f}",
        f"{boot.rate_hz:.2f}",
        str(boot.samples),
        f"{boot.missing} in {boot.gaps}" if boot.gaps else "0",
        f"{corrected / boot.samples:.0%}" if boot.samples else "",
        f"{boot.corrected['GOOD'] / corrected:.0%}" if corrected else "",
    )


def _told(device: Device) -> list[str]:
    moments = [
        (c.time_ns, f"calibration {c.verdict.name.lower()} ({c.method}): {english(*c.reason)}")
        for c in device.calibrations.values()
    ]
    moments += [(note.time_ns, f"note by {note.who}: {note.text}") for note in device.notes.values()]
    return [f"{_clock(time_ns)} {words}" for time_ns, words in sorted(moments)]


def _clock(time_ns: int) -> str:
    return f"{datetime.fromtimestamp(time_ns / 1e9, UTC):%Y-%m-%d %H:%M:%S}" if time_ns else "?"
