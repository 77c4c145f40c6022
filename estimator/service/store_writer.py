"""Writer thread of the store, so that a slow disk delays no sample; also runs long reads.

Writes are executed in order. While the disk fails they wait and are retried. Reads wait for urgent writes.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from itertools import islice
from typing import Any, TypeVar

from estimator.database import Damaged, Database, StoreError, Unavailable

log = logging.getLogger(__name__)

#: most writes that wait for the disk; further ones are refused
MOST = 10_000
#: most writes in one transaction
TOGETHER = 500
#: how long a write that is not urgent waits for others, s: one transaction costs the same for one write or hundreds
GATHER_S = 0.25
#: interval between retries after a failure of the disk, s
RETRY_S = 5.0
#: longest wait for the last writes at the end, s
PATIENCE_S = 10.0

T = TypeVar("T")
Write = Callable[[], None]
#: called with the error, or with None after the commit
Done = Callable[[StoreError | None], None]


class StoreWriter:
    """Queue of writes to a database, executed in order until it is closed.

    thread: True executes writes on a thread of their own. False executes them within `do`, and retries failed ones
    within `collect`.
    """

    def __init__(self, database: Database, *, thread: bool = True) -> None:
        self._database = database
        self._waiting: deque[tuple[Write, Done]] = deque()
        self._finished: deque[Callable[[], None]] = deque()
        self._more = threading.Condition()
        self._urgent = self._closing = False
        self._reads: deque[tuple[Callable[[], Any], Callable[[Any], None]]] = deque()
        self._thread = threading.Thread(target=self._run, name="store", daemon=True) if thread else None
        if self._thread is not None:
            self._thread.start()

    @property
    def idle(self) -> bool:
        """True if no write waits."""
        return not self._waiting

    def do(self, write: Write, done: Done = lambda _: None, *, soon: bool = True) -> None:
        """Queue a write for the store's thread. soon: do not wait up to GATHER_S seconds for more writes.

        done(error) is called in `collect`: with None once the write is on disk, or with the error if the write failed
        for good. If MOST writes wait already, or after `close`, the write is refused and `done` is called at once with
        an error.
        """
        with self._more:
            refused = self._closing or len(self._waiting) >= MOST
            if not refused:
                self._waiting.append((write, done))
                self._urgent |= soon
                self._more.notify()
        if refused:
            done(StoreError(f"store {self._database.path}: {MOST} entries wait for the disk; the newest is lost"))
        elif self._thread is None:
            self._write_all()
            self.collect()

    def look_up(self, read: Callable[[], T], then: Callable[[T], None] = lambda _: None) -> None:
        """Queue a long read or a backup for the store's thread; writes marked `soon` come first.

        then(found) is called in `collect` with the result of `read`. A failure is logged. After `close` nothing is
        read.
        """
        with self._more:
            self._reads.append((read, then))
            self._more.notify()
        if self._thread is None:
            self._read_next()
            self.collect()

    def collect(self) -> None:
        """Call the callbacks of all finished writes and reads, on the caller's thread."""
        if self._thread is None and self._waiting:
            self._write_all()
        while self._finished:
            self._finished.popleft()()

    def close(self) -> None:
        """Execute the waiting writes for at most PATIENCE_S seconds, then end; remaining writes are lost and logged."""
        with self._more:
            self._closing = True
            self._more.notify()
        if self._thread is None:
            self._write_all()
        else:
            self._thread.join(PATIENCE_S)
        if self._waiting:
            log.error("store %s: the disk fails or does not answer; the last entries are lost", self._database.path)
            lost = StoreError(f"store {self._database.path}: the disk fails or does not answer")
            self._finished += [partial(done, lost) for _, done in self._waiting]
        self.collect()

    def _run(self) -> None:
        while True:
            with self._more:
                self._more.wait_for(lambda: self._waiting or self._reads or self._closing)
                self._more.wait_for(
                    lambda: self._urgent or self._reads or self._closing or len(self._waiting) >= TOGETHER,
                    timeout=GATHER_S,
                )
                self._urgent = False
            wrote = self._write_all()
            if self._closing and not (wrote and self._waiting):
                return
            while self._reads and not self._urgent and not self._closing:
                self._read_next()
            if not wrote:
                with self._more:
                    self._more.wait_for(lambda: self._closing, timeout=RETRY_S)

    def _read_next(self) -> None:
        read, then = self._reads.popleft()
        try:
            found = read()
        except Exception:
            log.exception("a read of the store failed")
        else:
            self._finished.append(partial(then, found))

    def _write_all(self) -> bool:
        """Execute the waiting writes in transactions; returns False when the disk fails."""
        while self._waiting:
            with self._more:
                part = list(islice(self._waiting, TOGETHER))
            try:
                with self._database.transaction():
                    errors = [_tried(write) for write, _ in part]
            except StoreError:
                return False
            for (_, done), error in zip(part, errors, strict=True):
                self._waiting.popleft()
                self._finished.append(partial(done, error))
        return True


def _tried(work: Write) -> StoreError | None:
    """Run one write and return its own error; errors of the whole store are raised."""
    try:
        work()
    except (Damaged, Unavailable):
        raise
    except StoreError as error:
        log.error("%s", error)
        return error
    except Exception as error:
        log.exception("a write to the store failed")
        return StoreError(f"a write to the store failed: {error!r}")
    return None
