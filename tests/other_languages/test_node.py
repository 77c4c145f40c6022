"""docs/wire.md is enough: a subscriber in JavaScript, written from it alone, says of a ward's messages what Python says.

Needs Node and npm, and protobufjs from npm's registry; without them it is skipped, unless TRUERATE_NODE=required (as in .ci/run).
"""

import fcntl
import hashlib
import json
import math
import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridge.bus.contract import Message
from bridge.sim.motion import Still
from bridge.wire import codec, keys
from bridge.wire import truerate_pb2 as pb
from bridge.wire.messages import BiasRevision, CorrectedBatch, SampleFlag
from bridge.wire.refusal import Refusal
from estimator.client import Client, revised
from estimator.device.session import DeviceSession
from estimator.device.window_summary import Second, windows
from tests.estimator.stream import NAME, calibration, feed, handle
from tests.memory_bus import MemoryBroker, MemoryBus
from tests.other_languages.dump import pack
from tests.sentences import free

HERE = Path(__file__).parent / "node"
PROTO = Path(__file__).parents[2] / "bridge" / "wire" / "truerate.proto"
WARD = "w"
Run = Callable[[list[Message]], list[dict[str, Any]]]

pytestmark = [pytest.mark.xdist_group("node"), pytest.mark.timeout(300)]


def absent(why: str) -> None:
    """Skip, unless the tests were told that Node must be there."""
    if os.environ.get("TRUERATE_NODE") == "required":
        pytest.fail(why)
    pytest.skip(why)


def installed(config: pytest.Config, of: Path) -> Path:
    """A folder with the npm packages of another one, installed once for each package-lock.json."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        absent("node and npm are not installed (Debian: apt-get install nodejs npm)")
    assert npm is not None
    assert config.cache is not None
    name = hashlib.sha256((of / "package-lock.json").read_bytes()).hexdigest()[:16]
    folder = config.cache.mkdir(f"node-{name}")
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # one of several test processes installs them
        if not (folder / "installed").exists():
            for file in ("package.json", "package-lock.json"):
                shutil.copy(of / file, folder)
            words = [npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"]
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=240, check=False)
            if done.returncode:
                absent(f"npm could not install the packages of {of.name}: {done.stderr[-300:]}")
            (folder / "installed").touch()
    return folder


@pytest.fixture(scope="session")
def subscriber(pytestconfig: pytest.Config) -> Path:
    """The script beside the packages it needs."""
    return Path(shutil.copy(HERE / "subscriber.js", installed(pytestconfig, HERE)))


@pytest.fixture
def run(subscriber: Path, tmp_path: Path) -> Run:
    def through_node(messages: list[Message]) -> list[dict[str, Any]]:
        file = tmp_path / "messages"
        file.write_bytes(pack(messages))
        words = ["node", str(subscriber), str(PROTO), str(file)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
        return [json.loads(line) for line in done.stdout.splitlines()]

    return through_node


def message(what: str, payload: bytes) -> Message:
    return Message(keys.build(WARD, what, device=NAME), payload)


@pytest.fixture(scope="module")
def session() -> DeviceSession:
    return DeviceSession(NAME)


@pytest.fixture(scope="module")
def batches(session: DeviceSession) -> list[CorrectedBatch]:
    """Of a device that boots, is calibrated and rests, the first and the last few; one with flags."""
    of = calibration(seed=1, after=[Still(4.0)])
    found = feed(session, of.batches(boot=2**64 - 3, first=2**40)).corrected
    found[-1] = replace(found[-1], flags=found[-1].flags | np.uint32(SampleFlag.CLIPPED | SampleFlag.LATE))
    return found[:5] + [replace(b, clock_rate=1.0002) for b in found[-30:]]


def revision_of(batches: list[CorrectedBatch]) -> BiasRevision:
    """Of the middle of the last thirty, at uneven points."""
    inner = batches[10:30]
    points = inner[::7]
    return BiasRevision(
        device=NAME,
        boot=inner[0].boot,
        calibration=inner[0].calibration,
        time_ns=inner[-1].start_time_ns,
        matrix=np.array([[1.1, 0.02, -0.03], [0.01, 0.9, 0.0], [0.0, -0.04, 1.2]]),
        sequences=np.array([b.sequence + len(b) - 1 for b in points], np.uint64),
        times_ns=np.array([b.sample_time_ns[-1] for b in points], np.int64),
        bias=np.linspace(-0.02, 0.05, 3 * len(points), dtype=np.float32).reshape(-1, 3),
        bias_std=np.linspace(1e-4, 3e-3, 3 * len(points), dtype=np.float32).reshape(-1, 3),
        reason=free("at rest again after 95 s: 3 °/h"),
    )


def singles(batch: CorrectedBatch) -> list[CorrectedBatch]:
    """Each sample of it in a batch of its own."""
    tails = [batch.after(n) if n else batch for n in range(len(batch))]
    return [replace(b, ticks=b.ticks[:1], rate=b.rate[:1], flags=b.flags[:1]) for b in tails]


def expected(messages: list[Message]) -> list[CorrectedBatch]:
    """What Python's client gives of them, sample by sample."""
    bus = MemoryBus(MemoryBroker())
    stream = Client(ward=WARD, bus=bus).corrected(idle_s=0.05)
    for key, payload in messages:
        bus.publisher(key).put(payload)
    return [one for batch in stream for one in singles(batch)]


def test_it_says_what_python_says(run: Run, batches: list[CorrectedBatch], session: DeviceSession) -> None:
    sent = [message("corrected", codec.encode_corrected(b)) for b in [*batches, *batches[-5:]]]
    at = max(range(5, len(batches)), key=lambda n: len(batches[n]))
    of = batches[at]  # another estimator cuts it elsewhere
    head = replace(of, ticks=of.ticks[:4], rate=of.rate[:4], flags=of.flags[:4])
    sent.insert(at, message("corrected", codec.encode_corrected(head)))
    anew = [replace(b, start_time_ns=b.start_time_ns + 3_600_000_000_000) for b in batches[:3]]
    sent += [message("corrected", codec.encode_corrected(b)) for b in anew]
    status = session.status(7)
    *samples, last = run([*sent, message("status", codec.encode_status(status))])
    assert last == {
        "status": NAME, "state": int(status.state), "samples_in": str(status.samples_in),
        "reason": [[code, params] for code, params in status.reason],
    }  # fmt: skip
    want = expected(sent)
    assert len(samples) == len(want) == sum(map(len, [*batches, *anew]))
    for said, one in zip(samples, want, strict=True):
        assert (said["device"], int(said["boot"]), int(said["number"])) == (NAME, one.boot, one.sequence)
        assert abs(int(said["time_ns"]) - one.start_time_ns) <= 1
        assert said["device_time"] == pytest.approx(float(one.device_time[0]), rel=1e-15)
        assert (said["quality"], said["flags"]) == (int(one.quality), int(one.flags[0]))
        np.testing.assert_array_equal(np.array(said["rate"], np.float32), one.rate[0])
        np.testing.assert_allclose(said["rate_std"], one.rate_std[0], rtol=1e-12)


def test_a_piece_of_what_came_at_once_is_no_new_start(run: Run, batches: list[CorrectedBatch]) -> None:
    of = batches[0]
    n = 1000
    long = replace(
        of,
        ticks=of.ticks[0] + np.arange(n, dtype=np.uint64) * np.uint64(round(0.01 / of.tick_period_s)),
        rate=np.repeat(of.rate[:1], n, axis=0),
        flags=np.zeros(n, np.uint32),
    )
    sent = [message("corrected", codec.encode_corrected(b)) for b in (long, long.after(500), long.after(999))]
    assert [one["number"] for one in run(sent)] == [str(of.sequence + i) for i in range(n)]
    assert len(expected(sent)) == n


def test_it_takes_nothing_of_an_older_epoch(run: Run, batches: list[CorrectedBatch]) -> None:
    """One estimator hangs, another goes on with what it has not said and some more, the first wakes up and says the rest."""
    former, present = [replace(b, epoch=7) for b in batches[-30:]], [replace(b, epoch=2**56) for b in batches[-30:]]
    said = [*former[:10], *present[8:20], *former[10:25], *present[20:]]
    sent = [message("corrected", codec.encode_corrected(b)) for b in said]
    want = expected(sent)
    assert [one.sequence for one in want] == [one.sequence for b in batches[-30:] for one in singles(b)]
    assert [one.epoch for one in want] == sorted(one.epoch for one in want)
    assert [int(one["number"]) for one in run(sent)] == [one.sequence for one in want]


def test_it_revises_as_python_does(run: Run, batches: list[CorrectedBatch]) -> None:
    by = revision_of(batches)
    foreign = replace(by, calibration="another")
    sent = [message("corrected", codec.encode_corrected(b)) for b in batches]
    said = run(
        [*sent, message("revision", codec.encode_revision(by)), message("revision", codec.encode_revision(foreign))]
    )
    now = {int(one["number"]): one for one in said if "revised" in one}
    want = [(one, revised(one, by)) for batch in batches for one in singles(batch)]
    assert set(now) == {one.sequence for one, after in want if after is not one}
    assert len(now) == int(by.sequences[-1] - by.sequences[0]) + 1
    for one, after in want:
        if after is not one:
            np.testing.assert_allclose(now[one.sequence]["rate"], after.rate[0], rtol=1e-5, atol=1e-7)
            np.testing.assert_allclose(now[one.sequence]["rate_std"], after.rate_std[0], rtol=1e-5)


def tampered(batch: CorrectedBatch) -> list[tuple[str, Message]]:
    """Messages against the rules of docs/wire.md, one rule each, and what is wrong with them."""

    def changed(**fields: Any) -> bytes:
        whole = pb.CorrectedBatch.FromString(codec.encode_corrected(batch))
        for name, value in fields.items():
            if isinstance(value, list):
                del getattr(whole, name)[:]
                getattr(whole, name).extend(value)
            else:
                setattr(whole, name, value)
        return whole.SerializeToString()

    n = len(batch)
    ticks = batch.ticks.tolist()
    wrong: dict[str, dict[str, Any]] = {
        "version": {"version": 2},
        "device": {"device": "other"},
        "samples none": {"ticks": [], "rate": []},
        "samples many": {"ticks": list(range(1025)), "rate": [0.0] * 3075},
        "ticks fall": {"ticks": ticks[::-1]},
        "ticks equal": {"ticks": [ticks[0]] * n},
        "ticks large": {"ticks": [*ticks[:-1], 2**63]},
        "ticks far": {"ticks": [*ticks[:-1], 2**62]},
        "rate short": {"rate": [0.0] * (3 * n - 1)},
        "rate nan": {"rate": [math.nan] * (3 * n)},
        "rate large": {"rate": [2001.0] * (3 * n)},
        "flags short": {"flags": [1] * (n - 1)},
        "flags unknown": {"flags": [32] * n},
        "quality": {"quality": 5},
        "std negative": {"bias_std": [-1.0, 0.0, 0.0]},
        "std large": {"scale_std": [0.0, 2e6, 0.0]},
        "std missing": {"cross_std": []},
        "flicker negative": {"flicker_std": [0.0, 0.0, -1.0]},
        "flicker short": {"flicker_std": [0.0, 0.0]},
        "bias large": {"bias": [0.0, 1001.0, 0.0]},
        "period": {"tick_period_s": 0.0},
        "clock": {"clock_rate": 1e5},
        "sequence": {"sequence": 2**62 + 1},
        "epoch": {"epoch": 2**62 + 1},
        "time": {"start_time_ns": -1},
        "name long": {"calibration": "c" * 65},
        "name control": {"calibration": "c\n1"},
        "name separator": {"calibration": "c\u00a01"},
    }
    good = codec.encode_corrected(batch)
    root = f"{keys.ROOT}/{WARD}"
    return [
        *((why, message("corrected", changed(**fields))) for why, fields in wrong.items()),
        ("garbage", message("corrected", b"\xff\xfe")),
        ("cut", message("corrected", good[:-3])),
        ("too large", message("corrected", good + b"\x9a\x06\xf0\xa2\x04" + bytes(70_000))),
        ("wildcard", Message(f"{root}/corrected/*", good)),
        ("id", Message(f"{root}/corrected/A", good)),
        ("another version of keys", Message(f"truerate/@v2/{WARD}/corrected/{NAME}", good)),
        ("key too long", Message(f"{root}/corrected/{NAME}/x", good)),
    ]


def test_both_refuse_what_is_against_the_rules(run: Run, batches: list[CorrectedBatch]) -> None:
    batch = max(batches, key=len)
    cases = tampered(batch)
    for why, (key, payload) in cases:
        with pytest.raises(Refusal):
            raise AssertionError(f"{why} was taken: {codec.decode_corrected(key, payload)}")
    good = codec.encode_corrected(batch)
    unknown_field = message("corrected", good + b"\xaa\x06\x01x")
    codec.decode_corrected(*unknown_field)
    *said, last = run([*(one for _, one in cases), unknown_field])
    taken = [why for (why, _), line in zip(cases, said, strict=False) if "refused" not in line]
    assert taken == []
    assert int(last["number"]) == batch.sequence + len(batch) - 1


def test_revisions_against_the_rules_are_refused_too(run: Run, batches: list[CorrectedBatch]) -> None:
    by = revision_of(batches)
    wrong = [
        replace(by, sequences=by.sequences[::-1]),
        replace(by, times_ns=np.full(len(by), 5)),
        replace(by, matrix=by.matrix * 20),
        replace(by, bias=by.bias[:-1]),
        replace(by, bias_std=-by.bias_std),
        replace(by, sequences=by.sequences[:1], times_ns=by.times_ns[:1], bias=by.bias[:1], bias_std=by.bias_std[:1]),
        replace(by, times_ns=by.times_ns[:-1]),
    ]
    sent = [message("revision", codec.encode_revision(one)) for one in wrong]
    for one in sent:
        with pytest.raises(Refusal):
            codec.decode_revision(*one)
    assert ["refused" in line for line in run(sent)] == [True] * len(wrong)


def test_windows_are_read_as_python_reads_them(run: Run) -> None:
    looked = DeviceSession(NAME)
    looked.windowed = True
    seconds: list[Second] = []
    stream = calibration(seed=1, after=[Still(4.0)]).batches(boot=2**64 - 3, first=2**40)
    looked.begin_boot(stream[0].boot, float(stream[0].device_time[0]), None)
    for batch in stream:
        seconds += handle(looked, batch).seconds
    made = windows(seconds)
    made[3] = replace(made[3], flags=made[3].flags | np.uint32(SampleFlag.CLIPPED))
    said = iter(run([message("@windowed", codec.encode_windows(one)) for one in made]))
    for one in made:
        for i in range(len(one)):
            line = next(said)
            ids = NAME, one.boot, int(one.sequences[i]), int(one.times_ns[i])
            assert (line["window"], *(int(line[name]) for name in ("boot", "number", "time_ns"))) == ids
            kinds = int(one.samples[i]), int(one.quality), int(one.flags[i])
            assert (line["samples"], line["quality"], line["flags"]) == kinds
            for name, want in (("mean", one.rate_mean), ("least", one.rate_min), ("most", one.rate_max)):
                np.testing.assert_array_equal(np.array(line[name], np.float32), want[i])
            np.testing.assert_allclose(line["mean_std"], one.rate_mean_std[i], rtol=1e-6)
    assert next(said, None) is None
    good = made[0]
    wrong = [
        replace(good, sequences=good.sequences[::-1]),
        replace(good, times_ns=np.full(len(good), 5)),
        replace(good, samples=np.zeros(len(good), np.uint32)),
        replace(good, samples=good.samples[1:]),
        replace(good, rate_std=-good.rate_std - 1),
        replace(good, reading_max=good.reading_max + 2000),
        replace(good, rate_mean=good.rate_mean[1:]),
        replace(good, window_s=0.0),
        replace(good, flags=np.full(len(good), 64, np.uint32)),
    ]
    sent = [message("@windowed", codec.encode_windows(one)) for one in wrong]
    for one_message in sent:
        with pytest.raises(Refusal):
            codec.decode_windows(*one_message)
    assert ["refused" in line for line in run(sent)] == [True] * len(wrong)
