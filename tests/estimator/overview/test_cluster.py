"""The estimators of a ward at one look, and `truerate cluster status`."""

import json
from collections.abc import Sequence

import pytest

from bridge.reasons.codes import Code
from bridge.wire import codec, keys
from bridge.wire.messages import Holding, Move, Owned
from estimator.cli.main import main
from estimator.client import Client
from estimator.overview.cluster import as_json, cluster_view
from tests.memory_bus import MemoryBroker, MemoryBus


def owned(name: str, *devices: str, epoch: int = 5, part: int = 0, parts: int = 1, at: int = 1) -> Owned:
    holdings = tuple(Holding(device, epoch, 7, 100) for device in devices)
    moves = (Move(at, len(devices), 0, (Code.ESTIMATOR_GONE(estimator="e9"),)),)
    return Owned(name, at, epoch, 0.25, holdings, moves, part, parts)


@pytest.mark.parametrize(
    ("alive", "said", "code"),
    [
        ([], [], Code.NO_ESTIMATOR),
        (["e1"], [], Code.ESTIMATOR_SILENT),
        (["e1", "e2"], [owned("e1", "a"), owned("e2", "a", epoch=9)], Code.TWO_ESTIMATORS),
    ],
)
def test_what_is_wrong_is_said(alive: Sequence[str], said: Sequence[Owned], code: Code) -> None:
    view = cluster_view("w", alive, said)
    assert view.troubles[0].code == code
    assert not as_json(view)["well"]


def test_of_two_that_say_to_have_a_device_the_later_has_it() -> None:
    view = cluster_view("w", ["e1", "e2"], [owned("e1", "a", epoch=9), owned("e2", "a", epoch=5)])
    assert view.devices["a"][0] == "e1"


class TestCommand:
    @pytest.fixture(autouse=True)
    def ward(self, monkeypatch: pytest.MonkeyPatch) -> None:
        broker = MemoryBroker()
        self.bus = MemoryBus(broker)
        for name, devices in (("e1", ("a", "b")), ("e2", ("c",))):
            self.bus.declare_alive(keys.build("w", "alive/estimator", estimator=name))
            put = self.bus.publisher(keys.build("w", "owned", estimator=name), cache=1).put
            put(codec.encode_owned(owned(name, *devices, epoch=2**57 + 3)))
        monkeypatch.setattr("estimator.client.client.ZenohBus", lambda _: MemoryBus(broker))
        monkeypatch.setattr(Client.owned, "__defaults__", (0.1,))

    def test_it_says_who_has_how_many_and_what_moved(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["cluster", "status", "--ward", "w", "--devices"]) == 0
        said = capsys.readouterr().out
        assert "w: 3 devices, 2 estimators" in said
        assert "2 devices came: Estimator e9 has left." in said
        assert str(2**57 + 3) in said

    def test_programs_get_all_of_it(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["cluster", "status", "--ward", "w", "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        first = said["estimators"][0]
        assert (first["id"], first["alive"], first["load"]) == ("e1", True, 0.25)
        assert first["devices"]["a"] == {"epoch": 2**57 + 3, "boot": "0000000000000007", "next": 100}

    def test_none_alive_is_trouble(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert main(["cluster", "status", "--ward", "elsewhere"]) == 1
        assert "No estimator is alive" in capsys.readouterr().out
