"""Sends alerts to people by apprise (mail, ntfy, webhook …), in its own thread. No other module imports apprise."""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import datetime
from queue import Empty, SimpleQueue
from typing import Any

from bridge.reasons.catalogue import explain
from bridge.toml.loader import ConfigError
from bridge.wire.messages import Placement
from estimator.alerts.board import Change
from estimator.alerts.outbox import News, Outbox, sentence
from estimator.config.alerts import Alerts

log = logging.getLogger(__name__)

#: interval of looking at the outbox, s; longest wait for the last message at the end, s
_LOOK_S, _END_S = 0.5, 5.0
#: message title and body; returns whether every address took it
Notify = Callable[[str, str], bool]


class Sender:
    """Thread that sends a ward's alerts to people. A message that an address refuses is logged and not sent again.

    ward: name of the ward, for the title. Raises ConfigError for an address in the settings that cannot be used.
    """

    def __init__(self, ward: str, settings: Alerts) -> None:
        self._ward = ward
        self._outbox, self._came = Outbox(settings), SimpleQueue[tuple[str, Placement | None, Change]]()
        self.use(settings)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="alerts", daemon=True)  # started by the first alert

    def use(self, settings: Alerts) -> None:
        """Use changed settings from now on. Raises ConfigError for an address that cannot be used."""
        self._notify = by_apprise(settings.urls())
        self._outbox.settings = settings

    def put(self, subject: str, placement: Placement | None, change: Change) -> None:
        """Queue an alert or all-clear for sending; never waits.

        subject: id of a device or an estimator. placement: that of the device; None if unknown.
        change: the alert; an all-clear if `change.cleared` is True.
        """
        self._came.put((subject, placement, change))
        if self._thread.ident is None:
            self._thread.start()

    def close(self) -> None:
        """Stop the thread. Waiting alerts are not sent later; the next start, or another estimator, has them as standing."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join(_END_S)

    def _run(self) -> None:
        while not self._stop.wait(_LOOK_S):
            now = time.monotonic()
            with suppress(Empty):
                while True:
                    self._outbox.put(*self._came.get_nowait(), now)
            if news := self._outbox.take(now, datetime.now().astimezone()):
                title, body = message(self._ward, news, self._outbox.settings.language)
                try:
                    sent = self._notify(title, body)
                except Exception:
                    log.exception("alerts were not sent")
                    continue
                if not sent:
                    log.error("alerts were not sent to every address: %s", title)


def message(ward: str, news: Sequence[News], language: str) -> tuple[str, str]:
    """Compose a message from alerts: returns its title and its body, with alerts first, then all-clears.

    ward: name of the ward. language: `en` or `zh`.
    """
    lines = list[str]()
    for one in sorted(news, key=lambda one: (one.cleared, one.subject)):
        worn = f" ({one.placement})" if one.placement else ""
        words = explain((sentence(one.alert.kind, f"{one.subject}{worn}"),), language)
        since = datetime.fromtimestamp(one.alert.since_ns / 1e9).astimezone().strftime("%Y-%m-%d %H:%M")
        lines.append(f"{'✓' if one.cleared else '!'} {since} {words}")
    raised = sum(not one.cleared for one in news)
    title = f"{ward}: {'!' if raised else '✓'} {raised or len(news)}"
    return title, "\n".join(lines)


def by_apprise(urls: Sequence[str]) -> Notify:
    """Return a function that sends a title and a body by apprise; it returns True if every address accepts them.

    urls: addresses in apprise's form; if empty, the function does nothing and returns True.
    Raises ConfigError for a missing package or an invalid address.
    """
    if not urls:
        return lambda _title, _body: True
    try:
        import apprise  # noqa: PLC0415 - optional, and slow to import
    except ImportError:
        raise ConfigError(
            "[alerts] sends by apprise, which is not installed: run pip install 'truerate[alerts]', or remove the addresses"
        ) from None
    made: Any = apprise.Apprise()
    for url in urls:
        if not made.add(url):
            scheme = url.partition("://")[0][:20]  # the rest may be a password
            raise ConfigError(
                f"[alerts]: apprise does not know addresses that begin with {scheme}://; use a service from its documentation"
            )
    return lambda title, body: bool(made.notify(title=title, body=body))
