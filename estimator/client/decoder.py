"""Decode bus messages; count refused messages by reason and log the first of each reason."""

import logging
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from bridge.bus.contract import Message
from bridge.wire.refusal import Refusal, Tally

log = logging.getLogger(__name__)
T = TypeVar("T")


def refused(*decoders: "Decoder[Any]") -> dict[str, int]:
    """Number of messages that could not be decoded, by text: name of the decoder and reason of the refusal."""
    return {f"{one.name} messages refused, {why}": n for one in decoders for why, n in one.refused.as_dict().items()}


class Decoder(Generic[T]):
    """Decoder for one kind of message; counts the messages that cannot be decoded in `refused`, by reason.

    name: kind of message, for logs and counts. decode(key, payload): returns the message or raises Refusal.
    on_refusal(key, refusal): called for each refused message.
    """

    def __init__(
        self, name: str, decode: Callable[[str, bytes], T], on_refusal: Callable[[str, Refusal], None] | None = None
    ) -> None:
        self.name = name
        self.refused = Tally()
        self._decode, self._on_refusal = decode, on_refusal

    def take(self, message: Message) -> T | None:
        """Decode a message from the bus; returns None if it is refused, and counts the refusal."""
        try:
            return self._decode(message.key, message.payload)
        except Refusal as refusal:
            self.refuse(message.key, refusal)
            return None

    def refuse(self, key: str, refusal: Refusal) -> None:
        """Count a refused message by its reason, log the first of each reason, and call on_refusal."""
        if self.refused.add(refusal.reason) == 1:
            log.warning("%s message refused, %s (further ones of this kind are only counted)", self.name, refusal)
        if self._on_refusal is not None:
            self._on_refusal(key, refusal)
