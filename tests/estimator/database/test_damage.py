"""Flipped bits and torn files: what is loaded is what was kept, or less of it and said so; never anything else."""

import logging
import random
from pathlib import Path

import pytest

from estimator.database import inspect
from estimator.database.schema import TABLES
from estimator.service.store import Store, StoreError
from tests.conftest import Effort
from tests.estimator.database.kept import fill, loaded, made
from tests.estimator.stream import NAME

pytestmark = [pytest.mark.soak]
HEADER = 100


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return made(tmp_path_factory.mktemp("whole")).read_bytes()


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> set[object]:
    store = Store(made(tmp_path_factory.mktemp("kept")))
    everything = loaded(store)
    store.close()
    return everything


@pytest.fixture
def store_of(tmp_path: Path) -> Path:
    return tmp_path / "a.sqlite3"


def tried(path: Path, data: bytes, kept: set[object], caplog: pytest.LogCaptureFixture) -> str:
    """What became of a store with these bytes: `same`, `less` (and told), `refused`; anything else fails."""
    for old in path.parent.iterdir():
        old.unlink()
    caplog.clear()
    path.write_bytes(data)
    seen = looked_at(path)
    assert path.read_bytes() == data, "looking changes nothing"
    try:
        store = Store(path)
    except StoreError:
        assert path.read_bytes() == data, "what is refused is left as it is"
        return "refused"
    try:
        found = loaded(store)
        if found == kept:
            return "same"
        assert caplog.text, "less than was kept, and nothing said"
        assert not seen, "a store that is not whole was called so"
        # Choices among what is left may differ: the latest prior of those that are whole, say.
        new = [thing for thing in found - kept if thing[0] not in ("prior", "answer", "point")]  # type: ignore[index]
        assert not new, "something was loaded that had never been kept"
        points = {thing[2:] for thing in kept if thing[0] == "point"}  # type: ignore[index]
        assert {thing[2:] for thing in found if thing[0] == "point"} <= points  # type: ignore[index]
        known = {thing[2] for thing in kept if thing[0] == "prior"} | {None}  # type: ignore[index]
        known |= {thing[1] for thing in kept if thing[0] == "calibration"}  # type: ignore[index]
        assert {thing[2] for thing in found if thing[0] == "prior"} <= known  # type: ignore[index]
        assert {thing for thing in found - kept if thing[0] == "answer"} <= {  # type: ignore[index]
            ("answer", verb, request, None) for verb, request in (("recalibrate", "r1"), ("cancel", "r2"))
        }
        return "less"
    finally:
        store.close()


def looked_at(path: Path) -> bool:
    """Whether `truerate store check` finds it sound."""
    try:
        return inspect(path).sound
    except StoreError:
        return False


def test_a_flipped_bit_is_never_loaded(
    store_of: Path, whole: bytes, kept: set[object], caplog: pytest.LogCaptureFixture, effort: Effort
) -> None:
    chance = random.Random(effort.seed)
    bits = chance.sample(range(8 * HEADER), effort(60, 8 * HEADER))
    bits += chance.sample(range(8 * HEADER, 8 * len(whole)), effort(120, 20_000))
    outcomes: dict[str, int] = {}
    for bit in bits:
        data = bytearray(whole)
        data[bit // 8] ^= 1 << bit % 8
        outcome = tried(store_of, bytes(data), kept, caplog)
        outcomes[outcome] = outcomes.get(outcome, 0) + 1
        # A schema of the future may be just that: the only thing for which a store with one wrong bit is refused.
        assert outcome != "refused" or bit // 8 in (62, 63), (bit // 8, bit % 8)
    assert outcomes["same"] > outcomes.get("less", 0)


def test_a_torn_file_is_never_loaded_as_whole(
    store_of: Path, whole: bytes, kept: set[object], caplog: pytest.LogCaptureFixture, effort: Effort
) -> None:
    chance = random.Random(effort.seed)
    pages = range(0, len(whole), 4096)
    for end in [1, 15, 99, 100, *pages, *chance.sample(range(len(whole)), effort(20, 2000))]:
        assert tried(store_of, whole[:end], kept, caplog) in ("less", "same")
        assert "empty" in caplog.text or "was damaged" in caplog.text


def test_blocks_of_zeros_and_rubbish_are_never_loaded(
    store_of: Path, whole: bytes, kept: set[object], caplog: pytest.LogCaptureFixture, effort: Effort
) -> None:
    chance = random.Random(effort.seed)
    for _ in range(effort(25, 2000)):
        at, size = chance.randrange(512, len(whole)), chance.choice([4, 512, 4096])
        rubbish = chance.choice([bytes(size), chance.randbytes(size)])
        data = (whole[:at] + rubbish + whole[at + size :])[: len(whole)]
        tried(store_of, data, kept, caplog)


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("byte", [0xD5, 0x00, 0x28])
def test_damaged_words_of_the_schema(
    store_of: Path, whole: bytes, kept: set[object], caplog: pytest.LogCaptureFixture, table: str, byte: int
) -> None:
    """What SQLite then says of it need not even be text."""
    at = whole.index(f"CREATE TABLE {table} (".encode())
    for place in (at, at + 15 + len(table)):
        assert tried(store_of, whole[:place] + bytes([byte]) + whole[place + 1 :], kept, caplog) in ("less", "same")
        assert "was damaged" in caplog.text


def test_the_damaged_file_is_kept_and_the_new_one_is_sound(store_of: Path, whole: bytes) -> None:
    damaged = whole[: len(whole) // 2]
    store_of.write_bytes(damaged)
    assert not inspect(store_of).sound
    assert store_of.read_bytes() == damaged, "looking changes nothing"
    Store(store_of).close()
    (aside,) = store_of.parent.glob("*.damaged-*")
    assert aside.read_bytes() == damaged
    assert inspect(store_of).sound


def test_a_rescue_that_was_killed_half_way_is_begun_anew(
    store_of: Path, whole: bytes, kept: set[object], monkeypatch: pytest.MonkeyPatch
) -> None:
    from estimator.database import rescue

    data = bytearray(whole)
    data[20:24] = b"\xff\xff\xff\xff"  # of the header: every row is whole
    store_of.write_bytes(data)

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(rescue, "replaced", killed)
        with pytest.raises(KeyboardInterrupt):
            Store(store_of)
    store = Store(store_of)
    assert loaded(store) == kept
    store.close()


def logged(path: Path) -> tuple[bytes, bytes]:
    """A store and its log as a kill leaves them."""
    store = Store(path)
    fill(store)
    file, log = path.read_bytes(), path.with_name(path.name + "-wal").read_bytes()
    store.close()
    return file, log


@pytest.mark.parametrize("after", [False, True], ids=["not replaced", "just replaced"])
def test_what_is_in_the_log_of_a_damaged_file_is_rescued_though_the_first_try_fails(
    tmp_path: Path, kept: set[object], monkeypatch: pytest.MonkeyPatch, after: bool
) -> None:
    from estimator.database import rescue

    before = Store(made(tmp_path))
    before.add_audit(9, NAME, "note", "last", "nurse", "", "noted", accepted=True)
    file, log = (tmp_path / "a.sqlite3").read_bytes(), (tmp_path / "a.sqlite3-wal").read_bytes()
    before.close()
    path = tmp_path / "again" / "a.sqlite3"
    path.parent.mkdir()
    path.write_bytes(file[:20] + b"\xff" * 4 + file[24:])
    path.with_name("a.sqlite3-wal").write_bytes(log)

    def fails(part: Path, to: Path) -> None:
        if to != path or after:
            replaced(part, to)
        if to == path:
            raise OSError(5, "Input/output error")

    replaced = rescue.replaced
    with monkeypatch.context() as patch:
        patch.setattr(rescue, "replaced", fails)
        with pytest.raises(StoreError, match="input/output error"):
            Store(path)
    assert not list(path.parent.glob("*.part"))
    store = Store(path)
    assert loaded(store) == kept
    assert store.answer(NAME, "note", "last") == (True, "noted")
    store.close()


def test_a_damaged_log_is_told_and_kept(
    tmp_path: Path, kept: set[object], caplog: pytest.LogCaptureFixture, effort: Effort
) -> None:
    """SQLite itself says nothing of it: it goes on from the frames before."""
    caplog.set_level(logging.ERROR)
    file, log = logged(tmp_path / "made")
    path, chance = tmp_path / "again" / "a.sqlite3", random.Random(effort.seed)
    path.parent.mkdir()
    less = 0
    for bit in [*range(0, 256, 8), *chance.sample(range(256, 8 * len(log)), effort(30, 1500))]:
        for old in path.parent.iterdir():
            old.unlink()
        caplog.clear()
        path.write_bytes(file)
        data = bytearray(log)
        data[bit // 8] ^= 1 << bit % 8
        path.with_name("a.sqlite3-wal").write_bytes(data)
        store = Store(path)
        found = loaded(store)
        store.close()
        if found != kept:
            less += 1
            assert "cannot be read" in caplog.text, (bit // 8, bit % 8)
            (aside,) = path.parent.glob("*.damaged-*-wal")
            assert aside.read_bytes() == bytes(data)
    assert less > 20
