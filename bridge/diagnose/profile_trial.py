"""Tries a text profile on captured output: samples understood, lines refused, and why. Pure: bytes in, words out."""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from bridge.drivers.driver import Event, Identity, Notice, Readings
from bridge.drivers.text_profile import TextDecoder
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Sentence
from bridge.terminal.plurals import count
from bridge.text.line_parser import Refused
from bridge.text.profile import Profile

SHOWN_SAMPLES: Final = 5
SHOWN_LINES: Final = 5  # per fault
_SHOWN_WIDTH = 100


@dataclass(slots=True)
class Trial:
    """Result of decoding captured text with a profile: counts, refused lines, and what to show to the operator.

    rate_known: the output data rate was given. samples: number understood. faults: counts by label.
    first: some samples, as lines of text. lines: by fault, the first refused lines, as lines of text.
    """

    rate_known: bool
    samples: int = 0
    identities: list[Identity] = field(default_factory=list)
    notices: dict[str, Sentence | None] = field(default_factory=dict)
    faults: dict[str, int] = field(default_factory=dict)
    first: list[str] = field(default_factory=list)
    lines: dict[str, list[str]] = field(default_factory=dict)

    def take(self, event: Event) -> None:
        """Add an event of the decoder (identity, notice or readings) to the result."""
        if isinstance(event, Identity):
            self.identities.append(event)
        elif isinstance(event, Notice):
            self.notices[event.name] = event.said
        elif isinstance(event, Readings):
            self.samples += len(event.ticks)
            room = SHOWN_SAMPLES - len(self.first)
            self.first += [_sample(event, i, self.identities[-1]) for i in range(min(room, len(event.ticks)))]


def attempt(profile: Profile, data: bytes, rate_hz: float = 0.0) -> Trial:
    """Decode captured bytes as the output of a device with this profile. rate_hz: output data rate, 0 if unknown."""
    trial = Trial(rate_known=bool(rate_hz or profile.device.rate_hz))
    number = 0

    def refused(what: Refused, text: str) -> None:
        shown = trial.lines.setdefault(what.fault, [])
        if len(shown) < SHOWN_LINES:
            shown.append(f"line {number}: {text[:_SHOWN_WIDTH]!r}: {what.detail}")

    decoder = TextDecoder(profile, rate_hz, refused=refused, captured=True)
    events: list[Event] = []
    for number, line in enumerate(data.splitlines(keepends=True), 1):  # noqa: B007 - used by `refused`
        events += decoder.feed(line, 0)
    for event in events + decoder.finish():
        trial.take(event)
    trial.faults = decoder.faults.as_dict()
    return trial


def report(trial: Trial, seconds: float = 0.0) -> list[str]:
    """Return the result of a trial as lines of text. seconds: duration of the capture, 0 if unknown."""
    lines = [
        f"understood: {count(trial.samples, 'sample')} in {count(len({who.boot for who in trial.identities}), 'boot')}"
    ]
    if trial.identities:
        who = trial.identities[-1]
        parts = ["rates", *["accelerations"] * who.has_accel, *["temperature"] * who.has_temperature]
        full_scale = f"±{math.degrees(who.gyro_range):g} °/s" if who.gyro_range else "unknown"
        lines += [
            f"device:     {who.model} {who.firmware}".rstrip(),
            f"rate:       {_rate(who, known=trial.rate_known)}",
            f"full scale: {full_scale}",
            f"sends:      {', '.join(parts)}",
        ]
    if seconds > 0:
        lines.append(f"counted:    {trial.samples / seconds:.4g} samples a second in {seconds:g} s")
    lines += [f"notice:     {english(said)}" for said in trial.notices.values() if said]
    if trial.first:
        lines += ["", "first samples: time s | rates °/s | accelerations m/s² | °C", *trial.first]
    if trial.faults:
        lines += ["", "not taken:"]
    for fault, n in trial.faults.items():
        lines += [f"  {n} {fault}", *(f"    {line}" for line in trial.lines.get(fault, []))]
    return lines


def _rate(who: Identity, *, known: bool) -> str:
    if who.has_clock:
        return f"{who.rate_hz:.4g} Hz, by the device's clock"
    if known:
        return f"{who.rate_hz:.4g} Hz, as given: the lines carry no time"
    return "unknown: the lines carry no time; set rate_hz in the ward's file (--seconds S measures the rate here)"


def _sample(readings: Readings, i: int, who: Identity) -> str:
    rates = "  ".join(f"{value:9.3f}" for value in np.degrees(readings.gyro[i]))
    accel = "  ".join(f"{value:8.3f}" for value in readings.accel[i]) if readings.accel is not None else "-"
    celsius = f"{readings.temperature_c[i]:.2f}" if readings.temperature_c is not None else "-"
    return f"  {float(readings.ticks[i]) * who.tick_period_s:12.4f} | {rates} | {accel} | {celsius}"
