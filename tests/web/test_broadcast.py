"""One broadcast for all: frames made once, slow viewers alone with their loss, failures of one topic no other's."""

import asyncio
import json
import logging
from collections.abc import Iterable

import numpy as np
import pytest

from bridge.wire.messages import Note
from estimator.client import Client
from estimator.config.dashboard import Dashboard
from estimator.web import topic_kinds
from estimator.web.broadcast import AGAIN_S, LINGER_S, Broadcast
from estimator.web.hub import WAITING, Frame, Viewer
from estimator.web.site import Desk
from estimator.web.topics import Topic
from estimator.web.ward_state import Known
from estimator.web.ward_topics import SPARKS
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.web.talk import WARD, Talk, said
from tests.web.test_views import NOW, S, corrected, raw


def taken(viewer: Viewer) -> list[Frame]:
    """All that waits for a viewer."""

    async def take() -> list[Frame]:
        found: list[Frame] = []
        while any(viewer._waiting.values()):
            frame = await viewer.next()
            assert frame is not None
            found.append(frame)
        return found

    return asyncio.run(take())


class Counted(Topic):
    """A topic that counts how often its frames are made, and fails when told."""

    made = begun = 0
    fails = False

    def __init__(self, topic: str, desk: Desk) -> None:
        super().__init__(topic, desk)
        type(self).begun += 1

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:
        yield "whole"

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:
        if self.fails:
            raise RuntimeError("on purpose")
        type(self).made += 1
        yield f"frame {self.made}"


def counted_as(kind: str, monkeypatch: pytest.MonkeyPatch) -> type[Counted]:
    fresh = type("Fresh", (Counted,), {"of_a_device": kind == "trace"})
    monkeypatch.setitem(topic_kinds.KINDS, kind, fresh)
    return fresh


@pytest.fixture
def desk() -> Desk:
    return Desk(Known(WARD), Dashboard())


def test_a_frame_is_made_once_for_all_and_a_slow_one_loses_its_own(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    counted, hub, broadcast = counted_as("counted", monkeypatch), desk.hub, Broadcast(desk)
    viewers = [hub.add() for _ in range(50)]
    for viewer in viewers:
        hub.watch(viewer, ["counted"])
    quick, slow = viewers[0], viewers[1]
    seen = []
    for second in range(10):
        broadcast.step(float(second), 0)
        seen += taken(quick)
    assert seen == ["whole", *(f"frame {i}" for i in range(1, 10))]
    assert counted.made == 9
    assert (quick.dropped, slow.dropped) == (0, 10 - WAITING)
    assert taken(slow) == [f"frame {i}" for i in range(6, 10)]


def test_nothing_is_begun_for_a_device_that_was_never_heard_and_nothing_is_kept_of_it(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    fresh, hub = counted_as("trace", monkeypatch), desk.hub
    broadcast, viewer = Broadcast(desk), hub.add()
    for i in range(100):
        hub.watch(viewer, [f"trace/ghost-{i}"])
        broadcast.step(float(i), 0)
    assert fresh.begun == 0
    assert [*broadcast._running, *broadcast._again] == []
    assert list(hub.newcomers) == ["trace/ghost-99"]
    desk.known.story("ghost-99")
    broadcast.step(100.0, 0)
    assert fresh.begun == 1
    assert taken(viewer) == ["whole"]


def test_one_address_leaves_room_for_the_topics_of_others(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    counted_as("trace", monkeypatch)
    monkeypatch.setattr("estimator.web.broadcast.TOPICS", 6)
    hub = desk.hub
    broadcast, greedy, more, other = Broadcast(desk), hub.add("1"), hub.add("1"), hub.add("2")
    for name in "abcdefgh":
        desk.known.story(name)
    hub.watch(greedy, [f"trace/{name}" for name in "abc"])
    broadcast.step(0.0, 0)
    hub.watch(greedy, ())  # what it has left counts, too, as long as it is kept
    hub.watch(more, [f"trace/{name}" for name in "def"])
    hub.watch(other, ["trace/d", "trace/g"])
    broadcast.step(1.0, 0)
    assert set(broadcast._running) == {f"trace/{name}" for name in "abcdg"}
    broadcast.step(1.0 + LINGER_S, 0)
    broadcast.step(1.0 + LINGER_S + AGAIN_S, 0)
    assert set(broadcast._running) == {f"trace/{name}" for name in "defg"}


def test_a_topic_that_fails_is_told_begun_anew_and_harms_no_other(
    desk: Desk, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    counted, hub = counted_as("counted", monkeypatch), desk.hub
    broadcast, viewer = Broadcast(desk), hub.add()
    hub.watch(viewer, ["counted", "ward"])
    broadcast.step(0.0, 0)
    counted.fails = True
    with caplog.at_level(logging.ERROR):
        broadcast.step(1.0, 0)
    assert "counted failed" in caplog.text
    counted.fails = False
    taken(viewer)
    broadcast.step(1.0 + AGAIN_S, 0)
    assert counted.begun == 2
    assert any('"topic":"ward"' in str(frame) for frame in taken(viewer))


def test_what_a_page_is_told_can_be_read_as_it_is_described(desk: Desk) -> None:
    broker, hub = MemoryBroker(), desk.hub
    talk, broadcast = Talk(broker), Broadcast(desk)
    talk.hush()  # what is said again has the time of this machine
    broadcast.connect(Client(ward=WARD, bus=MemoryBus(broker)), Client(ward=WARD, bus=MemoryBus(broker)))
    talk(said("chest", boot=1, time_ns=S, bias=(0.1, 0.2, 0.3)), Note("chest", 1, S, "nurse", "sat up"))
    viewer = hub.add()
    hub.watch(viewer, ["rates", "bias", "device/chest", "trace/chest", "trail/chest"])
    broadcast.step(0.0, 2 * S)
    talk(raw("chest", 0.5), corrected("chest", -1.0))
    broadcast.step(0.1, 2 * S)
    text, binary = {}, {}
    for frame in taken(viewer):
        if isinstance(frame, str):
            content = json.loads(frame)
            text[content["topic"]] = content["is"]
        else:
            name = frame[1 : 1 + frame[0]].decode()
            binary[name] = frame[(len(name) + 8) // 8 * 8 :]
    assert text["device/chest"]["notes"][0][2] == "sat up"
    assert np.frombuffer(binary["rates"], "<f4")[2:].tolist() == pytest.approx([np.degrees(1.0)] * 2)
    n = len(binary["trace/chest"]) // 44
    trace = np.frombuffer(binary["trace/chest"], "<f4", offset=8 * n).reshape(3, n, 3)
    assert trace[0, :, 0].tolist() == pytest.approx([np.degrees(0.5)] * n)
    assert trace[1, :, 0].tolist() == pytest.approx([np.degrees(-1.0)] * n)
    assert np.frombuffer(binary["trace/chest"], "<f8", n)[0] == pytest.approx(NOW / S)
    points = len(binary["trail/chest"]) // 36
    trail = np.frombuffer(binary["trail/chest"], "<f4", offset=8 * points).reshape(points, 7)
    assert trail[0, :3].tolist() == pytest.approx(np.degrees([0.1, 0.2, 0.3]).tolist())
    bias = np.frombuffer(binary["bias"], "<f4", offset=8).reshape(1, SPARKS, 6)
    assert bias[0, -1, :3].tolist() == pytest.approx(np.degrees([0.1, 0.2, 0.3]).tolist())
    assert text["trail/chest"]["marks"][0][1:] == ["note"]
    talk.close()
    broadcast.close()
