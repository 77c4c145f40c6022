"""What becomes of a store that is damaged: all of it is used as it was written, or none of it and that is said."""

import shutil
from pathlib import Path

from estimator.database import Backups, StoreError, back_up, inspect
from estimator.service.store import Store
from estimator.service.store_reader import StoreReader
from tests.estimator.database.kept import loaded, made


class Damaged:
    """A store with a backup, to be opened with other bytes in its file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "ward"
        self.whole = made(folder).read_bytes()
        self.path, self.backup = self.folder / "a.sqlite3", folder / "backup.sqlite3"
        back_up(folder / "a.sqlite3", self.backup)
        store = StoreReader.reading(self.backup)
        self.kept = loaded(store)
        store.close()

    def judge(self, data: bytes, *, backup: bool = True) -> str:
        """`unharmed`, or, where it is found damaged, `restored` from the backup, `begun anew` without one, or `refused`.

        Raises AssertionError where it is used and is not as it was written.
        """
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        self.path.write_bytes(data)
        if backup:
            folder = Backups.of(self.path).folder
            folder.mkdir()
            shutil.copy(self.backup, folder / "a-00001.sqlite3")
        try:
            sound = inspect(self.path).sound
        except StoreError:
            sound = False
        assert self.path.read_bytes() == data, "looking changes nothing"
        try:
            store = Store(self.path)
        except StoreError as error:
            if backup:
                raise AssertionError(f"a store that has backups is known, and refused: {error}") from error
            assert self.path.read_bytes() == data, "what is refused is left as it is"
            return "refused" if "is not a truerate store" in str(error) else str(error)
        found, notes = loaded(store), store.database.notes
        store.close()
        assert sound == (not notes), "`truerate store check` and an estimator find the same"
        if not notes:
            assert found == self.kept, "a damaged store is used"
            return "unharmed"
        (aside,) = self.folder.glob("a.sqlite3.aside-*")
        assert aside.read_bytes() == data, "what is damaged is kept as it is"
        assert str(aside) in notes[0]
        if backup:
            assert found == self.kept
            return "restored"
        assert not any(thing[0] == "calibration" for thing in found)  # type: ignore[index]
        return "begun anew"


def flipped(data: bytes, byte: int, bit: int) -> bytes:
    """The data with one bit the other way round."""
    return data[:byte] + bytes([data[byte] ^ 1 << bit]) + data[byte + 1 :]
