"""Driver for flight controllers and other devices that send MAVLink messages.

The package pymavlink (extra `mavlink`) parses and checks all messages.
The driver reads only one kind of message: HIGHRES_IMU if the device sends it, else SCALED_IMU, else RAW_IMU
(https://mavlink.io/en/messages/common.html). RAW_IMU is specified "without any scaling", so its units are known only
for ArduPilot, which uses those of SCALED_IMU. Only the first inertial sensor is read. The state of the battery comes
from the first battery in BATTERY_STATUS, else from SYS_STATUS.
"""

import importlib.util
from dataclasses import replace
from typing import Any, Final

from bridge.drivers.byte_stream import Decoder, StreamOptions, stream_kind
from bridge.drivers.driver import Battery, Event, Notice
from bridge.drivers.sample_assembly import DeviceDescription, SampleAssembler
from bridge.reasons.codes import Code, Sentence
from bridge.wire.refusal import Tally

NEEDS: Final = "needs another package: pip install 'truerate[mavlink]'"
BAD_FRAME, OTHER_SYSTEM, OTHER_MESSAGE, NOT_NEW = "frame_bad", "other_system", "other_message", "gyro_not_new"
SEVERAL: Final = "several_systems"
_RANKS: Final = ("RAW_IMU", "SCALED_IMU", "HIGHRES_IMU")  # from worst to best
_CLOCKS: Final = {"RAW_IMU": (1e-6, 64), "SCALED_IMU": (1e-3, 32), "HIGHRES_IMU": (1e-6, 64)}
_MILLI_G: Final = 9.80665e-3
_GYRO_NEW, _TEMPERATURE_NEW = 0b111000, 1 << 12  # bits of HIGHRES_IMU's fields_updated
_ARDUPILOT: Final = 3
_CHARGING: Final = 7  # MAV_BATTERY_CHARGE_STATE_CHARGING
_MAX_SYSTEMS: Final = 8  # named in a notice


def available() -> bool:
    """Return True if pymavlink, the package that decodes MAVLink, is installed."""
    return importlib.util.find_spec("pymavlink") is not None


class MavlinkOptions(StreamOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of a MAVLink device.

    system: id of the system to read if one port carries several; 0 takes the first that sends inertial messages.
    Raises ValueError for an invalid option, or if pymavlink is not installed.
    """

    #: id of the system to read, 1 to 255, where one port carries several; 0 takes the first that sends inertial messages
    system: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.system <= 255:
            raise ValueError(f"system is {self.system}: use 1 to 255, or 0 for the first system heard")
        if not available():
            raise ValueError(f"the driver 'mavlink' {NEEDS}")


class MavlinkDecoder(Decoder):
    """Decoder of one MAVLink system's inertial messages. A device clock that goes back indicates a new boot.

    system: id of the system, 1 to 255; 0 takes the first that sends inertial messages, and no other system afterwards.
    """

    def __init__(self, system: int = 0) -> None:
        from pymavlink.dialects.v20 import common  # noqa: PLC0415 - optional extra

        self.faults = Tally()
        self._dialect = common
        self._system = system
        self._component: int | None = None
        self._heard: dict[int, None] = {}  # systems that send inertial messages, in the order of their first message
        self._said: Sentence | None = None
        self._autopilot = 0
        self._message = ""
        self._about = DeviceDescription(model="MAVLink")
        self._assembly = SampleAssembler(self.faults, self._about, None)  # replaced at the first message
        self._held = 0  # samples not yet returned as events
        self._has_temperature = False
        self._battery: Battery | None = None  # not yet returned as an event
        self._battery_told = False  # by BATTERY_STATUS
        self._parser = self._new_parser()

    def opened(self) -> None:
        """Reset the parser for a newly opened port. The MAVLink system to read stays the same."""
        self._parser = self._new_parser()
        self._assembly.opened()

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        """Decode received bytes; return the events (identities, readings and others) that they complete, in order.

        receive_time_ns: receive time of the last byte, ns since the Unix epoch (`host_time.now_ns`).
        """
        parser = self._parser
        for message in parser.parse_buffer(data) or ():
            self._take(message, receive_time_ns)
        if parser.buf_index:  # the parser frees read bytes only when its buffer is empty
            del parser.buf[: parser.buf_index]
            parser.buf_index = 0
        events = self._assembly.events()
        if events:
            self._held = 0
        return events and [*self._notices(), *events]

    def finish(self) -> list[Event]:
        """End the stream: return the events of samples that the decoder still holds back."""
        events = self._assembly.finish()
        return events and [*self._notices(), *events]

    def _new_parser(self) -> Any:
        parser = self._dialect.MAVLink(None)
        parser.robust_parsing = True
        return parser

    def _take(self, message: Any, receive_time_ns: int) -> None:
        kind = message.get_type()
        if kind == "BAD_DATA":
            self.faults.add(BAD_FRAME)
        elif kind in _RANKS:
            if self._is_ours(message) and self._is_best(kind):
                self._sample(kind, message, receive_time_ns)
        elif kind in ("BATTERY_STATUS", "SYS_STATUS"):
            self._battery_of(kind, message)
        elif kind == "HEARTBEAT" and self._is_from(message):
            self._autopilot = message.autopilot
            model = f"{self._word('MAV_AUTOPILOT', message.autopilot)} {self._word('MAV_TYPE', message.type)}"
            self._know(replace(self._about, model=f"MAVLink {model}, system {self._system}"))
        elif kind == "AUTOPILOT_VERSION" and self._is_from(message):
            major, minor, patch, _ = message.flight_sw_version.to_bytes(4, "big")
            self._know(replace(self._about, firmware=f"{major}.{minor}.{patch}"))

    def _is_ours(self, message: Any) -> bool:
        """Return whether an inertial message is of the selected system; the first message selects it."""
        system = message.get_srcSystem()
        if len(self._heard) < _MAX_SYSTEMS:
            self._heard[system] = None
        self._system = self._system or system
        if system == self._system and self._component is None:
            self._component = message.get_srcComponent()
        if self._is_from(message):
            return True
        self.faults.add(OTHER_SYSTEM)
        return False

    def _is_from(self, message: Any) -> bool:
        return bool(message.get_srcSystem() == self._system and message.get_srcComponent() in {self._component, None})

    def _is_best(self, kind: str) -> bool:
        """Return whether the device sends no better kind of message.

        A better kind restarts the assembly, because its clock differs.
        """
        unknown = kind == "RAW_IMU" and self._autopilot != _ARDUPILOT
        if unknown or (self._message and _RANKS.index(kind) < _RANKS.index(self._message)):
            self.faults.add(OTHER_MESSAGE)
            return False
        if kind != self._message:
            self.faults.add(OTHER_MESSAGE, self._held)
            self._message, self._held, self._has_temperature = kind, 0, False
            self._assembly = SampleAssembler(self.faults, self._about, *_CLOCKS[kind])
        return True

    def _sample(self, kind: str, message: Any, receive_time_ns: int) -> None:
        rates = (message.xgyro, message.ygyro, message.zgyro)
        forces = (message.xacc, message.yacc, message.zacc)
        if kind == "HIGHRES_IMU":
            new = message.fields_updated  # 0 where the sender does not fill it in
            if message.id or (new and new & _GYRO_NEW != _GYRO_NEW):
                self.faults.add(NOT_NEW if not message.id else OTHER_MESSAGE)
                return
            tick, celsius = message.time_usec, message.temperature
            self._has_temperature |= bool(new & _TEMPERATURE_NEW)
        else:
            if kind == "RAW_IMU" and message.id:
                self.faults.add(OTHER_MESSAGE)
                return
            tick = message.time_usec if kind == "RAW_IMU" else message.time_boot_ms
            celsius = message.temperature / 100
            self._has_temperature |= message.temperature != 0
            rates = (rates[0] * 1e-3, rates[1] * 1e-3, rates[2] * 1e-3)
            forces = (forces[0] * _MILLI_G, forces[1] * _MILLI_G, forces[2] * _MILLI_G)
        temperature_c = celsius if self._has_temperature else None
        self._assembly.add(tick, rates, forces, temperature_c, receive_time_ns=receive_time_ns)
        self._held += 1

    def _battery_of(self, kind: str, message: Any) -> None:
        """Note the battery of the selected system; any component of the system may send it. -1 is unknown."""
        first = kind == "SYS_STATUS" or message.id == 0
        ours = first and message.get_srcSystem() == self._system
        known = 0 <= message.battery_remaining <= 100
        if not (ours and known) or (kind == "SYS_STATUS" and self._battery_told):
            return
        self._battery_told |= kind == "BATTERY_STATUS"
        charging = kind == "BATTERY_STATUS" and message.charge_state == _CHARGING
        self._battery = Battery(float(message.battery_remaining), charging)

    def _know(self, about: DeviceDescription) -> None:
        self._about = self._assembly.about = about

    def _word(self, enum: str, value: int) -> str:
        entry = self._dialect.enums[enum].get(value)
        name = str(entry.name) if entry is not None else f"{enum}_{value}"
        return name.removeprefix(f"{enum}_").lower().replace("_", " ")

    def _notices(self) -> list[Event]:
        others = sorted(self._heard.keys() - {self._system})
        named = ", ".join(map(str, others))
        said = Code.SEVERAL_SYSTEMS(system=self._system, others=named) if others else None
        news = said != self._said
        self._said = said
        battery, self._battery = self._battery, None
        return [*([Notice(SEVERAL, said)] if news else []), *([battery] if battery else [])]


KIND = stream_kind(
    "mavlink",
    "MAVLink, HIGHRES_IMU or SCALED_IMU: port, baud, system" + ("" if available() else f"; {NEEDS}"),
    MavlinkOptions,
    lambda options: MavlinkDecoder(options.system if options is not None else 0),
    auto=available(),
)
