"""Command `truerate record`: subscribes to a ward and records its messages until stopped."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from pathlib import Path

from rich.console import Console
from rich.live import Live
from rich.text import Text

from bridge.bucket.bucket import Bucket
from bridge.bucket.mirror import Mirror
from bridge.bus.access_self_test import self_test
from bridge.bus.contract import Bus, BusError, Message, Subscription
from bridge.bus.missed_messages import describe_missed
from bridge.bus.routers import Routers
from bridge.bus.zenoh_bus import ZenohBus
from bridge.recording.error import RecordingError
from bridge.recording.files import Folder, recorded_in
from bridge.recording.message_kinds import KINDS, SAMPLES
from bridge.recording.recorder import MOST_REPEATED, WardRecorder
from bridge.recording.settings import Recorder
from bridge.runtime.service_manager import supervised
from bridge.runtime.signals import stopped_by_signal
from bridge.terminal.plurals import count
from bridge.wire import keys
from bridge.wire.keys import Key
from bridge.wire.refusal import Refusal

#: messages kept while the disk is slow: some fifteen seconds of a hundred devices
QUEUE = 65_536
#: folder of recordings in a bucket
RECORDINGS = "recordings"
_ROUND_S = 0.1
#: seconds between updates of the line on a terminal, and between lines in a log
_SHOW_S, _LOG_S = 1.0, 60.0
_RETRY_S = 0.2
#: kinds sent repeatedly, where only the latest counts; a calibration is not, as the one before may be in force
_LATEST = ("info", "status")
#: a device that sent nothing for so long is silent, s
_SILENT_S = 3.0
_log = logging.getLogger(__name__)

OpenBus = Callable[[Sequence[str]], Bus]


def record(
    ward: str,
    endpoints: Sequence[str],
    settings: Recorder,
    console: Console,
    *,
    seconds: float | None = None,
    open_bus: OpenBus = ZenohBus,
    connected: Callable[[Bus], object] | None = None,
    changed: Callable[[], Recorder | None] = lambda: None,
    bucket: Bucket | None = None,
) -> int:
    """Record a ward's messages to files until stopped by a signal, or for `seconds` s.

    settings: folder, file sizes and devices. open_bus: connects to the endpoints. connected: called with the bus, once
    it is open. changed: returns new settings, or None if there are none; called several times a second. bucket: object
    storage to which finished recordings are copied; None for no copies.
    Returns the exit code: 1 if a message was not recorded or a file not copied, else 0.
    Raises RecordingError if no device is received or no file can be written, and BusError if no router is found.
    """
    folder = Folder(Path(settings.folder), ward)
    for path in folder.leftovers():
        _log.warning("%s was not finished: complete it with truerate recording recover %s", path, path)
    with stopped_by_signal() as stop, supervised(), ExitStack() as copying:
        mirror = Mirror(bucket, RECORDINGS, lambda: [one.path for one in folder.finished()]) if bucket else None
        if mirror is not None:
            copying.callback(mirror.close)
        deadline = time.monotonic() + settings.wait_s
        with _connected(open_bus, endpoints, stop, deadline) as bus:
            subscription = bus.subscribe(keys.everything(ward), history=True, capacity=QUEUE)
            for words in self_test(bus, Routers.of(endpoints), ward, open_bus):
                _log.error("%s", words)
            if connected is not None:
                connected(bus)
            first = _first(subscription, settings.devices, stop, deadline)
            if first is None:
                if stop.is_set():
                    raise RecordingError("stopped before any device was heard: nothing was recorded")
                raise RecordingError(_nobody(ward, endpoints, settings))
            recorder = WardRecorder(
                folder,
                ward,
                settings,
                copied=lambda path: mirror is None or mirror.has(path),
            )
            try:
                recorder.begin(time.time_ns(), time.monotonic())
            except OSError as error:
                raise RecordingError(f"recording cannot begin: {recorder.said(error)}") from None
            _run(bus, subscription, recorder, first, stop, seconds, console, changed, mirror)
    for path in recorder.account.files:
        console.print(recorded_in(path), highlight=False, soft_wrap=True)
    not_copied = mirror is not None and mirror.fault is not None
    return 1 if recorder.account.not_recorded or recorder.account.trouble or not_copied else 0


def _connected(open_bus: OpenBus, endpoints: Sequence[str], stop: threading.Event, deadline: float) -> Bus:
    began, told = time.monotonic(), False
    while True:
        try:
            return open_bus(endpoints)
        except BusError as error:
            if not told:
                told = True
                _log.warning("looking for a router at %s", ", ".join(endpoints))
            if time.monotonic() >= deadline or stop.wait(_RETRY_S):
                looked_s = time.monotonic() - began
                raise BusError(f"{error}; searched for {looked_s:.0f} s" if looked_s >= 1 else str(error)) from None


def _first(
    subscription: Subscription, devices: Sequence[str], stop: threading.Event, deadline: float
) -> list[Message] | None:
    """Wait for the first samples of a wanted device; return the messages until then, or None on timeout."""
    holds, heard = dict[str, Message](), deque[Message](maxlen=QUEUE)
    while not stop.is_set() and time.monotonic() < deadline:
        came = [(key, one) for one in subscription.drain(QUEUE, _ROUND_S) if (key := _wanted(one, devices)) is not None]
        for key, message in came:
            if key.what in _LATEST and (message.key in holds or len(holds) < MOST_REPEATED):
                holds[message.key] = message
            else:
                heard.append(message)
        if any(key.what in SAMPLES for key, _ in came):
            return [*holds.values(), *heard]
    return None


def _wanted(message: Message, devices: Sequence[str]) -> Key | None:
    try:
        key = keys.parse(message.key)
    except Refusal:
        return None
    return key if key.what in KINDS and (not devices or key.device in devices) else None


def _nobody(ward: str, endpoints: Sequence[str], settings: Recorder) -> str:
    whom = f"none of {', '.join(settings.devices)}" if settings.devices else "no device"
    return (
        f"{whom} was heard within {settings.wait_s:g} s, so nothing is recorded. Listened to {keys.everything(ward)} at "
        f"{', '.join(endpoints)}. Name the ward with --config WARD.toml or --ward NAME, or start its bridge with "
        "`truerate bridge run WARD.toml`"
    )


def _run(
    bus: Bus,
    subscription: Subscription,
    recorder: WardRecorder,
    first: list[Message],
    stop: threading.Event,
    seconds: float | None,
    console: Console,
    changed: Callable[[], Recorder | None],
    mirror: Mirror | None,
) -> None:
    began = now = time.monotonic()
    messages, shown, logged, there = first, 0.0, began, True

    def said() -> str:
        fault = str(mirror.fault) if mirror is not None and mirror.fault else ""
        return _line(recorder, now - began, now, subscription.missed_by_key, fault)

    terminal = console.is_terminal
    with Live(console=console, refresh_per_second=2, transient=True) if terminal else nullcontext() as live:
        while True:
            now = time.monotonic()
            recorder.take(messages, time.time_ns(), now)
            recorder.tick(time.time_ns(), now)
            if now - shown >= _SHOW_S:
                shown = now
                if live is not None:
                    live.update(Text(said(), "bold red" if recorder.account.trouble else ""))
                elif now - logged >= _LOG_S:
                    logged = now
                    _log.info("recording: %s", said())
                if bus.connected != there:
                    there = bus.connected
                    _log.warning("router %s", "connected again" if there else "gone; waiting for it to return")
            if subscription.closed or (seconds is not None and now - began >= seconds) or stop.wait(_ROUND_S):
                break
            if (settings := changed()) is not None:
                recorder.use(settings)
            messages = subscription.drain(QUEUE, 0.0)  # a round's messages at once cost less than one by one
    now = time.monotonic()
    recorder.take(subscription.drain(QUEUE, 0.0), time.time_ns(), now)
    recorder.close()
    console.print(said(), highlight=False, soft_wrap=True)


def _line(recorder: WardRecorder, elapsed_s: float, now_s: float, missed: Mapping[str, int], copy_fault: str) -> str:
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
