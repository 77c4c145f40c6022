"""Driver for devices that print text lines, described by a profile (`bridge/text/profile.py`): header, banners, samples."""

import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec

from bridge.drivers.byte_stream import Decoder, StreamOptions, stream_kind
from bridge.drivers.driver import Battery, Event, Notice
from bridge.drivers.sample_assembly import DeviceDescription, SampleAssembler
from bridge.framing.lines import ANY_END, Line, Lines
from bridge.reasons.codes import Code, Sentence
from bridge.text.line_parser import DECIMAL_TICK_S, CsvReader, Header, Reader, Refused, RegexReader, Row
from bridge.text.profile import Profile, load_profile, shipped
from bridge.text.units import TICKS
from bridge.toml.loader import ConfigError
from bridge.transport import address
from bridge.wire.refusal import Tally

LINE_TOO_LONG, LINE_BEGUN, LINE_CUT, BANNER_ODD = "line_too_long", "line_begun", "line_cut", "banner_odd"
SCALE_FAULT, NO_CLOCK = "known_scale_fault", "no_clock"
_COUNTED_HZ = 100.0
MAX_LINE = 1024  # bytes; a header row of many sensors has some hundreds


class TextDecoder(Decoder):
    """Decoder of the text lines that one text profile describes.

    rate_hz (Hz), gyro_range (rad/s): this device's own sample rate and full-scale range; 0 uses the profile's.
    refused: called with the reason and the text of each rejected line.
    captured: True for a capture whose receive times are unknown; the device's own clock is used instead.
    file: True if the data is a file, whose first line is complete.
    Without `file` or `captured`, the first line after opening may be the end of a longer line. That line is accepted
    only if it is a banner, which a device prints at start-up.
    """

    def __init__(
        self,
        profile: Profile,
        rate_hz: float = 0.0,
        gyro_range: float = 0.0,
        refused: Callable[[Refused, str], None] | None = None,
        *,
        captured: bool = False,
        file: bool = False,
    ) -> None:
        self.faults = Tally()
        self._profile = profile
        self._captured, self._told = captured, 0
        self._file = file or captured
        self._refused = refused
        self._lines = Lines(MAX_LINE, ANY_END)
        self._banners = [re.compile(rf"(?:{banner})\Z") for banner in profile.banners]
        self._ignore = [re.compile(pattern) for pattern in profile.ignore]
        device = profile.device
        self._about = DeviceDescription(
            model=device.model,
            firmware=device.firmware,
            gyro_range=gyro_range or math.radians(device.gyro_range_dps),
            rate_hz=rate_hz or device.rate_hz,
        )
        # The layout from a header row outlives a lost port: a device that did not restart does not repeat its header.
        self._reader: Reader = (
            RegexReader(profile)
            if profile.regex is not None
            else CsvReader(profile, needs_clock=not self._about.rate_hz)
        )
        self._booting = False  # a banner came, and no sample since
        self._clock = self._reader.has_clock is not False
        self._assembly = self._assemble()
        self._said: dict[str, Sentence] = {}
        self._percent = math.nan  # charge of the battery

    def opened(self) -> None:
        """Drop an unfinished line, because the port was opened (again)."""
        self._lines.opened()
        self._assembly.opened()

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        """Decode received bytes; return the events (identities, readings and others) that they complete, in order.

        receive_time_ns: receive time of the last byte, ns since the Unix epoch (`host_time.now_ns`).
        """
        events: list[Event] = []
        for line in self._lines.feed(data):
            events += self._take(line, receive_time_ns)
        events += self._assembly.events()
        return [*self._notices(), *events] if events else []

    def finish(self) -> list[Event]:
        """End the stream: return the events of samples still held back, even if the sample rate is unknown."""
        events = self._assembly.finish()
        return [*self._notices(), *events] if events else []

    def _take(self, line: Line, receive_time_ns: int) -> list[Event]:
        """Decode one line; returns events only of a changed battery, or if a header row ends the samples before it."""
        text = line.data.decode("utf-8", "replace").strip()
        if not text:
            return []
        if line.too_long:
            self._refuse(
                Refused(LINE_BEGUN if line.begun else LINE_TOO_LONG, "the line is incomplete or too long"), text
            )
        elif self._is_banner(text):
            self._booting = True
            self._assembly.rebooted()
        elif line.begun and not self._file:
            self._refuse(Refused(LINE_BEGUN, "the first line after opening the port may be incomplete"), text)
        elif not any(pattern.fullmatch(text) for pattern in self._ignore):
            read = self._reader.read(text)
            if isinstance(read, Header):
                return self._began()
            if isinstance(read, Row):
                self._booting = False
                came_ns = self._told_ns(read.tick) if self._captured else receive_time_ns
                self._assembly.add(*read[:4], receive_time_ns=came_ns)
                if read.battery_percent is not None and read.battery_percent != self._percent:
                    self._percent = read.battery_percent
                    return [Battery(read.battery_percent)]
            else:
                self._refuse(read, text)
        return []

    def _told_ns(self, tick: int) -> int:
        """Receive time by the device's clock, in ns; a counter lower by more than half a turn has wrapped."""
        turn = 1 << self._tick_bits
        step = (tick - self._told) % turn
        self._told += step if step < turn // 2 else step - turn
        return round(self._told * self._tick_s * 1e9)

    def _is_banner(self, text: str) -> bool:
        """Return whether the line is a boot banner; stores the model, firmware, range and rate it names."""
        match = next((match for banner in self._banners if (match := banner.search(text))), None)
        if match is None:
            return False
        if match.start():
            self._refuse(Refused(LINE_CUT, "cut off by a restart"), text)
        said = {name: value for name, value in match.groupdict().items() if value}
        told = self._about
        try:
            self._about = replace(
                told,
                model=said.get("model", told.model),
                firmware=said.get("firmware", told.firmware),
                gyro_range=math.radians(_amount(said["gyro_range_dps"]))
                if "gyro_range_dps" in said
                else told.gyro_range,
                rate_hz=_amount(said["rate_hz"]) if "rate_hz" in said else told.rate_hz,
            )
        except ValueError as error:
            self._refuse(Refused(BANNER_ODD, str(error)), text)
        self._assembly.about = self._about_it()
        return True

    def _began(self) -> list[Event]:
        """Handle a header row: the device may have gained or lost its time column."""
        if self._clock == (self._reader.has_clock is not False):
            return []
        self._clock = not self._clock
        events = self._assembly.events()
        self._assembly = self._assemble()
        if self._booting:
            self._assembly.rebooted()
        return events

    def _assemble(self) -> SampleAssembler:
        time = self._profile.time
        self._tick_s, self._tick_bits = 0.0, 64
        if time is None or not self._clock:
            return SampleAssembler(self.faults, self._about_it(), None)
        if time.width:
            self._tick_s, self._tick_bits = TICKS[time.unit], time.width
        else:
            self._tick_s = DECIMAL_TICK_S
        return SampleAssembler(self.faults, self._about_it(), self._tick_s, self._tick_bits)

    def _about_it(self) -> DeviceDescription:
        """The device description; a device with a clock has its rate measured, not taken from the profile."""
        if self._profile.time is None or not self._clock:
            return self._about
        promised_hz = self._about.rate_hz
        return replace(self._about, rate_hz=0.0, guessed_rate_hz=promised_hz or self._about.guessed_rate_hz)

    def _refuse(self, refused: Refused, text: str) -> None:
        self.faults.add(refused.fault)
        if self._refused is not None:
            self._refused(refused, text)

    def _notices(self) -> list[Event]:
        """Notices that are new, changed or withdrawn."""
        notices = {name: Code.PROFILE_NOTICE(words=text) for name, text in self._profile.notices.items()}
        range_dps = math.degrees(self._about.gyro_range)
        known = self._profile.known_scale_faults
        faults = [fault for fault in known if abs(fault.gyro_range_dps - range_dps) < 1 or not fault.gyro_range_dps]
        for number, fault in enumerate(faults, 1):
            notices[SCALE_FAULT if number == 1 else f"{SCALE_FAULT}_{number}"] = fault.said
        if self._profile.time is not None and not self._clock:
            notices[NO_CLOCK] = Code.NO_TIME_COLUMN(
                column=repr(self._profile.time.column), rate_hz=f"{self._about.rate_hz:g}"
            )
        news = [*notices.items(), *((name, None) for name in self._said.keys() - notices.keys())]
        said = [Notice(name, one) for name, one in news if self._said.get(name) != one]
        self._said = notices
        return list[Event](said)


def _amount(text: str) -> float:
    value = float(text)
    if not 0 < value <= 10_000:
        raise ValueError(f"{text!r} is out of range: use 0 to 10000")
    return value


class TextOptions(StreamOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of a device that prints text lines, described by a profile. Raises ValueError for an invalid option.

    profile: name of a shipped profile, or path of a file. rate_hz (Hz), gyro_range_dps (°/s), baud (bits per second): 0
    uses the profile's value.
    """

    #: name of a shipped profile, for example `nano-33-ble`, or the path of an own `.toml` file
    profile: str
    #: output data rate, Hz, for example 100; 0 takes the profile's. Needed if neither the device nor the profile gives a time
    rate_hz: float = 0.0
    #: full-scale range of the gyro, °/s, for example 2000; 0 takes the profile's
    gyro_range_dps: float = 0.0
    #: speed of a serial port, bits per second, for example 115200; 0 takes the profile's
    baud: int = 0

    def __post_init__(self) -> None:
        try:
            profile = load_profile(self.profile)
        except ConfigError as error:
            raise ValueError(str(error)) from None
        for key in ("rate_hz", "gyro_range_dps"):
            if not 0 <= getattr(self, key) <= 10_000:
                raise ValueError(f"{key} is {getattr(self, key):g}: use 0 (the profile's value) to 10000")
        if profile.time is None and not (profile.device.rate_hz or self.rate_hz):
            raise ValueError(
                f"rate_hz is missing: devices of profile {self.profile!r} send no time. Give the samples per "
                "second that the device's own program sends"
            )
        if not self.baud:
            msgspec.structs.force_setattr(self, "baud", profile.baud)
        address.check(self.port, self.baud)


def _decoder(options: TextOptions) -> TextDecoder:
    gyro_range = math.radians(options.gyro_range_dps)
    file = options.port.startswith("file://")
    return TextDecoder(load_profile(options.profile), options.rate_hz, gyro_range, file=file)


def _variants() -> list[dict[str, Any]]:
    """Return the profiles as option tables. A profile without a rate gets 100 Hz, which `bridge scan` corrects by counting."""
    profiles = {name: load_profile(name) for name in shipped()}
    return [
        {"profile": name}
        if profile.time is not None or profile.device.rate_hz
        else {"profile": name, "rate_hz": _COUNTED_HZ}
        for name, profile in profiles.items()
    ]


KIND = stream_kind(
    "text_profile",
    "lines of text, described by a profile: port, profile, baud, rate_hz, gyro_range_dps (`truerate bridge profiles`)",
    TextOptions,
    _decoder,
    variants=_variants,
)
