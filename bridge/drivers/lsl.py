"""Driver for any IMU stream of the Lab Streaming Layer (LSL), received by the package pylsl (extra `lsl`).

A lost stream is treated as an unplugged device; the driver looks for it again. LSL gives each outlet a new id (uid)
when its program opens it. A different uid counts as a new boot.
"""

import importlib.util
import threading
from math import radians
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from msgspec import Struct

from bridge.drivers.driver import DriverKind, Event, Notice
from bridge.drivers.lsl_channels import Channels, NoChannels, NoUnit, find
from bridge.drivers.sample_assembly import DeviceDescription, SampleAssembler
from bridge.reasons.codes import Code
from bridge.text.units import ACCEL, GYRO, unit_in
from bridge.transport import host_time
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.wire.refusal import Tally

if TYPE_CHECKING:
    import pylsl

NEEDS: Final = "needs another package: pip install 'truerate[lsl]'"
#: seconds to look for a stream, and to wait for its metadata and its clock
_LOOK_S, _ANSWER_S = 1.0, 3.0
_TICK_S: Final = 1e-6
#: a stamp that is older cannot be the time of a live sample: many programs stamp with a clock of their own
_LIVE_S = 1.0
#: uneven stamps: steps in a look, and the share of them that differs from their median by half
_STEPS, _UNEVEN = 500, 0.1


def available() -> bool:
    """Return True if pylsl, the package that receives LSL streams, is installed."""
    return importlib.util.find_spec("pylsl") is not None


class LslOptions(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Options of a Lab Streaming Layer stream: how to find it, and the units and channels that its metadata omit.

    Raises ValueError for an invalid option, or if pylsl is not installed.
    """

    #: name of the stream, for example `Shimmer 5F2A`; at least one of name, type and source_id is needed
    name: str = ""
    #: content type of the stream, for example `IMU`
    type: str = ""
    #: source id of the stream; it stays the same when the sender restarts
    source_id: str = ""
    #: labels of the gyro's x, y, z channels, for example `["GX", "GY", "GZ"]`; default: found by label, type and unit
    gyro: tuple[str, ...] = ()
    #: labels of the accelerometer's x, y, z channels; default: found in the same way
    accel: tuple[str, ...] = ()
    #: unit of the rates if the stream does not state it: `deg/s`, `rad/s` or `mdeg/s`
    gyro_unit: str = ""
    #: unit of the accelerations if the stream does not state it: `g`, `m/s2` or `mg`
    accel_unit: str = ""
    #: full-scale range of the gyro, °/s, for example 2000; 0 if unknown
    gyro_range_dps: float = 0.0
    #: `stamps`: the stream's time stamps are the device's clock. `count`: they are times of arrival, so samples are counted
    time: Literal["stamps", "count"] = "stamps"

    def __post_init__(self) -> None:
        if not (self.name or self.type or self.source_id):
            raise ValueError("name, type and source_id are empty: give at least one, to choose the stream")
        for label, text in (("name", self.name), ("type", self.type), ("source_id", self.source_id)):
            if "'" in text:  # LSL's queries cannot hold it
                raise ValueError(
                    f"{label} is {text!r}, but the character ' cannot be searched for: choose the stream by another property"
                )
        for label, labels in (("gyro", self.gyro), ("accel", self.accel)):
            if len(labels) not in (0, 3):
                raise ValueError(f"{label} has {len(labels)} labels: give three, for the channels of x, y and z")
        for label, unit, known in (("gyro_unit", self.gyro_unit, GYRO), ("accel_unit", self.accel_unit, ACCEL)):
            if unit and unit_in(unit, known) is None:
                raise ValueError(f"{label} is {unit!r}: use one of {', '.join(known)}")
        if not 0 <= self.gyro_range_dps <= 10_000:
            raise ValueError(f"gyro_range_dps is {self.gyro_range_dps:g}: use 0 (unknown) to 10000")
        if not available():
            raise ValueError(f"the driver 'lsl' {NEEDS}")

    @property
    def chosen(self) -> dict[str, str]:
        """Required text of the stream's properties `name`, `type` and `source_id`, by property; only those that are given."""
        given = {"name": self.name, "type": self.type, "source_id": self.source_id}
        return {label: text for label, text in given.items() if text}


class LslDriver:
    """Driver of one Lab Streaming Layer stream that carries a gyro: looks for the stream, subscribes and reads; see Driver."""

    def __init__(self, options: LslOptions) -> None:
        self.faults = Tally()
        self.place = "LSL stream " + ", ".join(f"{label} {text}" for label, text in options.chosen.items())
        self._options = options
        self._closed = threading.Event()
        self._inlet: pylsl.StreamInlet | None = None
        self._mapped = False  # whether the sender's clock is known
        self._channels: Channels | None = None
        self._uid = ""
        self._assembly = SampleAssembler(self.faults, DeviceDescription("LSL"), _TICK_S)
        self._steps: list[float] = []
        self._last_s = 0.0
        self._uneven = False

    def open(self) -> None:
        """Find the stream, read its metadata and subscribe.

        Raises DeviceUnavailable if no stream or several streams match, or if the stream lacks gyro channels or a unit.
        """
        self._closed.clear()
        lsl = _pylsl(self.place)
        found = _resolved(lsl, self._options)
        if not found:
            raise DeviceUnavailable(Code.LSL_NOT_HEARD(place=self.place))
        if len(found) > 1:
            listed = ", ".join(sorted(f"{one.name()} ({one.source_id()})" for one in found))
            raise DeviceUnavailable(Code.LSL_SEVERAL(place=self.place, listed=listed))
        inlet = lsl.StreamInlet(found[0], recover=False, as_numpy=True)
        try:
            about = inlet.info(_ANSWER_S)
            inlet.open_stream(_ANSWER_S)
        except (lsl.util.TimeoutError, lsl.util.LostError):
            raise DeviceUnavailable(Code.NO_ANSWER(place=self.place)) from None
        try:
            inlet.time_correction(_ANSWER_S)
            self._mapped = True
        except (lsl.util.TimeoutError, lsl.util.LostError):
            self._mapped = False
        self._begin(about)
        self._inlet = inlet

    def _begin(self, about: "pylsl.StreamInfo") -> None:
        """Take a stream's metadata; another uid begins another boot. Raises DeviceUnavailable."""
        given = self._options
        try:
            self._channels = find(about, given.gyro, given.accel, given.gyro_unit, given.accel_unit)
        except NoUnit as error:
            words = Code.LSL_NO_UNIT(
                place=self.place, channels=error.channels, unit=error.unit or "–", option=error.option
            )
            raise DeviceUnavailable(words) from None
        except NoChannels as error:
            listed = ", ".join(str(label) for label in about.get_channel_labels() or ()) or "–"
            raise DeviceUnavailable(Code.LSL_NO_CHANNELS(place=self.place, wanted=error, listed=listed)) from None
        if about.uid() == self._uid:  # the same boot, heard again
            self._assembly.opened()
            return
        self._uid = about.uid()
        acquisition = about.desc().child("acquisition")
        description = DeviceDescription(
            model=" ".join(filter(None, (acquisition.child_value("manufacturer"), acquisition.child_value("model"))))
            or about.name(),
            firmware=acquisition.child_value("firmware"),
            gyro_range=radians(self._options.gyro_range_dps),
            rate_hz=about.nominal_srate(),
        )
        self._assembly = SampleAssembler(self.faults, description, _TICK_S if self._options.time == "stamps" else None)
        self._steps, self._last_s, self._uneven = [], 0.0, False

    def read(self, timeout_s: float) -> list[Event]:
        """Return the events of the samples that arrived; waits at most timeout_s seconds for the first.

        Raises DeviceLost if the stream has ended or the driver is closed.
        """
        inlet, channels = self._inlet, self._channels
        if inlet is None or channels is None or self._closed.is_set():
            raise DeviceLost(Code.CLOSED(place=self.place))
        lsl = _pylsl(self.place)
        try:
            values, stamps = inlet.pull_chunk(timeout=timeout_s, max_samples=512, min_samples=1)
            correction_s = inlet.time_correction(_ANSWER_S) if self._mapped else 0.0  # known already, so no wait
        except lsl.util.LostError:
            raise DeviceLost(Code.PORT_LOST(place=self.place)) from None
        if not len(stamps):
            return []
        now_ns = host_time.now_ns()
        ages_s = lsl.local_clock() - (stamps + correction_s)
        for row, stamp, age_s in zip(values, stamps.tolist(), ages_s.tolist(), strict=True):
            self._assembly.add(
                max(0, round(stamp / _TICK_S)),
                channels.gyro.vector(row),
                None if channels.accel is None else channels.accel.vector(row),
                None if channels.temperature is None else float(row[channels.temperature]),
                receive_time_ns=now_ns - round(age_s * 1e9) if 0 <= age_s < _LIVE_S else now_ns,
            )
        return [*self._noticed(stamps), *self._assembly.events()]

    def _noticed(self, stamps: np.ndarray[Any, np.dtype[np.float64]]) -> list[Event]:
        """A notice where stamps are uneven, so that they cannot be the device's clock."""
        if self._options.time == "count" or self._uneven:
            return []
        self._steps += np.diff(stamps, prepend=self._last_s or stamps[0]).tolist()
        self._last_s = float(stamps[-1])
        if len(self._steps) < _STEPS:
            return []
        steps, self._steps = np.array(self._steps), []
        middle = np.median(steps)
        self._uneven = bool(np.mean(np.abs(steps - middle) > middle / 2) > _UNEVEN)
        return [Notice("stamps", Code.LSL_UNEVEN() if self._uneven else None)]

    def close(self) -> None:
        """Unsubscribe from the stream; a `read` in another thread ends within its timeout."""
        self._closed.set()
        self._inlet = None


def _pylsl(place: str) -> Any:
    try:
        import pylsl  # noqa: PLC0415 - optional extra
        import pylsl.util  # noqa: PLC0415
    except (ImportError, RuntimeError, OSError) as error:
        raise DeviceUnavailable(Code.PLACE_FAILED(place=place, error=str(error).splitlines()[0])) from None
    return pylsl


def _resolved(lsl: Any, options: LslOptions) -> list[Any]:
    """The streams with these properties; looks for a second one as long as there is time."""
    query = " and ".join(f"{label}='{text}'" for label, text in options.chosen.items())
    return list(lsl.resolve_bypred(query, 2, _LOOK_S))


def _state(options: LslOptions) -> str:
    try:
        return "present" if _resolved(_pylsl("LSL"), options) else "not heard"
    except DeviceUnavailable as error:
        return str(error)


KIND = DriverKind(
    name="lsl",
    summary="any IMU stream of the Lab Streaming Layer: name, type, source_id, gyro_unit, accel_unit"
    + ("" if available() else f"; {NEEDS}"),
    options=LslOptions,
    make=LslDriver,
    state=_state,
)
