"""Decoder of bus messages for a subscriber: counts refused messages by reason, and logs the first of each reason."""

import logging
from collections.abc import Callable
from typing import Generic, TypeVar

from bridge.bus.contract import Message
from bridge.wire.refusal import Refusal, Tally

log = logging.getLogger(__name__)
T = TypeVar("T")


class Decoder(Generic[T]):
    """Decoder for one kind of message; counts messages that cannot be decoded in `refused`, by reason.

    name: kind of message, for logs and counts. decode(key, payload): returns the message or raises Refusal.
    """

    def __init__(self, name: str, decode: Callable[[str, bytes], T]) -> None:
        self.name = name
        self.refused = Tally()
        self._decode = decode

    def take(self, message: Message) -> T | None:
        """Decode a message from the bus; returns None, and counts the refusal, if it is invalid."""
        try:
            return self._decode(message.key, message.payload)
        except Refusal as refusal:
            if self.refused.add(refusal.reason) == 1:
                log.warning(
                    "one %s message was refused: %s (further ones of this kind are counted, not logged)",
                    self.name,
                    refusal,
                )
            return None
