"""Backups of a store: copies it while in use, keeps the newest copies, and restores a store from a copy."""

import logging
import os
import re
import sqlite3
import time
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

from estimator.database.connections import checked, to_read
from estimator.database.errors import FAULTS, Damaged, Empty, StoreError, Unavailable, translated
from estimator.database.schema import check, create, rows_of

log = logging.getLogger(__name__)

#: number of backups kept
KEEP = 7
#: age of the newest backup at which another is due, s: with one look an hour, none gets older than a day
PERIOD_S = 82800.0


@dataclass(frozen=True, slots=True)
class Backups:
    """Backups of one store, as files NAME-00012.sqlite3 in a folder.

    The number gives the order, because a clock may be wrong. store: path of the store's file. folder: folder of the
    backups.
    """

    store: Path
    folder: Path

    @classmethod
    def of(cls, store: Path | str, folder: Path | str | None = None) -> "Backups":
        """Return the Backups of a store in a folder, by default `backups` beside the store. No file is read."""
        return cls(Path(store), Path(folder or Path(store).parent / "backups"))

    def newest_first(self) -> list[Path]:
        """Return the paths of all backups, newest first; empty if the folder does not exist."""
        numbered = re.compile(re.escape(self.store.stem) + r"-(\d{5,})" + re.escape(self.store.suffix))
        with suppress(FileNotFoundError):
            found = [(int(match[1]), one) for one in self.folder.iterdir() if (match := numbered.fullmatch(one.name))]
            return [one for _, one in sorted(found, reverse=True)]
        return []

    def due(self, now_s: float) -> bool:
        """Return True if a backup is due: the newest one is at least 23 hours old, or there is none.

        now_s: s since the Unix epoch. A newest backup dated in the future counts as due, because the clock was wrong.
        """
        made = [one.stat().st_mtime for one in self.newest_first()[:1]]
        return not made or not 0 <= now_s - made[0] < PERIOD_S

    def make(self) -> Path:
        """Make a backup, and remove all but the newest KEEP backups; returns the path of the new one.

        Raises Empty if the store has no entries, Damaged if the copy is not intact, and Unavailable if a file cannot be
        read or written.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            before = self.newest_first()
            number = int(before[0].stem.rpartition("-")[2]) + 1 if before else 1
            to = self.folder / f"{self.store.stem}-{number:05d}{self.store.suffix}"
            back_up(self.store, to)
            for old in before[KEEP - 1 :]:
                old.unlink()
                log.info("backup %s is removed: the newest %d are kept", old, KEEP)
        except OSError as error:
            raise translated(str(self.folder), error) from error
        return to


def copies_of(estimator: str) -> str:
    """Return the folder, in an object-storage bucket, for copies of an estimator's backups. estimator: its id."""
    return f"backups/{estimator}"


def name_of_copy(backup: Path) -> str:
    """Return the file name of a backup's copy in a bucket.

    The name includes the backup's time, because numbers start again with a new store.
    """
    made = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime(backup.stat().st_mtime))
    return f"{backup.stem}-{made}{backup.suffix}"


def back_up(store: Path, to: Path) -> None:
    """Copy a store, in use or not, to a checked, self-contained file `to`.

    Raises StoreError if `to` exists, Empty if the store has no entries, and Damaged if the copy is not intact. Raises
    Unavailable if a file cannot be read or written.
    """
    if to.exists():
        raise StoreError(f"{to} exists already; give another name, or remove the file")
    part = to.with_name(to.name + ".part")
    try:
        with closing(to_read(store)) as db:
            if not any(_copied(db, part, store).values()):
                raise Empty(
                    f"store {store} has no entries, so there is nothing to back up: check the path of the store"
                )
        _place(part, to)
    except (*FAULTS, StoreError) as error:
        part.unlink(missing_ok=True)
        found = error if isinstance(error, StoreError) else translated(str(store), error)
        if isinstance(found, Unavailable):
            found = Unavailable(f"store {store} cannot be copied to {to}: {found}")
        raise found from error


def restore(store: Path, backup: Path) -> str:
    """Replace a store with a copy of an intact backup; no estimator may have the store open.

    Returns the path under which the previous file is kept; empty if there was none. Raises StoreError if the backup is
    not intact.
    """
    checked(backup).close()
    aside, part = set_aside(store), store.with_name(store.name + ".part")
    with closing(to_read(backup)) as db:
        _copied(db, part, backup)
    _place(part, store)
    return aside


def make_sound(store: Path, backups: Backups) -> str:
    """Ensure that there is an intact store: the file itself, else its newest intact backup, else a new store.

    Returns a text for a person: the fault and the repair; empty if the store was intact. Raises StoreError if the file
    is not a store, and Unavailable if a file cannot be read or written.
    """
    notes: list[str] = []
    known = backups.newest_first()
    try:
        store.parent.mkdir(parents=True, exist_ok=True)
        if store.exists():
            try:
                checked(store, ours=bool(known)).close()
            except Damaged as damage:
                notes.append(f"store {store} is damaged: {damage.why}; it is kept as {set_aside(store)}")
            else:
                return ""
        elif known:
            notes.append(f"store {store} is missing")
        for backup in known:
            try:
                restore(store, backup)
            except StoreError as error:
                if isinstance(error, Unavailable):
                    raise
                notes.append(f"backup {backup} is not restored: {error}")
                continue
            made = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(backup.stat().st_mtime))
            return "; ".join([*notes, f"backup {backup} of {made} is restored: later entries are lost"])
        set_aside(store)  # a log without its store
        part = begin(store.with_name(store.name + ".part"))
        with closing(sqlite3.connect(part)) as db:
            create(db)
        _place(part, store)
    except FAULTS as error:
        raise translated(str(store), error) from error
    return "; ".join([*notes, "there is no undamaged backup: a new store is made"]) if notes else ""


def rescue(db: sqlite3.Connection, store: Path) -> str:
    """Rewrite a store from an open connection, because its file was removed or replaced while in use.

    Returns the path under which the replacing file is kept; empty if there was none. The caller must then close every
    connection of the process. Raises Unavailable if a file cannot be written, and Damaged if the copy is not intact.
    """
    try:
        store.parent.mkdir(parents=True, exist_ok=True)
        part = store.with_name(store.name + ".part")
        _copied(db, part, store)
        aside = set_aside(store)
        _place(part, store)
    except FAULTS as error:
        raise translated(str(store), error) from error
    return aside


def _copied(db: sqlite3.Connection, part: Path, store: Path) -> dict[str, int]:
    """Copy an open store into a new, checked, self-contained file; returns how many rows of each table it has.

    A copy of the store's file alone would lack what is still in its write-ahead log.
    """
    begin(part)
    with closing(sqlite3.connect(part)) as copy:
        db.backup(copy)
        copy.execute("PRAGMA journal_mode = DELETE")
        check(copy, store)
        return rows_of(copy)


def begin(part: Path) -> Path:
    """Create an empty file `part`, replacing a file, link or pipe of that name; returns its path.

    Raises OSError, whose message states the cause; SQLite's own error would not.
    """
    part.unlink(missing_ok=True)
    part.open("xb").close()
    return part


def set_aside(store: Path) -> str:
    """Rename a store's file and its write-ahead log to NAME.aside-TIME.

    Returns the new path; empty if there was neither file.
    """
    aside = store.with_name(f"{store.name}.aside-{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}")
    while aside.exists():
        aside = aside.with_name(aside.name + "-2")
    moved = ""
    for tail in ("", "-wal"):
        source = store.with_name(store.name + tail)
        if source.exists():
            source.replace(aside.with_name(aside.name + tail))
            moved = str(aside)
    store.with_name(store.name + "-shm").unlink(missing_ok=True)
    return moved


def set_asides(store: Path) -> list[Path]:
    """Return the paths of all files that `set_aside` renamed beside a store, sorted by name."""
    found = store.parent.glob(f"{store.name}.aside-*")
    return sorted(one for one in found if not one.name.endswith(("-wal", "-shm")))


def _place(part: Path, to: Path) -> None:
    """Rename a written file to its final name, durably: it survives a loss of power."""
    _sync(part)
    part.replace(to)
    with suppress(OSError):  # many network file systems do not sync folders
        _sync(to.parent)


def _sync(place: Path) -> None:
    handle = os.open(place, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
