"""A short torment of a real ward; the plan is its seed's, and a line does what it is told."""

import socket
from collections.abc import Iterator
from contextlib import closing

import pytest

from tests.nemesis.faults import plan
from tests.nemesis.line import Line
from tests.nemesis.run import run

NAMES = ("d0", "d1")


@pytest.mark.ward
@pytest.mark.xdist_group("ward 2")
@pytest.mark.timeout(180)
def test_a_ward_keeps_its_promises() -> None:
    result = run(seed=2, devices=2, lasts_s=8.0)
    assert result.broken == [], result.faults
    assert result.faults
    assert result.good


def test_a_plan_is_its_seeds() -> None:
    def words(seed: int) -> list[str]:
        return [f"{fault.at_s:.3f} {fault}" for fault in plan(seed, NAMES, 60.0, clocks=True)]

    assert words(1) == words(1)
    assert words(1) != words(2)


@pytest.mark.parametrize("seed", range(5))
def test_faults_end_in_time_two_at_most_and_one_of_a_thing(seed: int) -> None:
    planned = plan(seed, NAMES, 60.0, clocks=True)
    assert len(planned) > 8
    for n, one in enumerate(planned):
        assert one.at_s + one.lasts_s <= 60.0 + 1e-9
        others = [other for other in planned[:n] if other.at_s + other.lasts_s > one.at_s]
        assert len(others) < 2
        assert all(other.to != one.to for other in others)


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with closing(socket.create_server(("127.0.0.1", 0))) as listening:
        listening.settimeout(60.0)
        yield listening


def test_a_line_passes_holds_and_is_cut(server: socket.socket) -> None:
    with Line(server.getsockname()[1]) as line, socket.create_connection(("127.0.0.1", line.port), 60.0) as near:
        near.sendall(b"a")
        far, _ = server.accept()
        with far:
            far.settimeout(60.0)
            assert far.recv(1) == b"a"
            line.hold()
            far.settimeout(0.5)
            near.sendall(b"b")
            with pytest.raises(TimeoutError):
                far.recv(1)
            line.mend()
            far.settimeout(60.0)
            assert far.recv(1) == b"b", "what was held comes"
            line.cut()
            assert far.recv(1) == b"", "the connection is gone"
