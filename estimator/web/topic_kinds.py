"""Registry of topic kinds, by the first part of a topic's name. New kinds must be listed here."""

import re

from bridge.wire.keys import ID
from estimator.language.texts import LANGUAGES
from estimator.web.device_topics import AttitudeTopic, DeviceTopic, ReceiptTopic, TraceTopic, TrailTopic
from estimator.web.guide_topics import GuideTopic
from estimator.web.topics import Topic
from estimator.web.ward_topics import BiasTopic, RatesTopic, WardTopic

KINDS: dict[str, type[Topic]] = {
    "ward": WardTopic,
    "rates": RatesTopic,
    "bias": BiasTopic,
    "device": DeviceTopic,
    "trace": TraceTopic,
    "attitude": AttitudeTopic,
    "trail": TrailTopic,
    "receipts": ReceiptTopic,
    "guide": GuideTopic,
}
_ID = ID.pattern.removesuffix(r"\Z")
_NAME = re.compile(rf"(?P<kind>[a-z]+)(/(?P<device>{_ID}))?(@(?P<language>[a-z]+))?")


def kind_of(topic: str) -> type[Topic] | None:
    """Return the class of the topic of this name; None if no such topic can exist."""
    found = _NAME.fullmatch(topic)
    kind = KINDS.get(found["kind"]) if found else None
    if found is None or kind is None or kind.of_a_device is not bool(found["device"]):
        return None
    spoken = found["language"] is None or (kind.worded and found["language"] in LANGUAGES)
    return kind if spoken else None
