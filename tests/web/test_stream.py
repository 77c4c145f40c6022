"""The stream at /api/v1/stream: each sample once, also over cuts, and what a reader is told that cannot follow."""

import asyncio
import json
import socket
import struct
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Self
from urllib.error import HTTPError
from urllib.parse import urlencode
from urllib.request import urlopen

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin

from bridge.wire import codec, keys
from bridge.wire.messages import CorrectedBatch, Quality
from estimator.client import Corrected
from estimator.web.http_error import Fault
from estimator.web.stream import feeds
from estimator.web.stream.documents import document
from estimator.web.stream.request import Asked
from tests.web.conftest import Site, served
from tests.web.talk import WARD, about, said, until

RATE_HZ, N = 100.0, 5
#: of a device that was switched on long before: its first samples are gone
FIRST = 40_000


def batch(device: str, k: int, boot: int = 5, n: int = N) -> CorrectedBatch:
    """Batch number k of a device: every sample has a rate of its own."""
    number = FIRST + k * N + np.arange(n)
    small = np.full(3, 0.001, np.float32)
    rate = np.column_stack([np.sin(number * 0.7 + axis) for axis in range(3)]).astype(np.float32)
    start_ns = 1_790_000_000_000_000_000 + round(int(number[0]) / RATE_HZ * 1e9)
    ticks = (number * 1e6 / RATE_HZ).astype(np.uint64)
    flags = (number % 17 == 0).astype(np.uint32) * np.uint32(2)
    return CorrectedBatch(
        device, boot, int(number[0]), start_ns, 1e-6, 1.0, ticks, rate, flags, Quality.GOOD, 9 * small, small, small, small,
        "c", small,
    )  # fmt: skip


@pytest.fixture
def site() -> Iterator[Site]:
    made = served()
    _hear(made, "chest", "wrist")
    yield made
    made.stop()


def _hear(site: Site, *names: str) -> None:
    for name in names:
        site.talk(about(name, boot=5), said(name, boot=5, time_ns=time.time_ns()))
    until(lambda: set(names) <= set(site.server.desk.known.stories))


def poll(site: Site, **asked: Any) -> dict[str, Any]:
    with urlopen(f"{site.url}/api/v1/stream?{urlencode(asked, doseq=True)}", timeout=60) as answer:
        return json.load(answer)  # type: ignore[no-any-return]


def socket_of(site: Site, **asked: Any) -> Any:
    url = f"{site.url.replace('http', 'ws')}/api/v1/stream?{urlencode(asked, doseq=True)}"
    return connect(url, open_timeout=60, close_timeout=0.1)


def numbers(documents: list[dict[str, Any]]) -> list[int]:
    return [one["sequence"] + i for one in documents for i in range(len(one["rate_rad_s"]))]


class Talking:
    """Says the batches of two devices, one after the other, until it is told to stop."""

    def __init__(self, site: Site) -> None:
        self._site, self._over, self.said = site, threading.Event(), 0
        self._thread = threading.Thread(target=self._talk)

    def _talk(self) -> None:
        while not self._over.wait(0.01):
            self._site.talk(batch("chest", self.said), batch("wrist", self.said))
            self.said += 1

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()


@pytest.mark.parametrize("form", ["json", "protobuf"])
def test_a_websocket_that_is_cut_goes_on_with_the_next_sample(site: Site, form: str) -> None:
    found: list[CorrectedBatch | dict[str, Any]] = []
    after: dict[str, str] = {}
    with Talking(site):
        for _ in range(3):
            with socket_of(site, device="chest", format=form, after=list(after.values()) or [""]) as stream:
                for _, text in zip(range(40), stream, strict=False):
                    if form == "json":
                        one = json.loads(text)
                        assert one["type"] == "samples"
                        after["chest"] = one["after"]
                    else:
                        one = codec.decode_corrected(keys.build(WARD, "corrected", device="chest"), text)
                        after["chest"] = f"chest.{one.boot:016x}.{one.sequence + len(one) - 1}"
                    found.append(one)
            time.sleep(0.1)  # what is said meanwhile is not lost
    if form == "json":
        whole = numbers(found)  # type: ignore[arg-type]
        rates = np.array([rate for one in found for rate in one["rate_rad_s"]])  # type: ignore[index]
        stds = np.array([std for one in found for std in one["rate_std_rad_s"]])  # type: ignore[index]
        times = [t for one in found for t in one["time_s"]]  # type: ignore[index]
    else:
        whole = [one.sequence + i for one in found for i in range(len(one))]  # type: ignore[union-attr]
        rates = np.concatenate([one.rate for one in found])  # type: ignore[union-attr]
        stds = np.concatenate([one.rate_std for one in found])  # type: ignore[union-attr]
        times = [t / 1e9 for one in found for t in one.sample_time_ns]  # type: ignore[union-attr]
    first = (whole[0] - FIRST) // N  # the publisher keeps the last ones only
    assert whole == list(range(FIRST + first * N, FIRST + first * N + len(whole)))
    assert len(whole) >= 3 * 40
    sent = [batch("chest", first + k) for k in range(len(whole) // N + 1)]
    np.testing.assert_array_equal(rates.astype(np.float32), np.concatenate([b.rate for b in sent])[: len(whole)])
    np.testing.assert_allclose(stds, np.concatenate([b.rate_std for b in sent])[: len(whole)], rtol=1e-6)
    np.testing.assert_allclose(np.diff(times), 1 / RATE_HZ, atol=1e-6)


def test_polls_give_each_sample_of_all_devices_once(site: Site) -> None:
    found: dict[str, list[dict[str, Any]]] = {"chest": [], "wrist": []}
    with Talking(site):
        after, polls = [""], 0
        while polls < 12 or min(map(len, found.values())) < 30:
            answer = poll(site, after=after, wait_s=2)
            after, polls = answer["after"], polls + 1
            for one in answer["documents"]:
                found[one["device"]].append(one)
            time.sleep(0.05)
    for documents in found.values():
        came = numbers(documents)
        assert came == list(range(came[0], came[0] + len(came)))


def test_without_after_a_reader_begins_now(site: Site) -> None:
    site.talk(*(batch("chest", k) for k in range(4)))
    answer = poll(site, device="chest", wait_s=0.1)
    assert answer["documents"] == []
    assert answer["after"] == [f"chest.0000000000000005.{FIRST + 4 * N - 1}"]
    site.talk(batch("chest", 4))
    assert numbers(poll(site, device="chest", after=answer["after"])["documents"]) == list(batch_numbers(4))


def test_a_history_that_is_decoded_late_is_waited_for(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    drain, late_s = Corrected.drain, iter([2 * feeds.SETTLE_S])

    def slowly(own: Corrected, timeout_s: float = 0.0) -> list[CorrectedBatch]:
        time.sleep(next(late_s, 0.0))
        return drain(own, timeout_s)

    monkeypatch.setattr(Corrected, "drain", slowly)
    site.talk(*(batch("chest", k) for k in range(4)))
    assert numbers(poll(site, device="chest", after="", wait_s=0)["documents"]) == list(range(FIRST, FIRST + 4 * N))


def batch_numbers(k: int) -> range:
    return range(FIRST + k * N, FIRST + (k + 1) * N)


def test_means_are_those_of_whole_intervals_however_the_stream_is_cut(site: Site) -> None:
    site.talk(*(batch("chest", k) for k in range(40)))
    whole = poll(site, device="chest", after="", hz=20)["documents"]
    rate = np.concatenate([batch("chest", k).rate for k in range(40)])
    # A sample is the end of its time, so each fifth one ends a twentieth of a second.
    interval = (np.arange(FIRST, FIRST + 40 * N) + 4) // 5
    for one, k in zip(whole, np.unique(interval), strict=False):
        inside = interval == k
        np.testing.assert_allclose(one["rate_rad_s"], [rate[inside].mean(axis=0, dtype=float)], atol=1e-6)
        assert one["sequence"] == FIRST + np.flatnonzero(inside)[-1]
        assert one["flags"] == [2 if ((FIRST + np.flatnonzero(inside)) % 17 == 0).any() else 0]
        length = np.linalg.norm(one["rate_rad_s"])
        std = np.hypot(
            0.009 / np.sqrt(inside.sum()), 0.001 * np.hypot(1, length)
        )  # of noise, bias, and scale of every axis
        np.testing.assert_allclose(one["rate_std_rad_s"], [[std] * 3], rtol=1e-5)
    assert len(whole) == 40  # the last, of four samples, interval may go on
    for cut in (7, 21):
        resumed = poll(site, device="chest", after=whole[cut]["after"], hz=20)["documents"]
        assert resumed == whole[cut + 1 :]


def test_a_reader_that_cannot_follow_is_told_what_it_missed(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeds, "OF_A_DEVICE", 10)
    site.talk(batch("chest", 0))
    after = poll(site, device="chest", after="")["after"]
    site.talk(*(batch("chest", k) for k in range(1, 31)))
    until(lambda: site.server.desk.feeds._feeds["chest"].kept.end >= 31)
    missed, *documents = poll(site, device="chest", after=after)["documents"]
    first = FIRST + N
    assert missed == {"type": "missed", "device": "chest", "boot": "0000000000000005", "first": first, "count": 20 * N}
    assert numbers(documents) == list(range(first + 20 * N, FIRST + 31 * N))


def test_a_reboot_comes_after_the_last_samples_of_the_old_boot(site: Site) -> None:
    site.talk(*(batch("chest", k) for k in range(3)), *(batch("chest", k, boot=6) for k in range(50, 53)))
    of_old = f"chest.0000000000000005.{FIRST + N - 1}"
    documents = poll(site, device="chest", after=of_old)["documents"]
    assert [one["boot"][-1] for one in documents] == list("55666")
    of_new = documents[2]["after"]
    assert [one["boot"][-1] for one in poll(site, device="chest", after=of_new)["documents"]] == list("66")
    missed, *documents = poll(site, device="chest", after="chest.0000000000000004.7")["documents"]
    assert (missed["type"], missed["boot"][-1], missed["first"], missed["count"]) == ("missed", "4", 8, None)
    assert [one["boot"][-1] for one in documents] == list("555666")


def test_nothing_is_subscribed_while_nobody_reads(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeds, "LINGER_S", 0.05)
    subscriptions = site.buses[0].broker.subscriptions
    before = len(subscriptions)
    with socket_of(site, device=["chest", "wrist"]), socket_of(site):
        until(lambda: len(subscriptions) == before + 3)
    until(lambda: len(subscriptions) == before)


WRONG = [
    ("device=nobody", 404, "nobody"),
    ("device=A", 400, "id"),
    ("hz=0", 400, "'hz' is '0': use a number from 0.1 to 1000."),
    ("hz=nan", 400, "'hz' is 'nan'"),
    ("after=chest", 400, "'after' is 'chest': use DEVICE.BOOT.NUMBER"),
    ("&".join(f"device=d{n}" for n in range(33)), 400, "'device' is given 33 times"),
    ("colour=red", 400, "Unknown parameter 'colour'"),
]


@pytest.mark.parametrize(("query", "status", "words"), WRONG)
def test_what_is_wrong_is_said_both_ways(site: Site, query: str, status: int, words: str) -> None:
    # Before that a device may still be heard of, and 503 says so.
    until(lambda: status != 404 or site.server.desk.known.looked)
    with pytest.raises(HTTPError) as refused:
        urlopen(f"{site.url}/api/v1/stream?{query}", timeout=60)
    with refused.value as answer:
        assert (answer.status, words in json.load(answer)["error"]["message"]) == (status, True)
    with connect(f"{site.url.replace('http', 'ws')}/api/v1/stream?{query}") as stream, pytest.raises(ConnectionClosed):
        stream.recv(60)
    assert stream.close_code == 4000 + status
    assert words in (stream.close_reason or "")


def test_one_address_has_so_many_readers(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeds, "OF_ONE_ADDRESS", 2)
    with socket_of(site, device="chest"), socket_of(site, device="chest"):
        until(lambda: sum(len(feed.readers) for feed in site.server.desk.feeds._feeds.values()) >= 2)
        with pytest.raises(HTTPError) as refused:
            poll(site)
        with refused.value as answer:
            assert (answer.status, answer.headers["Retry-After"]) == (503, "5")


def test_pages_of_other_origins_read_only_where_they_are_named() -> None:
    site = served(origins=("http://lab.example:8000",))
    _hear(site, "chest")
    url = f"{site.url.replace('http', 'ws')}/api/v1/stream"
    site.talk(batch("chest", 0))
    with connect(f"{url}?after=", origin=Origin("http://lab.example:8000")) as stream:
        assert json.loads(stream.recv(60))["sequence"] == FIRST
    for wrong, origin in (
        (url, "http://lab.example"),
        (url.replace("api/v1/stream", "live"), "http://lab.example:8000"),
    ):
        with pytest.raises(InvalidStatus), connect(wrong, origin=Origin(origin)):
            pass
    site.stop()


def test_a_slow_program_is_told_what_it_missed_and_harms_nobody(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeds, "OF_A_DEVICE", 20)
    n, many = 1000, 130  # far more than the sockets hold
    first = batch("chest", 0)
    of_thousand = [batch("chest", k * n // N, n=n) for k in range(many)]
    slow_url = f"{site.url.replace('http', 'ws')}/api/v1/stream?device=chest&after="
    site.talk(replace(first, boot=4))
    with connect(slow_url, max_queue=1, close_timeout=0.1) as slow:
        assert json.loads(slow.recv())["sequence"] == FIRST
        with socket_of(site, device="chest", after="", format="protobuf") as other:
            other.recv(60)
            for one in of_thousand:
                site.talk(one)
                quick = codec.decode_corrected(keys.build(WARD, "corrected", device="chest"), other.recv(60))
                assert (quick.sequence, len(quick)) == (one.sequence, n)
        found: list[dict[str, Any]] = []
        while not found or found[-1]["type"] == "missed" or numbers(found[-1:])[-1] < FIRST + many * n - 1:
            found.append(json.loads(slow.recv(60)))
    (missed,) = (one for one in found if one["type"] == "missed")
    assert missed["count"] > 10 * n
    covered = numbers([one for one in found if one["type"] == "samples"])
    covered += range(missed["first"], missed["first"] + missed["count"])
    assert sorted(covered) == list(range(FIRST, FIRST + many * n))


def test_programs_that_leave_fill_no_log(site: Site, caplog: pytest.LogCaptureFixture) -> None:
    asks = (
        "GET /api/v1/stream?device=chest&after= HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    )
    site.talk(*(batch("chest", k * 20, n=100) for k in range(400)))
    for _ in range(5):
        with socket.create_connection(("127.0.0.1", int(site.url.rpartition(":")[2])), 60) as stream:
            stream.sendall(asks.encode())
            while stream.recv(1) != b"\x81":  # the first sample
                pass
            stream.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # leaves with a reset
    until(lambda: not site.server.uvicorn.server_state.connections)
    assert [record.getMessage() for record in caplog.records if record.name == "asyncio"] == []


def test_readers_of_many_devices_take_turns_with_everything_else() -> None:
    names = [f"d{i}" for i in range(32)]

    async def scene() -> tuple[list[int], int]:
        kept = {name: feeds.Feed(Empty(), 640) for name in names}  # type: ignore[arg-type]
        for name, feed in kept.items():
            feed.settled.set()
            feed.kept.add(batch(name, k) for k in range(300))
        turn, asked = asyncio.Lock(), Asked(tuple(names), {}, None, protobuf=False, wait_s=0.0)
        readers = [feeds.Reader(kept, asked, "here", turn) for _ in range(20)]
        rounds = 0

        async def page() -> None:
            nonlocal rounds
            while True:
                rounds += 1
                await asyncio.sleep(0)

        other = asyncio.create_task(page())
        for reader in readers:
            await reader.begin()
        rounds = 0
        found = await asyncio.gather(*(reader.read(document, 256, 0.0) for reader in readers))
        other.cancel()
        return [len(one) for one in found], rounds

    sizes, rounds = asyncio.run(scene())
    assert sizes == [256] * 20
    assert rounds >= 20


def test_a_reader_is_told_when_no_router_gives_what_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feeds, "BEGIN_S", 0.05)

    async def scene() -> None:
        asked = Asked(("chest",), None, None, protobuf=False, wait_s=0.0)
        await feeds.Reader({"chest": feeds.Feed(Empty(), 640)}, asked, "here", asyncio.Lock()).begin()  # type: ignore[arg-type]

    with pytest.raises(Fault, match="router is not there"):
        asyncio.run(scene())


def test_a_poll_that_does_not_wait_gets_what_is_kept(site: Site) -> None:
    poll(site, device="chest", wait_s=0)
    site.talk(*(batch("chest", k) for k in range(20)))
    whole = list(range(FIRST, FIRST + 20 * N))
    until(lambda: numbers(poll(site, device="chest", after="", wait_s=0)["documents"]) == whole)


class Empty:
    """A subscription that gets nothing."""

    caught_up = False

    def drain(self) -> list[CorrectedBatch]:
        return []
