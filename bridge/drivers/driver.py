"""The contract of a driver: what a device says, as events, whatever carries it.

A driver opens its device, reads, and closes. It knows nothing of the bus, of clocks or of gaps: `intake` does that for all.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Sentence
from bridge.wire.messages import BootCause
from bridge.wire.refusal import Tally


@dataclass(frozen=True, slots=True)
class Identity:
    """Who the device is, said at boot and again at any time; the same boot may be told again.

    tick_bits: width of the device's tick counter, for unwrapping; sequence_bits likewise.
    has_clock: False where the device tells no time: its ticks are then a count of its samples, its rate a promise; time is
    made of them by the intake.
    """

    boot: int
    boot_cause: BootCause
    model: str
    firmware: str
    rate_hz: float
    gyro_range: float
    tick_period_s: float
    has_accel: bool
    has_temperature: bool
    tick_bits: int = 32
    sequence_bits: int = 32
    has_clock: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """n consecutive samples as the device sent them: gyro (n, 3) rad/s, accel (n, 3) m/s², temperature_c (n,).

    ticks (n,) and sequence are as sent, wrapping at Identity's widths. clipped (n,): whose rates are beyond its range, as the
    device itself says; None: of none. receive_time_ns is by `host_time.now_ns`, a clock that nobody sets. Not yet validated.
    """

    boot: int
    sequence: int
    receive_time_ns: int
    ticks: NDArray[np.unsignedinteger]
    gyro: NDArray[np.floating]
    accel: NDArray[np.floating] | None
    temperature_c: NDArray[np.floating] | None
    clipped: NDArray[np.bool_] | None = None


@dataclass(frozen=True, slots=True)
class Battery:
    """How full the device's battery is, 0 to 100 %."""

    percent: float
    charging: bool = False


@dataclass(frozen=True, slots=True)
class Notice:
    """What a person should know of the device: its own messages, settings that disturb.

    A later notice of the same name replaces it; said None: it is no longer so.
    """

    name: str
    said: Sentence | None


Event = Identity | Readings | Battery | Notice


class Driver(Protocol):
    """One device. `faults` counts what it could not understand, by label; it lives as long as the driver.

    place: where the device is, for people: a port, a file.
    """

    faults: Tally
    place: str

    def open(self) -> None:
        """Open the device; raises DeviceUnavailable."""

    def read(self, timeout_s: float) -> list[Event]:
        """What came, waiting at most timeout_s for the first of it; raises DeviceLost. Called from one thread."""

    def close(self) -> None:
        """Close; never raises, a second close does nothing. May be called from another thread to end a read."""


@dataclass(frozen=True, slots=True)
class DriverKind:
    """A kind of driver, under the name the configuration calls it by.

    summary: one line for people. options: the Struct of what it takes beside `id` and `driver`; `make` and `state` are
    given one. state says in a few words whether the device could be opened now, without opening it. decoder makes what
    understands its bytes, of options or of None; without one, unknown bytes are not tried as its. variants: what options,
    beside port and baud, to try on unknown bytes, one table each, where the bytes alone do not say; decoder is then given
    those.
    """

    name: str
    summary: str
    options: type[msgspec.Struct]
    make: Callable[[Any], Driver]
    state: Callable[[Any], str]
    decoder: Callable[[Any], Any] | None = None
    variants: Callable[[], Sequence[dict[str, Any]]] = lambda: ({},)
