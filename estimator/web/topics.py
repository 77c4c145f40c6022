"""What can be watched: `ward`, `rates`, `bias`, `device/<id>`, `trace/<id>`. A topic is made when somebody watches it first.

One that is made of words is named with its language, as `ward@zh`; without one it is English.

A text frame is JSON with its topic in `topic`. A binary frame begins with the topic's name: its length as one byte, the
name, zeros up to a multiple of eight bytes; numbers are little-endian.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol

import msgspec

from bridge.wire.keys import ID
from estimator.client import Client
from estimator.config.device_settings import Treatment
from estimator.language.texts import LANGUAGES, Texts, texts
from estimator.web.hub import Frame
from estimator.web.ward_state import Known


@dataclass(slots=True)
class Sources:
    """What a topic is made of; client is None while no router was ever there."""

    known: Known
    client: Client | None = None
    treatment: Treatment = field(default_factory=Treatment)


class Topic(Protocol):
    """One thing that is watched; all its methods are called from the event loop and must be quick."""

    #: how often `frames` is asked
    period_s: float

    def whole(self, now: float, now_ns: int) -> Iterable[Frame]:
        """What a newcomer needs before the first frame."""

    def frames(self, now: float, now_ns: int) -> Iterable[Frame]:
        """What is new, for everybody."""

    def close(self) -> None:
        """Nobody watches any more."""


Make = Callable[[str, Sources], Topic]
#: by the first part of the name, what makes a topic of the whole name; `/<id>` follows where a device is meant
KINDS: dict[str, Make] = {}
OF_A_DEVICE: set[str] = set()
#: those that are told in a language
WORDED: set[str] = set()


def kind(name: str, *, of_a_device: bool = False, worded: bool = False) -> Callable[[Make], Make]:
    """Make a kind of topic known under the first part of its name."""

    def add(make: Make) -> Make:
        KINDS[name] = make
        if of_a_device:
            OF_A_DEVICE.add(name)
        if worded:
            WORDED.add(name)
        return make

    return add


def exists(topic: str) -> bool:
    """Whether there is such a topic."""
    bare, at, language = topic.partition("@")
    name, slash, device = bare.partition("/")
    spoken = name in WORDED and language in LANGUAGES if at else True
    return name in KINDS and spoken and (bool(ID.match(device)) if name in OF_A_DEVICE else not slash)


def kind_of(topic: str) -> str:
    """The first part of its name."""
    return topic.partition("@")[0].partition("/")[0]


def device_of(topic: str) -> str:
    """The device that is meant, or nothing."""
    return topic.partition("@")[0].partition("/")[2]


def texts_of(topic: str) -> Texts:
    """In what it is told."""
    return texts(topic.partition("@")[2] or LANGUAGES[0])


def text(topic: str, content: Any) -> str:
    """A JSON frame."""
    return msgspec.json.encode({"topic": topic, "is": content}).decode()


def binary(topic: str, content: bytes) -> bytes:
    """A binary frame."""
    head = bytes([len(topic)]) + topic.encode()
    return head + bytes(-len(head) % 8) + content
