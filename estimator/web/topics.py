"""Topics that a page can watch: `ward`, `rates`, `bias`, `device/<id>`, `attitude/<id>`, `trace/<id>`. Made when first watched.

A topic with words is named with its language, as `ward@zh`; without a language it is English.

A text frame is JSON with its topic in `topic`. A binary frame begins with the topic's name: its length as one byte, the
name, zeros up to a multiple of eight bytes. Numbers are little-endian.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import msgspec

from bridge.wire.keys import ID
from estimator.client import Client
from estimator.config.device_settings import Treatment
from estimator.language.texts import LANGUAGES, Texts, texts
from estimator.web.hub import Frame
from estimator.web.ward_state import Known


@dataclass(slots=True)
class Sources:
    """What topics take their content from: ward state, device settings, and the bus client.

    client: None until a router is first connected.
    """

    known: Known
    client: Client | None = None
    treatment: Treatment = field(default_factory=Treatment)


class Topic(ABC):
    """Content that pages watch under one name. All methods are called from the event loop and must be quick.

    In all of them, now is monotonic time in s, and now_ns the time since the Unix epoch in ns.
    """

    #: interval between calls of `frames`, s
    period_s = 1.0

    def __init__(self, topic: str, sources: Sources) -> None:
        self._topic, self._known = topic, sources.known
        self._device, self._t = device_of(topic), texts_of(topic)

    @abstractmethod
    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:
        """Return the frames of the whole present content, which a new viewer needs first."""

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:
        """Return the new frames for all viewers, called every period_s; by default the whole content."""
        return self.whole(now, now_ns)

    def close(self) -> None:  # noqa: B027 - most topics have nothing to release
        """Release the topic's subscriptions when nobody watches it any more."""


Make = Callable[[str, Sources], Topic]
#: maker of a topic, by the first part of the topic's name; `/<id>` follows for topics of a device
KINDS: dict[str, Make] = {}
OF_A_DEVICE: set[str] = set()
#: kinds with words, which exist in every language
WORDED: set[str] = set()


def kind(name: str, *, of_a_device: bool = False, worded: bool = False) -> Callable[[Make], Make]:
    """Class decorator: register a kind of topic under `name`, the first part of its topics' names.

    of_a_device: `/<id>` follows the name. worded: the topic has words, so it exists in every language.
    """

    def add(make: Make) -> Make:
        KINDS[name] = make
        if of_a_device:
            OF_A_DEVICE.add(name)
        if worded:
            WORDED.add(name)
        return make

    return add


def exists(topic: str) -> bool:
    """Whether a topic of this name exists: its kind, its language, and a well-formed device id."""
    bare, at, language = topic.partition("@")
    name, slash, device = bare.partition("/")
    spoken = name in WORDED and language in LANGUAGES if at else True
    return name in KINDS and spoken and (bool(ID.match(device)) if name in OF_A_DEVICE else not slash)


def kind_of(topic: str) -> str:
    """Return the kind of a topic: the first part of its name."""
    return topic.partition("@")[0].partition("/")[0]


def device_of(topic: str) -> str:
    """Return the device id in a topic's name; empty for topics of the ward."""
    return topic.partition("@")[0].partition("/")[2]


def texts_of(topic: str) -> Texts:
    """Return the texts in the language of a topic's name; English without one."""
    return texts(topic.partition("@")[2] or LANGUAGES[0])


def text(topic: str, content: Any) -> str:
    """Encode a text frame: JSON with the topic's name and its content."""
    return msgspec.json.encode({"topic": topic, "is": content}).decode()


def binary(topic: str, content: bytes) -> bytes:
    """Encode a binary frame: the topic's name, padded to a multiple of eight bytes, then `content`."""
    head = bytes([len(topic)]) + topic.encode()
    return head + bytes(-len(head) % 8) + content
