"""Boots and sample numbers of devices that send neither."""

import itertools

from bridge.drivers.driver import Identity, Readings
from bridge.drivers.sample_assembly import DeviceDescription, SampleAssembler
from bridge.wire.refusal import Tally

MS, S = 1_000_000, 1_000_000_000
STEP = 10  # ms


def assembly(rate_hz: float = 0.0, period_s: float | None = 1e-3, bits: int = 64) -> SampleAssembler:
    return SampleAssembler(
        Tally(), DeviceDescription("m", rate_hz=rate_hz), period_s, bits, itertools.count(1).__next__
    )


def send(to: SampleAssembler, ticks: list[int], host_ns: int | None = None) -> None:
    """Samples at these ms of the device, at the same host time or the one given."""
    for tick in ticks:
        to.add(tick, (0.1, 0.2, 0.3), receive_time_ns=tick * MS if host_ns is None else host_ns)


def told(to: SampleAssembler) -> list[str]:
    """`boot cause rate` of identities, `boot:first+n` of readings."""
    words = []
    for event in to.events():
        if isinstance(event, Identity):
            words.append(f"{event.boot} {event.boot_cause.name} {event.rate_hz:g}")
        elif isinstance(event, Readings):
            words.append(f"{event.boot}:{event.sequence}+{len(event.ticks)}")
    return words


def steps(first: int, n: int) -> list[int]:
    return list(range(first, first + n * STEP, STEP))


def test_without_a_clock_every_opened_port_is_a_boot() -> None:
    one = assembly(100.0, None)
    send(one, [0])
    one.opened()
    send(one, [0])
    assert told(one) == ["1 PORT_OPENED 100", "1:0+1", "2 PORT_OPENED 100", "2:0+1"]


def test_a_changed_rate_is_told_in_the_same_boot() -> None:
    one = assembly(100.0)
    send(one, steps(0, 40))
    send(one, list(range(400, 400 + 40 * 20, 20)))
    words = told(one)
    assert words[0] == "1 PORT_OPENED 100"
    assert "1 PORT_OPENED 50" in words
    assert one.faults.as_dict() == {"rate_changed": 1}
    send(one, [1200, 1220])
    first = words[-1].split(":")[1].split("+")
    assert told(one) == [f"1:{int(first[0]) + int(first[1])}+2"]


def test_a_device_that_was_told_another_rate_misses_nothing() -> None:
    one = assembly()
    send(one, steps(0, 40))
    one.paced(25.0)
    send(one, [430 + 40 * i for i in range(40)])
    assert told(one) == ["1 PORT_OPENED 100", "1:0+40", "1 PORT_OPENED 25", "1:40+40"]
    assert one.faults.as_dict() == {}


def test_a_clock_that_stands_still_keeps_nothing_for_ever_and_all_is_counted() -> None:
    one, n = assembly(), 10_000
    for i in range(n):
        one.add(0, (0.1, 0.2, 0.3), receive_time_ns=i * 10 * MS)
    assert told(one) == []
    assert len(one._held) < 1024
    assert one.faults.as_dict() == {"clock_stands_still": n - len(one._held)}
    for i in range(1, 40):
        one.add(i * STEP, (0.1, 0.2, 0.3), receive_time_ns=(n + i) * 10 * MS)
    assert told(one)[0] == "1 PORT_OPENED 100", "it goes after all"
