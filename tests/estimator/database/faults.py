"""Disks that fail, from outside: the kernel refuses to write, or the n-th call of SQLite raises."""

import resource
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def full_disk() -> Iterator[None]:
    """No file of this process can be written: the kernel's own refusal, EFBIG."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


class FailingCalls:
    """In place of sqlite3.connect: connections of which the calls from `first` on fail, `many` of them."""

    def __init__(
        self, first: int, many: int, message: str = "disk I/O error", code: int = sqlite3.SQLITE_IOERR
    ) -> None:
        self.first, self.last = first, first + many - 1
        self.calls = 0
        self._error = message, code

    def __call__(self, *args: Any, **settings: Any) -> sqlite3.Connection:
        self.count()
        return sqlite3.connect(*args, **settings, factory=self._factory())

    def count(self) -> None:
        """One call more; raises where it is to fail."""
        self.calls += 1
        if self.first <= self.calls <= self.last:
            message, code = self._error
            error = sqlite3.OperationalError(message)
            error.sqlite_errorcode = code
            raise error

    def _factory(self) -> type[sqlite3.Connection]:
        count: Callable[[], None] = self.count

        class Failing(sqlite3.Connection):
            def execute(self, *args: Any) -> sqlite3.Cursor:
                count()
                return super().execute(*args)

        return Failing
