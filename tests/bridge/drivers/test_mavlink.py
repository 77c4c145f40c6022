"""The MAVLink driver, on messages that pymavlink packs: units, boots by the clock, whose messages they are."""

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from bridge.drivers.driver import Battery, Event, Identity, Notice, Readings
from bridge.drivers.mavlink import MavlinkDecoder
from bridge.reasons.codes import Code
from bridge.wire.messages import BootCause

ALL_NEW = 0xFFFF


class Sender:
    """One system on a line."""

    def __init__(self, system: int = 1, component: int = 1, *, version_1: bool = False) -> None:
        self._mav = common.MAVLink(None, srcSystem=system, srcComponent=component)
        self._version_1 = version_1

    def pack(self, message: Any) -> bytes:
        packed = bytes(message.pack(self._mav, force_mavlink1=self._version_1))
        self._mav.seq = (self._mav.seq + 1) % 256
        return packed

    def highres(self, time_us: int, gyro: tuple[float, float, float] = (0.1, -0.2, 0.3), new: int = ALL_NEW) -> bytes:
        rest = (0.2, 0.1, 0.4, 1013.0, 0.0, 30.0, 36.5, new)
        return self.pack(common.MAVLink_highres_imu_message(time_us, 0.1, 0.2, -9.8, *gyro, *rest))

    def scaled(self, time_ms: int, *, temperature: int = 2550) -> bytes:
        return self.pack(
            common.MAVLink_scaled_imu_message(time_ms, 10, -20, 1000, 100, -200, 300, 1, 2, 3, temperature)
        )

    def raw(self, time_us: int) -> bytes:
        return self.pack(common.MAVLink_raw_imu_message(time_us, 10, -20, 1000, 100, -200, 300, 1, 2, 3))

    def heartbeat(self, autopilot: int = common.MAV_AUTOPILOT_PX4) -> bytes:
        return self.pack(common.MAVLink_heartbeat_message(common.MAV_TYPE_QUADROTOR, autopilot, 0, 0, 3, 3))

    def version(self) -> bytes:
        return self.pack(
            common.MAVLink_autopilot_version_message(0, 0x010E03FF, 0, 0, 0, b"\0" * 8, b"\0" * 8, b"\0" * 8, 0, 0, 0)
        )


def readings(events: list[Event]) -> list[Readings]:
    return [event for event in events if isinstance(event, Readings)]


def identities(events: list[Event]) -> list[Identity]:
    return [event for event in events if isinstance(event, Identity)]


def highres(sender: Sender, first_us: int, n: int) -> bytes:
    return b"".join(sender.highres(first_us + 5000 * i) for i in range(n))


def test_highres_imu_is_si_with_its_own_clock() -> None:
    decoder, sender = MavlinkDecoder(), Sender()
    (who, all_of_it) = decoder.feed(highres(sender, 1_700_000_000_000_000, 40), 0)
    assert isinstance(who, Identity)
    assert isinstance(all_of_it, Readings)
    assert who.rate_hz == pytest.approx(200.0)
    assert (who.tick_period_s, who.has_accel, who.has_temperature, who.has_clock) == (1e-6, True, True, True)
    assert all_of_it.gyro == pytest.approx(np.tile([0.1, -0.2, 0.3], (40, 1)))
    assert all_of_it.accel == pytest.approx(np.tile([0.1, 0.2, -9.8], (40, 1)))
    assert all_of_it.temperature_c == pytest.approx(np.full(40, 36.5))
    assert decoder.faults.as_dict() == {}


@pytest.mark.parametrize(("version_1", "temperature"), [(True, 2550), (False, 2550), (False, 0)])
def test_scaled_imu_in_either_version(version_1: bool, temperature: int) -> None:
    decoder, sender = MavlinkDecoder(), Sender(version_1=version_1)
    data = b"".join(sender.scaled((2**32 - 200 + 10 * i) % 2**32, temperature=temperature) for i in range(40))
    (who,), (all_of_it,) = identities(events := decoder.feed(data, 0)), readings(events)
    assert who.rate_hz == pytest.approx(100.0)
    assert all_of_it.gyro[0] == pytest.approx([0.1, -0.2, 0.3])
    assert all_of_it.accel is not None
    assert all_of_it.accel[0] == pytest.approx([0.0980665, -0.196133, 9.80665])
    assert who.has_temperature == (temperature != 0)  # 0 is "not measured"
    if all_of_it.temperature_c is not None:
        assert all_of_it.temperature_c[0] == pytest.approx(25.5)


def test_who_it_is_comes_with_its_heartbeat() -> None:
    decoder, sender = MavlinkDecoder(), Sender(system=7)
    decoder.feed(highres(sender, 0, 40), 0)
    events = decoder.feed(
        Sender(255, 190).heartbeat() + sender.heartbeat() + sender.version() + sender.highres(200_000), 0
    )
    (who,) = identities(events)
    assert (who.model, who.firmware) == ("MAVLink px4 quadrotor, system 7", "1.14.3")


def test_a_clock_that_goes_back_is_a_boot() -> None:
    decoder, sender = MavlinkDecoder(), Sender()
    events = decoder.feed(highres(sender, 60_000_000, 40) + highres(sender, 1000, 40), 0)
    events += decoder.feed(highres(sender, 201_000, 1), 0)
    first, second = identities(events)
    assert (first.boot_cause, second.boot_cause) == (BootCause.PORT_OPENED, BootCause.POWER_UP)
    assert decoder.faults.as_dict() == {"odd_time": 2}


def test_of_several_systems_the_first_is_read_and_the_others_are_said() -> None:
    decoder = MavlinkDecoder()
    one, two = Sender(1), Sender(2)
    data = b"".join(one.highres(5000 * i) + two.highres(9_000_000 + 5000 * i, (1, 1, 1)) for i in range(40))
    events = decoder.feed(data, 0)
    assert sum(len(event.ticks) for event in readings(events)) == 40
    assert all(np.all(event.gyro < 0.5) for event in readings(events))
    (notice,) = [event for event in events if isinstance(event, Notice)]
    assert notice.said == Code.SEVERAL_SYSTEMS(system=1, others="2")
    assert decoder.faults.as_dict() == {"other_system": 40}
    assert not [event for event in decoder.feed(one.highres(200_000), 0) if isinstance(event, Notice)]


def test_the_system_that_was_chosen_is_read() -> None:
    decoder = MavlinkDecoder(2)
    data = b"".join(Sender(1).highres(5000 * i) + Sender(2).highres(5000 * i, (1, 1, 1)) for i in range(40))
    assert np.all(readings(decoder.feed(data, 0))[0].gyro == 1)


def test_the_best_message_is_read_whichever_comes_first() -> None:
    decoder, sender = MavlinkDecoder(), Sender()
    data = b"".join(sender.scaled(5 * i) + sender.highres(5000 * i) for i in range(40))
    events = decoder.feed(data, 0)
    assert len(identities(events)) == 1
    assert sum(len(event.ticks) for event in readings(events)) == 40
    assert decoder.faults.as_dict() == {"other_message": 40}


def test_raw_imu_is_read_of_ardupilot_only() -> None:
    decoder, sender = MavlinkDecoder(), Sender()
    data = b"".join(sender.raw(5000 * i) for i in range(40))
    assert decoder.feed(data, 0) == []
    assert decoder.faults.as_dict() == {"other_message": 40}
    events = decoder.feed(sender.heartbeat(common.MAV_AUTOPILOT_ARDUPILOTMEGA) + data, 0)
    assert readings(events)[0].gyro[0] == pytest.approx([0.1, -0.2, 0.3])


def test_a_message_without_news_of_the_gyro_is_no_sample() -> None:
    decoder, sender = MavlinkDecoder(), Sender()
    data = b"".join(sender.highres(5000 * i, new=0 if i % 2 else 0b111) for i in range(80))
    assert sum(len(event.ticks) for event in readings(decoder.feed(data, 0))) == 40
    assert decoder.faults.as_dict() == {"gyro_not_new": 40}


def test_the_battery_of_the_system_that_is_read_is_told() -> None:
    decoder, sender, other = MavlinkDecoder(), Sender(1, component=180), Sender(2)

    def battery(of: Sender, percent: int, state: int = 1, number: int = 0) -> bytes:
        message = common.MAVLink_battery_status_message(number, 0, 0, 30, [3700] * 10, 0, 0, 0, percent, 0, state)
        return of.pack(message)

    def status(of: Sender, percent: int) -> bytes:
        return of.pack(common.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, percent, 0, 0, 0, 0, 0, 0))

    def told(data: bytes, at_us: int) -> list[Event]:
        events = decoder.feed(data + highres(Sender(), at_us, 40), 0)
        return [event for event in events if isinstance(event, Battery)]

    assert told(highres(Sender(), 10**6, 40) + status(sender, -1) + battery(other, 9), 2 * 10**6) == []
    assert told(status(sender, 81), 3 * 10**6) == [Battery(81.0)]
    assert told(battery(sender, 80, state=7) + battery(sender, 5, number=1), 4 * 10**6) == [
        Battery(80.0, charging=True)
    ]
    assert told(status(sender, 12), 5 * 10**6) == [], "BATTERY_STATUS knows better"
