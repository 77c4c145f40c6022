"""Shows a recorder's progress: a live line on a terminal, elsewhere a log line per minute."""

import logging
from collections.abc import Mapping
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.live import Live
from rich.text import Text

from bridge.bus.missed_messages import describe_missed
from bridge.recording.recorder import WardRecorder
from bridge.terminal.plurals import count

_EVERY_S = 60.0
_SILENT_S = 3.0
_log = logging.getLogger(__name__)


def line(recorder: WardRecorder, elapsed_s: float, now_s: float, missed: Mapping[str, int]) -> str:
    """Return a recorder's progress in one line: time, devices, samples, size, and missing or refused messages.

    elapsed_s: seconds since the start. now_s: seconds of the recorder's clock. missed: number of missing messages by
    key.
    """
    account = recorder.account
    silent = sum(now_s - heard > _SILENT_S for heard in account.heard.values())
    parts = [
        f"{_clock(elapsed_s)}",
        count(len(account.heard), "device") + (f" ({silent} silent)" if silent else ""),
        f"{account.raw:,} samples, {account.corrected:,} corrected",
        f"{recorder.size / 1e6:.1f} MB",
    ]
    if missed:
        parts.append(describe_missed(missed))
    if refused := account.refused.total():
        parts.append(f"{refused} refused")
    if account.expired:
        parts.append(f"{account.expired} old files deleted")
    if account.not_recorded:
        parts.append(f"{account.not_recorded} not recorded")
    if account.copy_fault:
        parts.append(f"NOT COPIED: {account.copy_fault}")
    if account.trouble:
        parts.append(f"NOT RECORDING: {account.trouble}")
    return "  ".join(parts)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


class Screen:
    """Shows a recorder's progress line: live on a terminal, otherwise in the log once a minute. A context manager."""

    def __init__(self, console: Console) -> None:
        self._live = Live(console=console, refresh_per_second=2, transient=True) if console.is_terminal else None
        self._told_s = 0.0

    def show(self, recorder: WardRecorder, elapsed_s: float, now_s: float, missed: Mapping[str, int]) -> None:
        """Update the line; call it about once a second. The arguments are those of `line`."""
        if self._live is not None:
            style = "bold red" if recorder.account.trouble else ""
            self._live.update(Text(line(recorder, elapsed_s, now_s, missed), style))
        elif elapsed_s - self._told_s >= _EVERY_S:
            self._told_s = elapsed_s
            _log.info("recording: %s", line(recorder, elapsed_s, now_s, missed))

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()
