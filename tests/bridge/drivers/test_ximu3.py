"""The x-IMU3 driver: bytes in any chunking, what it asks and sets, reboots, losses, rates."""

import json
from math import radians
from typing import Any

import numpy as np
import pytest

from bridge.drivers.driver import Battery, Event, Identity, Notice, Readings
from bridge.drivers.ximu3 import Ximu3Decoder, Ximu3Options
from bridge.framing.ximu3 import plain
from bridge.reasons.codes import Code
from bridge.wire.messages import BootCause
from tests.bridge.drivers.emulated_line import Wire
from tests.bridge.framing import ximu3_encode

MS = 1_000_000
CORRECTION, DIVISOR = "gyroscope_offset_correction_enabled", "inertial_message_rate_divisor"


class Device:
    """Settings and a stream, as the manual has them. deaf: commands are lost; mute: answers are."""

    def __init__(self, *, refuses: bool = False, divisor: int = 8) -> None:
        self.settings: dict[str, object] = {
            "firmware_version": "v1.2.3",
            "hardware_version": "v3",
            CORRECTION: True,
            DIVISOR: divisor,
        }
        self.refuses = refuses
        self.deaf = self.mute = False
        self.heard: list[bytes] = []
        self._pending: dict[str, object] = {}
        self._said = b""
        self._now_us = self._sampled_us = 7_000_000

    def reboot(self) -> None:
        """Lose power: what was set and not saved is lost too."""
        self._now_us = self._sampled_us = 0
        self.settings[CORRECTION] = True

    def receive(self, data: bytes) -> None:
        if data and not self.deaf:
            self.heard.append(data)
            assert data.count(b"\n") == 1
            ((key, value),) = json.loads(data).items()
            answer = json.dumps({key: self._answer(plain(key), value)}, separators=(",", ":"))
            self._said += b"" if self.mute else answer.encode() + b"\n"

    def _answer(self, key: str, value: object) -> object:
        if key == "ping":
            return {"interface": "USB", "name": "x-IMU3", "sn": "0123-4567-89AB-CDEF"}
        if key == "apply":
            self.settings |= self._pending
            self._pending = {}
            return None
        name = next((name for name in self.settings if plain(name) == key), None)
        if name is None:
            return {"error": "Unknown command"}
        if value is not None and self.refuses:
            return {"error": "Read-only"}
        if value is not None:
            self._pending[name] = value
        return self._pending.get(name, self.settings[name])

    def advance(self, seconds: float) -> bytes:
        said, self._said = self._said, b""
        self._now_us += round(1e6 * seconds)
        period_us = 2500 * int(str(self.settings[DIVISOR]))
        times = []
        while self._sampled_us + period_us <= self._now_us:
            self._sampled_us += period_us
            times.append(self._sampled_us)
        ones = np.ones((len(times), 3))
        return said + b"".join(ximu3_encode.inertial(np.array(times, np.int64), ones, ones))


def asking(**more: Any) -> Ximu3Decoder:
    return Ximu3Decoder(Ximu3Options(port="/dev/x", **more))


def sequences(events: list[Event]) -> list[int]:
    return [n for e in events if isinstance(e, Readings) for n in range(e.sequence, e.sequence + len(e.ticks))]


def complete(run: Wire[Device], samples: int, unsettled: int) -> bool:
    """Whether of so many samples all came in order, but at most `unsettled` before the device had answered."""
    faults = run.decoder.faults.as_dict()
    dropped = faults.pop("samples_before_settled", 0)
    return not faults and dropped <= unsettled and sequences(run.events) == list(range(samples - dropped))


def inertial(times_us: list[int]) -> list[bytes]:
    n = len(times_us)
    gyro = np.arange(3.0 * n).reshape(n, 3) % 7
    return ximu3_encode.inertial(np.array(times_us, np.int64), gyro, gyro + 1)


def test_a_device_is_named_by_its_serial_number_and_its_own_correction_turned_off() -> None:
    run = Wire(Device(), asking())
    run.run(2.0)
    (identity,) = run.identities
    assert (identity.model, identity.firmware) == ("x-IMU3 0123-4567-89AB-CDEF", "v1.2.3 (hardware v3)")
    assert identity.rate_hz == 50.0
    assert identity.gyro_range == pytest.approx(radians(2000))
    assert run.device.settings[CORRECTION] is False
    assert run.notices == []
    assert complete(run, 100, 10)
    assert not any(b"save" in command for command in run.device.heard)
    heard = len(run.device.heard)
    run.run(5.0)
    assert len(run.device.heard) == heard  # it is left alone once all is answered


def test_samples_come_out_in_si_units_with_the_latest_temperature() -> None:
    decoder = Ximu3Decoder()
    time_us = 5_000_000 + 20_000 * np.arange(80)
    text = b"".join(b"I,%d,90.0000,-180.0000,0.5000,0.0000,-1.0000,2.0000\n" % t for t in time_us[:40])
    binary = b"".join(ximu3_encode.inertial(time_us[40:], np.full((40, 3), 0.1), np.full((40, 3), 9.0)))
    events = decoder.feed(b"T,5,25.5000\n" + text + ximu3_encode.temperature(6, 30.0) + binary, 10**18)
    events += decoder.feed(b"", 10**18 + 2_000 * MS)
    readings = [event for event in events if isinstance(event, Readings)]
    gyro, accel, warmth = (
        np.concatenate([np.asarray(getattr(r, name)) for r in readings]) for name in ("gyro", "accel", "temperature_c")
    )
    assert np.concatenate([r.ticks for r in readings]).tolist() == time_us.tolist()
    assert np.allclose(gyro[:40], [np.pi / 2, -np.pi, radians(0.5)])
    assert np.allclose(accel[:40], [0, -9.80665, 19.6133])
    assert np.allclose(gyro[40:], 0.1)
    assert np.allclose(accel[40:], 9.0)
    assert np.allclose(warmth[:40], 25.5)
    assert np.allclose(warmth[40:], 30.0)


def test_battery_and_messages_are_passed_on() -> None:
    decoder = Ximu3Decoder()
    said = ximu3_encode.battery(1, 55.5, charging=True) + b"B,2,54.0,4.0,0\n"
    said += b"".join(b"N,%d,note %d\n" % (i, i) for i in range(5)) + b"F,9,Battery empty.\n"
    events = decoder.feed(said, 1)
    assert [event for event in events if isinstance(event, Battery)] == [Battery(55.5, charging=True), Battery(54.0)]
    notices = [event for event in events if isinstance(event, Notice)]
    assert notices[-2:] == [
        Notice("notification", Code.DEVICE_SAYS(words="note 2 | note 3 | note 4")),
        Notice("error", Code.DEVICE_REPORTS_ERROR(words="Battery empty.")),
    ]


def test_a_device_that_boots_is_asked_anew() -> None:
    run = Wire(Device(), asking())
    run.run(3.0)
    assert run.device.settings[CORRECTION] is False
    run.device.reboot()
    run.run(3.0)
    assert [identity.boot_cause for identity in run.identities] == [BootCause.PORT_OPENED, BootCause.POWER_UP]
    assert run.device.settings[CORRECTION] is False


def test_a_device_that_refuses_is_said_to_disturb_until_it_no_longer_does() -> None:
    run = Wire(Device(refuses=True), asking())
    run.run(3.0)
    assert "Turn" in run.notices[-1]
    run.device.settings[CORRECTION] = False
    run.decoder.opened()
    before = len(run.events)
    last = [event for event in run.run(2.0).events[before:] if isinstance(event, Notice)]
    assert last == [Notice("on-device correction", None)]


def test_settings_may_be_left_alone() -> None:
    run = Wire(Device(), asking(rate_hz=100, keep_settings=True))
    run.run(3.0)
    assert all(b"null" in command for command in run.device.heard)
    assert run.device.settings[CORRECTION] is True
    assert "Turn" in run.notices[-1]


def test_an_opened_port_loses_nothing_once_the_device_has_answered() -> None:
    run = Wire(Device(), asking())
    run.device.deaf = True
    run.run(0.4)
    run.decoder.opened()
    run.run(3.0)
    assert complete(run, 170, 70)


def test_nothing_is_needed_of_a_device_that_only_sends() -> None:
    device = Device()
    device.deaf = True
    run = Wire(device, asking())
    run.run(20.0)
    assert complete(run, 1000, 50)
    assert "may correct" in run.notices[-1]
    (identity,) = run.identities
    assert (identity.model, identity.rate_hz) == ("x-IMU3", 50.0)
    device.deaf = False
    device.reboot()  # now it is asked again, and it answers
    run.run(2.0)
    assert run.identities[-1].model == "x-IMU3 0123-4567-89AB-CDEF"
    assert device.settings[CORRECTION] is False


@pytest.mark.parametrize("lost", ["questions", "answers"])
def test_what_is_lost_on_the_way_is_asked_again(lost: str) -> None:
    device = Device()
    device.deaf, device.mute = lost == "questions", lost == "answers"
    run = Wire(device, asking())
    run.run(1.5)
    device.deaf = device.mute = False
    run.run(5.0)
    assert device.settings[CORRECTION] is False
    assert run.notices == []
    assert complete(run, 325, 50)


def test_a_chosen_rate_is_set() -> None:
    run = Wire(Device(), asking(rate_hz=100))
    run.run(3.0)
    assert run.device.settings[DIVISOR] == 4
    (identity,) = run.identities
    assert identity.rate_hz == 100.0
    assert run.decoder.faults.as_dict().keys() == {"samples_before_settled"}
    numbers = sequences(run.events)
    assert numbers == list(range(len(numbers)))


@pytest.mark.parametrize("rate_hz", [25, 100, 400])
def test_a_chosen_rate_is_set_again_after_a_reboot_and_nothing_seems_to_be_missing(rate_hz: int) -> None:
    run = Wire(Device(), asking(rate_hz=rate_hz))
    run.run(3.0)
    run.device.reboot()
    run.device.settings[DIVISOR] = 8  # the chosen rate was not saved
    run.run(3.0)
    assert run.identities[-1].rate_hz == rate_hz
    of_boot = [sequences([event]) for event in run.readings if event.boot == run.identities[-1].boot]
    numbers = [number for part in of_boot for number in part]
    assert numbers == list(range(len(numbers)))


def test_a_device_that_is_switched_on_long_after_the_bridge_is_still_asked() -> None:
    run = Wire(Device(), asking())
    for _ in range(30):
        run.now_ns += 10**9
        run.decoder.feed(b"", run.now_ns)
        run.decoder.to_send()
    run.run(3.0)
    assert run.device.settings[CORRECTION] is False


def test_a_rate_is_told_as_the_one_the_device_was_made_for() -> None:
    for period_us, rate_hz in [(20_055, 50.0), (19_950, 50.0), (2_503, 400.0), (9_615, 1e6 / 9_615)]:
        decoder = Ximu3Decoder()
        events = decoder.feed(b"".join(inertial([9_000_000 + period_us * i for i in range(40)])), 1)
        events += decoder.feed(b"", 2_000 * MS)
        assert [event.rate_hz for event in events if isinstance(event, Identity)] == [pytest.approx(rate_hz)]
