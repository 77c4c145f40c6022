"""Topics that a page can watch, such as `ward@zh` or `trace/chest`. Frames are made once for all viewers of a topic.

A topic's name consists of its kind; for topics of a device `/` and the device id; for topics with text `@` and a
language. Without a language the text is English.

A text frame is JSON with its topic in `topic`. A binary frame begins with the topic's name: its length as one byte, the
name, zeros up to a multiple of eight bytes. Numbers are little-endian.
"""

from collections.abc import Iterable
from typing import Any, ClassVar

import msgspec

from estimator.client import Client, Stream
from estimator.language.texts import LANGUAGES, texts
from estimator.web.hub import Frame
from estimator.web.site import Desk
from estimator.web.ward_state import Story


class Topic:
    """Base class of content that pages watch under one name.

    All methods are called from the event loop and must return quickly.
    """

    #: a device id follows in the name: the topic exists for devices that have been heard of
    of_a_device: ClassVar[bool] = False
    #: the topic has words, so it exists in every language
    worded: ClassVar[bool] = False
    #: interval between calls of `frames`, s
    period_s: ClassVar[float] = 1.0

    def __init__(self, topic: str, desk: Desk) -> None:
        self._topic, self._desk, self._known = topic, desk, desk.known
        self._device, self._t = device_of(topic), texts(topic.partition("@")[2] or LANGUAGES[0])
        #: subscriptions of the topic, which end with it
        self._streams: list[Stream[Any]] = []

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:  # noqa: ARG002 - for topics that need it
        """Return the frames of the whole present content, which a new viewer needs first; none by default.

        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        return ()

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:
        """Return the new frames for all viewers; called every `period_s` seconds. By default the whole content.

        now: monotonic time, s. now_ns: ns since the Unix epoch.
        """
        return self.whole(now, now_ns)

    def close(self) -> None:
        """End the topic's subscriptions; called when no page watches the topic."""
        for stream in self._streams:
            stream.close()

    @property
    def _client(self) -> Client:
        assert self._desk.client is not None, "messages of a device have come by it"
        return self._desk.client

    @property
    def _story(self) -> Story | None:
        """Everything known of the topic's device; None once it is forgotten."""
        return self._known.stories.get(self._device)


def device_of(topic: str) -> str:
    """Return the device id in a topic's name; empty for topics of the ward."""
    return topic.partition("@")[0].partition("/")[2]


def text(topic: str, content: Any) -> str:
    """Encode a text frame: JSON with the topic's name under `topic` and the content under `is`."""
    return msgspec.json.encode({"topic": topic, "is": content}).decode()


def binary(topic: str, content: bytes) -> bytes:
    """Encode a binary frame: length of the topic's name as one byte, the name, zeros, then `content`.

    The zeros fill up to a multiple of eight bytes.
    """
    head = bytes([len(topic)]) + topic.encode()
    return head + bytes(-len(head) % 8) + content
