"""Progress bar on a terminal, for work that takes longer than 2 s."""

import time
from collections.abc import Callable
from typing import Self

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from bridge.terminal.console import plain_console

_PATIENCE_S = 2.0  # the bar appears only after this time
_COLUMNS = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:.0f} %"), TimeRemainingColumn()


class Bar:
    """Progress bar on standard error, for the length of a `with` block.

    The bar appears only on a terminal, and only for work that takes longer than 2 s.
    """

    def __init__(self) -> None:
        self._console = plain_console(stderr=True)
        self._began_s = time.monotonic()
        self._shown: Progress | None = None

    def on(self, what: str) -> Callable[[int, int], None]:
        """Return a callback(done, of) that shows the progress of the task `what`: `done` of `of` steps are finished."""
        return lambda done, of: self._tell(what, done, of)

    def _tell(self, what: str, done: int, of: int) -> None:
        now_s = time.monotonic()
        if not self._console.is_terminal or now_s - self._began_s < _PATIENCE_S:
            return
        if self._shown is None:
            self._shown = Progress(*_COLUMNS, console=self._console, transient=True)
            self._shown.add_task(what)
            self._shown.start()
        self._shown.update(self._shown.task_ids[0], description=what, completed=done, total=of)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown is not None:
            self._shown.stop()
