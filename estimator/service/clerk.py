"""Who writes to the store: at once, or on a thread of its own, so that a disk that takes its time delays no sample.

What takes long to be read and thought about has another one, so that no write waits for it.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, Protocol

from estimator.database import Busy, Database, StoreError

log = logging.getLogger(__name__)

#: so many writes may wait for the disk; what comes then is not kept
MOST = 10_000
#: so many are one transaction
TOGETHER = 500
#: how long what need not be written soon waits for more, s: to wait for the disk costs as much for one as for hundreds
GATHER_S = 0.25
#: how long the last writes are waited for, s
PATIENCE_S = 10.0

Write = Callable[[], None]
#: told why it failed, or None
Done = Callable[[StoreError | None], None]


class Writes(Protocol):
    """Where Record leaves what is to be written."""

    def do(self, write: Write, done: Done, *, soon: bool = True) -> None:
        """Write, now, soon, or when there is more; done is called on the caller's own thread, at once or in `collect`."""

    def hear(self, held_up: Done) -> None:
        """Whom to tell why what waits cannot be written yet; in `collect`."""

    def look_up(self, read: Write, done: Done) -> None:
        """The same of what only reads and takes its time; none when it is over before."""

    def collect(self) -> None:
        """Call what waits to be called."""

    def close(self) -> None:
        """Write what waits."""


class Inline:
    """Writes at once."""

    def do(self, write: Write, done: Done, *, soon: bool = True) -> None:  # noqa: ARG002
        """See Writes."""
        done(_tried(write))

    def hear(self, held_up: Done) -> None:
        """See Writes."""

    def look_up(self, read: Write, done: Done) -> None:
        """See Writes."""
        done(_tried(read))

    def collect(self) -> None:
        """See Writes."""

    def close(self) -> None:
        """See Writes."""


class _Waiting(NamedTuple):
    write: Write
    done: Done


class Clerk:
    """Writes on its own thread, as much at once as waits; in order. Until close, only it writes to the database."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._waiting: deque[_Waiting] = deque()
        self._written: deque[tuple[Done, StoreError | None]] = deque()
        self._more = threading.Condition()
        self._hurry = self._over = False
        self._held_up: Done = lambda _: None
        self._reader = ThreadPoolExecutor(1, "reader")
        self._thread = threading.Thread(target=self._run, name="clerk", daemon=True)
        self._thread.start()

    def do(self, write: Write, done: Done, *, soon: bool = True) -> None:
        """See Writes."""
        with self._more:
            full = self._over or len(self._waiting) >= MOST
            if not full:
                self._hurry |= soon
                self._waiting.append(_Waiting(write, done))
                if self._hurry or len(self._waiting) in {1, TOGETHER}:  # else nobody waits for it
                    self._more.notify()
        if full:
            done(StoreError(f"store {self._database.path}: the disk is too slow, {MOST} writes wait for it"))

    def hear(self, held_up: Done) -> None:
        """See Writes."""
        self._held_up = held_up

    def look_up(self, read: Write, done: Done) -> None:
        """See Writes."""
        if not self._over:
            self._reader.submit(lambda: self._written.append((done, _tried(read))))

    def collect(self) -> None:
        """See Writes."""
        while self._written:
            done, error = self._written.popleft()
            done(error)

    def close(self) -> None:
        """Write what waits, for as long as anybody may wait for it, and end."""
        with self._more:
            self._over = True
            self._more.notify()
        self._reader.shutdown(wait=False, cancel_futures=True)
        self._thread.join(PATIENCE_S)
        if self._thread.is_alive():
            log.error("store %s: the disk does not answer; the last writes are lost", self._database.path)
        self.collect()

    def _run(self) -> None:
        while True:
            with self._more:
                self._more.wait_for(lambda: self._waiting or self._over)
                self._more.wait_for(lambda: self._hurry or self._over or len(self._waiting) >= TOGETHER, GATHER_S)
                part = [self._waiting.popleft() for _ in range(min(TOGETHER, len(self._waiting)))]
                self._hurry &= bool(self._waiting)
            if not part:
                return
            errors = self._errors(part)
            if isinstance(errors, Busy):  # each by itself would wait for whoever has it as long again
                with self._more:
                    self._waiting.extendleft(reversed(part))
                    self._hurry = True
                self._written.append((self._held_up, errors))
            else:
                self._written += zip((one.done for one in part), errors, strict=True)

    def _errors(self, part: list[_Waiting]) -> list[StoreError | None] | Busy:
        """What became of each; Busy where another has the file and there is time to wait for it."""

        def all_of_it() -> None:
            with self._database.together():
                for one in part:
                    one.write()

        error = _tried(all_of_it)
        if isinstance(error, Busy) and not self._over:
            return error
        if error is None or isinstance(error, Busy):
            return [error] * len(part)
        return [_tried(one.write) for one in part]  # one that cannot be written must not keep the others from it


def _tried(write: Write) -> StoreError | None:
    try:
        write()
    except StoreError as error:
        return error
    except Exception as error:
        log.exception("a write to the store failed")
        return StoreError(f"a write to the store failed: {error!r}")
    return None
