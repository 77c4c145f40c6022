"""The driver contract: a driver turns a device's data into events, over any transport.

A driver opens its device, reads it and closes it. The bus, clocks and gaps are the business of `bridge.ingest.intake`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from bridge.reasons.codes import Sentence
from bridge.wire.messages import BootCause, DeviceCalibration
from bridge.wire.refusal import Tally


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of a device: boot, model, rate, range. A driver sends it at each boot, and may repeat it at any time.

    rate_hz: nominal sample rate. gyro_range: full-scale range in rad/s, 0 if unknown. tick_period_s: seconds per tick.
    tick_bits, sequence_bits: widths of the device's tick counter and sequence number, for unwrapping.
    has_clock: False for a device without a clock. Its ticks then count samples, rate_hz is only nominal, and the intake
    derives the sample times.
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
    """Readings: n consecutive samples as the device sent them, not yet validated.

    gyro (n, 3) in rad/s, accel (n, 3) in m/s², temperature_c (n,) in °C.
    ticks (n,) and sequence (of the first sample) are as sent; they wrap at the widths in Identity.
    clipped (n,): samples that the device itself reports as beyond its range; None if it reports none.
    receive_time_ns is from `host_time.now_ns`, a clock that is never set.
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
    """Charge of a device's battery, 0 to 100 %, and whether it charges."""

    percent: float
    charging: bool = False


@dataclass(frozen=True, slots=True)
class Notice:
    """Message about a device for people: the device's own words, or a setting that disturbs the measurement.

    A later notice of the same name replaces this notice; said=None withdraws it.
    """

    name: str
    said: Sentence | None


Event = Identity | Readings | Battery | Notice | DeviceCalibration


class Driver(Protocol):
    """Interface of a driver, which opens, reads and closes one device.

    faults: counts the data the driver could not decode, by label, over the driver's life.
    place: where the device is, for people: a port or a file.
    """

    faults: Tally
    place: str

    def open(self) -> None:
        """Open the device. Raises DeviceUnavailable if it cannot be opened now; the caller may try again."""

    def read(self, timeout_s: float) -> list[Event]:
        """Return the events that arrived, waiting at most timeout_s for the first; [] if none. Called from one thread.

        Raises DeviceLost if the device has gone.
        """

    def close(self) -> None:
        """Close the device; never raises, and may be repeated. Another thread may call close to end a read."""


@dataclass(frozen=True, slots=True)
class DriverKind:
    """A kind of driver, under its name in the configuration: how to make one, and its options.

    summary: one line for people.
    options: the Struct of the settings besides `id` and `driver`; `make` and `state` take an instance.
    state: says in a few words whether the device could be opened now, without opening the device.
    decoder: makes the protocol's decoder, from options or from None. A kind without a decoder is left out when `bridge
    scan` identifies unknown bytes.
    variants: option tables, besides port and baud, to try on unknown bytes whose protocol alone does not decide; the
    decoder then gets those options.
    """

    name: str
    summary: str
    options: type[msgspec.Struct]
    make: Callable[[Any], Driver]
    state: Callable[[Any], str]
    decoder: Callable[[Any], Any] | None = None
    variants: Callable[[], Sequence[dict[str, Any]]] = lambda: ({},)
