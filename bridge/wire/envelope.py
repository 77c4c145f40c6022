"""What all messages have in common at the door: a key of the right kind, a size, a version, and the ids of the key."""

from typing import TypeVar

from google.protobuf.message import DecodeError, Message

from bridge.wire import keys
from bridge.wire.keys import Key
from bridge.wire.messages import VERSION
from bridge.wire.refusal import Reason, Refusal

MAX_PAYLOAD = 65_536

M = TypeVar("M", bound=Message)


def parse_key(key: str, what: str) -> Key:
    """The parts of a key that must be of the kind `what`."""
    place = keys.parse(key)
    if place.what != what:
        raise Refusal(Reason.BAD_KEY, f"{key!r} is a key of {place.what}, not of {what}")
    return place


def read(kind: type[M], payload: bytes) -> M:
    """The protobuf message in a payload, of our version; its fields are not checked yet."""
    if len(payload) > MAX_PAYLOAD:
        raise Refusal(Reason.TOO_LARGE, f"{len(payload)} bytes; at most {MAX_PAYLOAD} are taken")
    message = kind()
    try:
        message.ParseFromString(payload)
    except (DecodeError, UnicodeDecodeError, RuntimeWarning) as error:
        raise Refusal(Reason.MALFORMED, f"not a {kind.__name__}: {error}") from None
    version = message.version  # type: ignore[attr-defined] # every message of ours begins with it
    if version != VERSION:
        raise Refusal(Reason.VERSION, f"a {kind.__name__} of version {version}; this program speaks {VERSION}")
    return message


def same_id(said: str, place: Key, name: str) -> None:
    """Refuse a payload that says another id than its key."""
    if said != place.ids[name]:
        raise Refusal(Reason.FOREIGN_ID, f"the payload says {name} {said[:64]!r}, the key {place.ids[name]!r}")
