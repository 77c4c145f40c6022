"""Who wears a device: said by a person, kept over restarts and takeovers, told in every status, with its history."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from bridge.config.ward_file import WardFile
from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import Checkpoint, Placement
from bridge.wire.placement import placement
from bridge.wire.refusal import Refusal
from estimator.config.alerts import Alerts
from estimator.config.schema import Ward as WardTables
from estimator.service import history
from estimator.service.run_loop import Service
from estimator.service.serve import LIVE
from tests.estimator import memory_ward
from tests.estimator.memory_ward import WARD, Ward
from tests.estimator.stream import NAME, Stream, info
from tests.memory_bus import MemoryBus
from tests.sentences import codes

ARM = Placement("humerus", "left", "bed-3")


def test_a_placement_lasts_until_the_next_over_restarts_and_its_history_is_kept(ward: Ward, once: Stream) -> None:
    ward.send(once.part(0, 260).batches(), info(1))
    assert ward.latest().placement is None
    at = ward.now_ns
    reply = ward.command(lambda: ward.client.place(NAME, "anna", ARM))
    assert reply.accepted
    assert codes(reply.message) == [Code.PLACED]
    assert reply.message[0].params["placement"] == "humerus left, bed-3"
    worn = replace(ARM, since_ns=at, who="anna")
    assert ward.latest().placement == worn
    ward.kill()
    ward.start()
    ward.send(once.part(260, 520).batches())
    assert ward.latest().placement == worn
    ward.now_ns += 3600 * 10**9
    assert codes(ward.command(lambda: ward.client.place(NAME, "bo", Placement())).message) == [Code.NOBODY_WEARS]
    ended = ward.latest().placement
    assert ended == Placement(since_ns=ward.now_ns, who="bo")
    assert not ended
    assert history.read(ward.store, NAME).placements == [worn, ended]
    assert history.read(ward.store, NAME, since_ns=at + 1).placements == [worn, ended], "worn was still worn then"


def test_another_estimators_placement_is_taken_over_unless_a_later_one_is_stored(ward: Ward, once: Stream) -> None:
    for since_ns, expected in ((5, "bed-9"), (4, "bed-9")):
        said = Placement(wearer="bed-9" if since_ns == 5 else "bed-1", since_ns=since_ns, who="bo")
        payload = codec.encode_checkpoint(Checkpoint(NAME, 1, 1, 1, placement=said))
        MemoryBus(ward.broker).publisher(keys.build(WARD, "checkpoint", device=NAME), cache=1).put(payload)
        ward.send(once.part(0, 260).batches(), info(1))
        worn = ward.latest().placement
        assert worn is not None
        assert worn.wearer == expected
        ward.kill()
        ward.start()
    assert [one.wearer for one in ward.store.placements(NAME)] == ["bed-9"]


@pytest.mark.parametrize(
    ("segment", "side", "wearer", "words"),
    [
        ("arm", "", "", "unknown segment 'arm': use head, torso"),
        ("torso", "left", "", "torso has no left side"),
        ("", "left", "", "no segment has no left side"),
        ("", "", "  ", "only spaces"),
        ("", "", "x" * 33, "at most 32"),
    ],
)
def test_a_placement_that_cannot_be_is_refused(segment: str, side: str, wearer: str, words: str) -> None:
    with pytest.raises(Refusal, match=words):
        placement(segment, side, wearer)


def test_a_changed_ward_file_takes_effect_at_once(
    tmp_path: Path, once: Stream, monkeypatch: pytest.MonkeyPatch
) -> None:
    (path := tmp_path / "ward.toml").write_text('ward = "w"\n[estimator]\nid = "e1"\n')
    file, sends = WardFile(path, WardTables, ("estimator", "alerts"), LIVE, settled_s=0.0), list[Alerts]()
    monkeypatch.setattr(memory_ward, "Service", partial(Service, file=file, sends=sends.append))
    ward = Ward(tmp_path)
    low = replace(info(1), battery_percent=9.0)
    ward.send(once.part(0, 260).batches(), low)
    assert ward.latest().alerts == ()
    path.write_text(path.read_text() + "[alerts]\nhold_s = { battery_low = 0 }\n")
    ward.send(once.part(260, 520).batches(), low)
    assert [one.kind for one in ward.latest().alerts] == ["battery_low"]
    assert [one.hold_s for one in sends] == [{"battery_low": 0.0}]
    assert [one.code for one in file.report.message] == [Code.WARD_FILE_TAKEN], "nothing waits for a restart"
    ward.kill()


def test_only_a_placement_that_lasts_can_be_ended(ward: Ward, once: Stream) -> None:
    ward.send(once.part(0, 260).batches(), info(1))
    ward.command(lambda: ward.client.place(NAME, "anna", ARM))
    reply = ward.command(lambda: ward.client.place(NAME, "anna", Placement()))
    again = ward.command(lambda: ward.client.place(NAME, "anna", Placement()))
    assert (reply.accepted, codes(reply.message)) == (True, [Code.NOBODY_WEARS])
    assert (again.accepted, codes(again.message)) == (False, [Code.NO_PLACEMENT])
