"""Table of a ward's statuses, live in a terminal; other outputs get a line per change."""

from math import degrees
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.text import Text

from bridge.reasons.catalogue import english
from bridge.terminal.tables import Column, Columns
from bridge.wire.messages import State, Status
from estimator.geometry.gyro_model import AXES, SIGMAS

STYLES = {
    State.UNKNOWN: "bold magenta",
    State.WARMING: "yellow",
    State.AWAITING_STILL: "yellow",
    State.BIAS_ONLY: "cyan",
    State.TURNING: "cyan",
    State.TRACKING: "green",
    State.DEGRADED: "magenta",
    State.LOST: "bold red",
}


def word(state: State) -> Text:
    """Return a state's name as coloured text."""
    return Text(state.name.lower().replace("_", " "), STYLES.get(state, ""))


_COLUMNS = (
    Column("device", least=20),
    Column("worn", spare=4, least=8),
    Column("state", least=8),
    Column("quality", spare=3, least=6),
    Column("turns", number=True, spare=2),
    Column("bias ± 95 % °/s", number=True, spare=1),
    Column("why", least=20),
)


def table(statuses: dict[str, Status], title: str = "") -> Columns:
    """Return a table with a row per device: where worn, state, quality, turns done, bias uncertainty, and reason.

    statuses: by device id. Bias uncertainty is half the width of the 95 % interval of the least known axis, °/s.
    """
    shown = Columns(_COLUMNS, title=title)
    for name in sorted(statuses):
        status = statuses[name]
        turns = "".join(AXES[axis] if axis in status.axes_done else "·" for axis in range(3))
        shown.add(
            name,
            str(status.placement) if status.placement else "",
            word(status.state),
            status.quality.name.lower().replace("_", " "),
            turns if status.progress < 1 else "done",
            f"{SIGMAS * degrees(max(status.bias_std)):.3f}",
            english(*status.reason),
        )
    return shown


class LiveTable:
    """Context manager that shows a ward's statuses live: a table in a terminal, else a line for each change."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, refresh_per_second=8, transient=True) if console.is_terminal else None

    def show(self, elapsed_s: float, statuses: dict[str, Status], changes: list[Status], note: str) -> None:
        """Show the ward's statuses, `elapsed_s` seconds after the start.

        statuses: by device id. changes: statuses with a new state. note: text for the table's title.
        """
        if self._live is not None:
            self._live.update(table(statuses, f"{elapsed_s:4.0f} s  {note}"))
            return
        for status in changes:
            self.say(
                elapsed_s, f"{status.device}: {status.state.name.lower().replace('_', ' ')}: {english(*status.reason)}"
            )

    def say(self, elapsed_s: float, words: str) -> None:
        """Print a permanent line of text, with the seconds since the start."""
        self._console.print(f"{elapsed_s:5.1f} s  {words}", soft_wrap=True, highlight=False)

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()
