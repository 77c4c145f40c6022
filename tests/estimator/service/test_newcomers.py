"""Invented devices, where no list says which devices there are: a bounded number is admitted, and real devices notice nothing."""

from dataclasses import replace

import pytest

from bridge.bus.contract import Message
from bridge.config.enrolment import Enrolment
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire.refusal import Tally
from estimator.service.device import NEWCOMER_S
from estimator.service.entrance import AT_ONCE, FORGET_S, OF_ALL, OF_ONE_BRIDGE, PER_S, REFUSED, Newcomers
from tests.estimator.served import WARD, Served
from tests.estimator.stream import calibration

GHOSTS = 1000


def sent(bridge: str, device: str) -> tuple[str, str]:
    return bridge, device


def admit(newcomers: Newcomers, sent: list[tuple[str, str]], now: float) -> list[tuple[str, str]]:
    return [one for one in sent if newcomers.admits(*one, now)]


@pytest.fixture
def counts() -> Tally:
    return Tally()


@pytest.fixture
def newcomers(counts: Tally) -> Newcomers:
    return Newcomers(lambda name: name == "known", counts)


def test_a_burst_is_admitted_at_a_bounded_rate(newcomers: Newcomers, counts: Tally) -> None:
    burst = [sent("b1", f"ghost{n}") for n in range(6000)]
    first = admit(newcomers, burst, 0.0)
    assert len(first) == AT_ONCE
    assert counts.as_dict() == {REFUSED: 6000 - AT_ONCE}
    later = admit(newcomers, burst, 1.0)
    assert later[: len(first)] == first, "who was admitted stays so"
    assert len(later) == AT_ONCE + PER_S


def test_one_bridge_leaves_room_for_another_and_there_is_a_most_of_all(newcomers: Newcomers) -> None:
    for second in range(60):
        admit(newcomers, [sent("b1", f"ghost{n}") for n in range(1000)], second)
    assert len(admit(newcomers, [sent("b1", f"ghost{n}") for n in range(1000)], 60.0)) == OF_ONE_BRIDGE
    assert admit(newcomers, [sent("b2", "wrist")], 60.0)
    for second in range(61, 120):
        admit(newcomers, [sent(f"c{n}", f"spectre{n}") for n in range(1000)], second)
    assert (
        len(admit(newcomers, [sent(f"c{n}", f"spectre{n}") for n in range(1000)], 120.0)) == OF_ALL - OF_ONE_BRIDGE - 1
    )


def test_a_device_that_is_known_is_admitted_in_any_burst(newcomers: Newcomers) -> None:
    admit(newcomers, [sent("b1", f"ghost{n}") for n in range(6000)], 0.0)
    assert admit(newcomers, [sent("b1", "known")], 0.0)


def test_a_device_that_is_not_kept_makes_room(newcomers: Newcomers) -> None:
    burst = [sent("b1", f"ghost{n}") for n in range(1000)]
    for second in range(60):
        admit(newcomers, burst, second)
    assert not admit(newcomers, [sent("b1", "wrist")], 60.0)
    newcomers.look(60.0 + FORGET_S, kept=lambda _: False, proven=lambda _: False)
    assert admit(newcomers, [sent("b1", "wrist")], 60.0 + FORGET_S)


def test_a_device_that_is_calibrated_makes_room_and_stays(counts: Tally) -> None:
    calibrated = set[str]()
    newcomers = Newcomers(calibrated.__contains__, counts)
    burst = [sent("b1", f"ghost{n}") for n in range(OF_ONE_BRIDGE)]
    for second in range(60):
        admit(newcomers, burst, second)
    calibrated.add("ghost0")
    newcomers.look(61.0, kept=lambda _: True, proven=calibrated.__contains__)
    assert len(admit(newcomers, [*burst, sent("b1", "wrist")], 61.0)) == OF_ONE_BRIDGE + 1


def test_keys_that_are_none_are_left_to_the_decoder() -> None:
    strange = ["", "x", "truerate/@v1/w/raw/*/ghost", "truerate/@v1/w/raw/b1/GHOST"]
    for enrolment in (None, Enrolment(enrolled=("chest",))):
        with Served(enrolment) as served:
            served.raw.messages = [Message(key, b"") for key in strange]
            served.round()
            assert sum(
                n for what, n in served.service._count_all().items() if what.startswith("sample messages refused")
            ) == len(strange)


def test_a_burst_of_invented_devices_costs_a_real_one_no_sample_and_leaves_nothing_behind() -> None:
    real = calibration(after=[Still(60.0)]).batches()
    template = codec.encode_samples(replace(real[0], device="ghost0000"))
    with Served() as served:
        said = []
        for second in range(5):
            for batch in real[second * 10 : second * 10 + 10]:
                served.put(batch)
            for n in range(GHOSTS):
                name = f"ghost{n:04d}"
                key = keys.build(WARD, "raw", bridge="ghost", device=name)
                served.raw.messages.append(Message(key, template.replace(b"ghost0000", name.encode())))
            said += served.round(1.0)
        assert sum(len(batch) for batch in said if batch.device == "chest") == sum(map(len, real[:50]))
        assert len(served.service._devices) <= 1 + AT_ONCE + 5 * PER_S
        for second in range(5, 5 + int(FORGET_S) + 3):  # the real one goes on, the invented ones do not
            for batch in real[second * 10 : second * 10 + 10]:
                served.put(batch)
            served.round(1.0)
            served.service.work()
        assert list(served.service._devices) == ["chest"]


@pytest.mark.parametrize("listed", [False, True])
def test_nothing_is_declared_for_a_newcomer_before_it_has_lived_for_two_seconds(*, listed: bool) -> None:
    batches = calibration(after=[]).batches()
    lived = next(
        i for i, batch in enumerate(batches) if batch.device_time[-1] >= batches[0].device_time[0] + NEWCOMER_S
    )
    with Served(Enrolment(enrolled=("chest",)) if listed else None) as served:
        said = []
        for batch in batches[:lived]:
            served.put(batch)
            said += served.round(0.1)
        assert served.service._devices["chest"].announced == listed
        assert sum(map(len, said)) == (sum(map(len, batches[:lived])) if listed else 0)
        for batch in batches[lived : lived + 5]:
            served.put(batch)
            said += served.round(0.1)
        assert served.service._devices["chest"].announced
        numbers = [number for batch in said for number in range(batch.sequence, batch.sequence + len(batch))]
        assert numbers == list(range(sum(map(len, batches[: lived + 5])))), "all of them, from the first one on"
