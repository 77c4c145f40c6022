"""A recorder's progress in one line."""

from collections.abc import Mapping

from bridge.bus.missed_messages import describe_missed
from bridge.recording.recorder import WardRecorder
from bridge.terminal.plurals import count

_SILENT_S = 3.0


def line(recorder: WardRecorder, elapsed_s: float, now_s: float, missed: Mapping[str, int], copy_fault: str) -> str:
    """Return a recorder's progress in one line: time, devices, samples, size, and missing or refused messages.

    elapsed_s: seconds since the start. now_s: seconds of the recorder's clock. missed: number of missing messages by
    key. copy_fault: why finished files are not copied to the bucket; empty if they are.
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
    if copy_fault:
        parts.append(f"NOT COPIED: {copy_fault}")
    if account.trouble:
        parts.append(f"NOT RECORDING: {account.trouble}")
    return "  ".join(parts)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"
