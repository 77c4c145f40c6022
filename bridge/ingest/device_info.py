"""Builds a device's DeviceInfo message: model, sample rate, counts, battery and notices. No I/O."""

import math

from bridge.drivers.driver import Battery, Identity, Notice
from bridge.ingest.sample_clock import SampleClock
from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire.messages import BootCause, DeviceInfo
from bridge.wire.validation import MAX_TEXTS

_NOBODY = Identity(
    boot=0,
    boot_cause=BootCause.UNKNOWN,
    model="",
    firmware="",
    rate_hz=0.0,
    gyro_range=0.0,
    tick_period_s=0.0,
    has_accel=False,
    has_temperature=False,
)


class DeviceInfoBuilder:
    """Builds DeviceInfo messages of one device from its fixed names, latest battery state and notices.

    device, bridge: ids. driver: name of the driver. place: port or file of the device.
    """

    def __init__(self, device: str, bridge: str, driver: str, place: str) -> None:
        self._names = (device, bridge, driver, place)
        self._battery = Battery(math.nan)
        self._notices: dict[str, Sentence] = {}

    def note(self, event: Battery | Notice) -> None:
        """Store the latest battery state, or the latest notice of a name; at most MAX_TEXTS notices are kept."""
        if isinstance(event, Battery):
            self._battery = event
            return
        self._notices.pop(event.name, None)
        if event.said is not None:
            self._notices[event.name] = event.said
        while len(self._notices) > MAX_TEXTS:
            self._notices.pop(next(iter(self._notices)))

    def info(
        self,
        identity: Identity | None,
        boot: int,
        timeline: SampleClock,
        samples: int,
        time_ns: int,
        dropped: dict[str, int],
        events: dict[str, int],
        trouble: Sentences,
    ) -> DeviceInfo:
        """Build the DeviceInfo message of one device. time_ns: present time, ns since the Unix epoch.

        boot: published boot number. timeline: source of the measured sample rate and of notices about time. samples:
        number of samples published in this boot.
        dropped: number of dropped samples by reason. events: number of other events by label, such as `gaps`.
        trouble: reasons why the device cannot be read; () if it can.
        While the device has not identified itself (identity None), boot is 0 and the message's `trouble` gives the
        reason.
        """
        device, bridge, driver, place = self._names
        known, of_time = identity or _NOBODY, timeline.notices(identity) if identity else {}
        if identity is None:
            trouble = trouble or (Code.NOTHING_HEARD(place=place),)
        return DeviceInfo(
            device=device,
            bridge=bridge,
            boot=boot,
            boot_cause=known.boot_cause,
            model=known.model,
            firmware=known.firmware,
            driver=driver,
            port=place,
            rate_hz=known.rate_hz,
            measured_rate_hz=timeline.rate.hz,
            gyro_range=known.gyro_range,
            has_accel=known.has_accel,
            has_temperature=known.has_temperature,
            time_ns=time_ns,
            samples=samples,
            dropped=dropped,
            events=events,
            trouble=trouble,
            battery_percent=self._battery.percent,
            charging=self._battery.charging,
            # notices of the device, then of its time
            notices=(*self._notices.values(), *of_time)[-MAX_TEXTS:],
            has_clock=known.has_clock,
        )
