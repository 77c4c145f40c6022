"""Publisher on zenoh (contract.Publisher). A publisher with a cache numbers its messages for gap detection."""

from typing import TYPE_CHECKING

import zenoh

from bridge.bus.contract import BusError
from bridge.bus.publisher_cache import Cache
from bridge.bus.zenoh_session import Declared, is_zenohs, said

if TYPE_CHECKING:
    from bridge.bus.zenoh_bus import ZenohBus


class Publisher(Declared):
    """Publisher of messages on one key over zenoh (contract.Publisher); with a cache, messages are numbered and kept."""

    def __init__(self, bus: "ZenohBus", publisher: zenoh.Publisher, key: str, cache: Cache | None) -> None:
        super().__init__(bus, publisher)
        self._publisher, self._key, self.cache = publisher, key, cache

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        """Send one message. Raises BusError after close, or if zenoh fails.

        attachment: bytes that travel beside the payload, for protocols that require them; ignored if the publisher has
        a cache, which sends its own.
        """
        with self._lock:  # send in the order of the numbers
            if self._closed:
                raise BusError(f"the publisher of {self._key!r} is closed: open a new publisher")
            try:
                if self.cache is None:
                    self._publisher.put(payload, attachment=attachment or None)
                else:
                    self._publisher.put(payload, attachment=self.cache.stamp(self.cache.next))
                    self.cache.keep(payload)
            except BaseException as error:
                if not is_zenohs(error):
                    raise
                raise BusError(f"could not publish on {self._key!r} ({said(error)})") from error

    @property
    def wanted(self) -> bool:
        """True if a subscriber exists now, or if the publisher has a cache, which late subscribers read."""
        if self.cache is not None:
            return True
        try:
            return bool(self._publisher.matching_status.matching)  # type: ignore[attr-defined] # its stub has it wrong
        except zenoh.ZError:
            return False  # the publisher is closed
