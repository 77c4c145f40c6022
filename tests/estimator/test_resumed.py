"""An estimator that is restarted hears again what it had heard: what was done of it is not done again, and all else is."""

from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest

from bridge.bus.contract import Message
from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Quality, SampleBatch, State
from bridge.wire.refusal import Tally
from estimator.service.law import EVENT
from estimator.service.resumed import DONE, LASTS_S, OVERLAP_S, Resumed
from estimator.service.store import Store
from tests.estimator.served import BRIDGE, NOW_NS, WARD, Served, numbers
from tests.estimator.stream import NAME, Stream, calibration

BOOT = 7


@pytest.fixture(scope="module")
def once() -> Stream:
    return calibration(seed=1)


def heard(served: Served, batches: list[SampleBatch]) -> list[CorrectedBatch]:
    """What a service makes of batches, and of all it has to do once a second."""
    said = []
    for batch in batches:
        served.put(batch)
        said += served.round(len(batch) / 100)
    return said + served.rest()


def counted(served: Served) -> dict[str, int]:
    served.round(2.0)
    return served.service.counts.as_dict()


def live(store: Store, batches: list[SampleBatch]) -> list[CorrectedBatch]:
    """The life of an estimator up to where it is killed."""
    with Served(store=store) as served:
        said = heard(served, batches)
        for device in served.service._devices.values():
            served.service._record.checkpoint(device, served.now, force=True)
    return said


def test_what_was_done_before_a_restart_is_not_done_again(once: Stream) -> None:
    store, batches = Store(":memory:"), once.batches(boot=BOOT)
    live(store, batches)
    after = replace(once, ticks=once.ticks + once.ticks[-1]).part(0, 200).batches(boot=BOOT, first=len(once))
    with Served(store=store) as served:
        said = heard(served, [*batches, *after])
        done = counted(served)[DONE]
        assert OVERLAP_S * once.rate_hz <= len(once) - done < (OVERLAP_S + 3) * once.rate_hz
        assert numbers(said) == [(BOOT, number) for number in range(done, len(once) + 200)]
        assert said[0].flags[0] == 0, "nothing is missing before it"
        assert all(batch.quality is Quality.GOOD for batch in said)
        assert EVENT not in served.service.counts.as_dict()
        assert served.service._devices[NAME].session.life.state is State.TRACKING
    store.close()


def test_it_goes_on_at_once_and_one_device_after_the_other(once: Stream) -> None:
    store, rebooted = Store(":memory:"), once.part(0, 300).batches(boot=BOOT + 1)
    names = ["b", "a", "c"]
    batches = [replace(batch, device=name) for batch in once.batches(boot=BOOT) for name in names]
    live(store, batches)
    again = [batches[0], *(replace(batch, device="new") for batch in rebooted), *batches[1:]]
    with Served(store=store) as served:
        for batch in again:
            served.put(batch)
        said = served.round()
        assert [name for name, _ in groupby(batch.device for batch in said)] == ["new", *names, *names, "new"]
        reached = {batch.device: batch.sequence + len(batch) for batch in said}
        assert reached == dict.fromkeys(names, len(once)) | {"new": 300}, "nothing waits for what was done"
    store.close()


def test_while_it_catches_up_all_devices_are_known_and_its_own(once: Stream) -> None:
    """Else another estimator that comes meanwhile took them, and what came was lost; and a command was refused."""
    store, names = Store(":memory:"), ["b", "a", "c"]
    batches = [replace(batch, device=name) for batch in once.batches(boot=BOOT) for name in names]
    live(store, batches)
    with Served(store=store) as served:
        served.service._turns._clock = iter(
            range(10**9)
        ).__next__  # seconds: nothing that waits is done in a round but a part
        for batch in batches:
            served.put(batch)
        said = served.round()
        assert served.service._turns.waiting > 100
        assert {batch.device for batch in said} == set(names)
        assert set(served.service._devices) == set(served.service._peers.cluster.held) == set(names)
        while served.service._turns.waiting:
            said += served.round(4.0)  # of hundreds of devices the last waits as long
            behind = [one for one in served.service._devices.values() if served.service._turns.waits(one.key)]
            assert not [one.session.life.reason for one in behind if one.session.life.away]
        reached = {batch.device: batch.sequence + len(batch) for batch in said}
        assert reached == dict.fromkeys(names, len(once))
    store.close()


def test_the_first_of_a_later_boot_may_come_swapped(once: Stream) -> None:
    store, batches = Store(":memory:"), once.batches(boot=BOOT)
    live(store, batches)
    later_ns = batches[-1].receive_time_ns - batches[0].receive_time_ns + 1_000_000_000
    after = [replace(b, receive_time_ns=b.receive_time_ns + later_ns) for b in once.part(0, 300).batches(boot=BOOT + 1)]
    first, second, *others = after
    with Served(store=store) as served:
        heard(served, batches)
        said = heard(served, [second, first, *others])
        assert numbers(said) == [(BOOT + 1, number) for number in range(300)]
    store.close()


def test_who_is_killed_again_within_seconds_has_no_more_to_do_again_each_time(once: Stream) -> None:
    store, batches, done = Store(":memory:"), once.batches(boot=BOOT), []
    live(store, batches)
    for kill in range(3):
        more = replace(once, ticks=once.ticks + once.ticks[-1]).part(0, 300 * (kill + 1))
        batches = once.batches(boot=BOOT) + more.batches(boot=BOOT, first=len(once))
        with Served(store=store) as served:
            for at, batch in enumerate(batches):  # all that a bridge kept comes at once, and 3 s as they pass
                served.put(batch)
                if at >= len(batches) - 300 // len(batch):
                    served.round(len(batch) / once.rate_hz)
            done.append(served.service.counts.as_dict()[DONE])
    assert np.diff(done).min() > 0, done
    store.close()


def test_while_it_is_turned_all_of_it_is_done_again(once: Stream) -> None:
    store, batches = Store(":memory:"), once.batches(boot=BOOT)
    with Served(store=store) as served:
        n = next(n for n, batch in enumerate(batches) if heard(served, [batch]) and turned(served)) + 10
        heard(served, batches[n - 9 : n])
        served.service._record.checkpoint(served.service._devices[NAME], served.now, force=True)
    with Served(store=store) as served:
        said = heard(served, batches)
        assert DONE not in counted(served)
        assert numbers(said) == [(BOOT, number) for number in range(len(once))]
        assert said[-1].quality is Quality.GOOD
    store.close()


def turned(served: Served) -> bool:
    return bool(served.service._devices[NAME].session.learnt.turned)


def test_a_recalibration_that_was_asked_for_is_not_cut_short(once: Stream) -> None:
    store, batches = Store(":memory:"), once.batches(boot=BOOT)
    with Served(store=store) as served:
        heard(served, batches)
        device = served.service._devices[NAME]
        assert device.session.recalibrate("nurse", "") is None
        served.service._record.checkpoint(device, served.now, force=True)
    with Served(store=store) as served:
        heard(served, batches)
        assert DONE not in counted(served)
    store.close()


def test_another_run_under_the_same_boot_number_is_taken(once: Stream) -> None:
    store, batches = Store(":memory:"), once.batches(boot=BOOT)
    live(store, batches)
    later_ns = batches[-1].receive_time_ns - batches[0].receive_time_ns + 1_000_000_000
    with Served(store=store) as served:
        again = [replace(b, receive_time_ns=b.receive_time_ns + later_ns) for b in batches[:20]]
        assert len(numbers(heard(served, again))) == 200
        assert DONE not in counted(served)
    store.close()


def message(sequence: int, *, boot: int = BOOT, time_ns: int = 10**18, device: str = NAME) -> Message:
    once = calibration(seed=1).part(0, 10).batches(boot=boot, first=sequence)[0]
    batch = replace(once, device=device, receive_time_ns=time_ns, start_time_ns=time_ns)
    return Message(keys.build(WARD, "raw", bridge=BRIDGE, device=device), codec.encode_samples(batch))


def test_what_is_let_by() -> None:
    came, counts, begun = list[int](), Tally(), list[tuple[str, bool]]()
    reached = {NAME: (BOOT, 1000, 10**18 + 6 * 10**9, BRIDGE)}

    def left(*messages: Message, now: float = 0.0) -> list[int]:
        begun.clear()
        resumed = Resumed(reached, came.append, counts, lambda key, goes_on: begun.append((key, goes_on)), 0.0)
        return [messages.index(m) for m in resumed.left(list(messages), now)]

    assert left(message(0), message(990), message(991), message(1001)) == [2, 3], "whole batches only"
    assert counts.as_dict() == {DONE: 20}
    assert came == [10, 10]
    assert left(message(1001), message(0)) == [0, 1], "what comes after the first that is new is new"
    assert begun == [(message(0).key, True)]
    assert left(message(0, boot=8)) == [0]
    assert begun == [(message(0).key, False)], "there is no telling how much of it there is"
    assert left(message(0, time_ns=10**18 + 10**9 + 1)) == [0], "it may not have reached everybody"
    assert left(message(0, device="other"), message(10, device="other")) == [0, 1]
    assert begun == [(message(0, device="other").key, False)]
    assert left(Message(message(0).key, b"\xff\xff"), Message("no/key", b"")) == [0, 1], "the door refuses them"
    assert left(message(0), now=LASTS_S) == [0]


def test_what_the_store_says_of_long_ago_is_no_reason(once: Stream) -> None:
    store, batches = Store(":memory:"), once.batches(boot=BOOT)
    live(store, batches)
    assert set(store.reached(NOW_NS)) == {NAME}
    assert store.reached(NOW_NS + 1) == {}
    store.close()


def test_what_a_bridge_still_has_of_a_device_that_has_moved_since_takes_it_from_nobody(once: Stream) -> None:
    store, batches, before = Store(":memory:"), once.batches(boot=BOOT), once.part(0, 200).batches(boot=6)
    after = replace(once, ticks=once.ticks + once.ticks[-1]).part(0, 200).batches(boot=BOOT, first=len(once))
    live(store, batches)
    with Served(store=store) as served:
        for batch in before:
            served.put(replace(batch, receive_time_ns=batch.receive_time_ns - 3600 * 10**9), bridge="earlier")
        said = heard(served, [*batches, *after])
        assert {batch.boot for batch in said} == {BOOT}
        assert numbers(said)[-1] == (BOOT, len(once) + 199)
        events = served.service._devices[NAME].session.sequence.events.as_dict()
        assert events.get("also from earlier") == 200
        assert f"also from {BRIDGE}" not in events
    store.close()


def test_a_device_that_moved_while_its_only_estimator_was_away_is_taken_from_where_it_is(once: Stream) -> None:
    store, batches = Store(":memory:"), once.batches(boot=BOOT)
    after = replace(once, ticks=once.ticks + once.ticks[-1]).part(0, 200).batches(boot=BOOT, first=len(once))
    live(store, batches)
    with Served(store=store) as served:
        for batch in after:
            served.put(batch, bridge="other")
        said = [*served.round(1.0), *served.rest()]
        assert len(numbers(said)) == 200
        events = served.service._devices[NAME].session.sequence.events.as_dict()
        assert not [label for label in events if label.startswith("also from")]
    store.close()
