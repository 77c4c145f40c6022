"""Checks common to all received messages: kind of key, payload size, version, and the id in key and payload."""

from typing import TypeVar

from google.protobuf.message import DecodeError, Message

from bridge.wire import keys
from bridge.wire.keys import Key
from bridge.wire.messages import VERSION
from bridge.wire.refusal import Reason, Refusal

MAX_PAYLOAD = 65_536

M = TypeVar("M", bound=Message)


def parse_key(key: str, what: str) -> Key:
    """Parse a bus key and check that it is of the kind `what`, for example `status`.

    Raises Refusal for any other key.
    """
    place = keys.parse(key)
    if place.what != what:
        raise Refusal(Reason.BAD_KEY, f"{key!r} is a key for {place.what} messages; a key for {what} is expected")
    return place


def read(kind: type[M], payload: bytes) -> M:
    """Parse a payload as a protobuf message of class `kind`; of its fields only the version is checked.

    Raises Refusal if the payload is too large, is not of this class, or has an unknown version.
    """
    if len(payload) > MAX_PAYLOAD:
        raise Refusal(Reason.TOO_LARGE, f"the payload has {len(payload)} bytes; at most {MAX_PAYLOAD} are allowed")
    message = kind()
    try:
        message.ParseFromString(payload)
    except (DecodeError, UnicodeDecodeError, RuntimeWarning) as error:
        raise Refusal(Reason.MALFORMED, f"not a {kind.__name__}: {error}") from None
    version = message.version  # type: ignore[attr-defined] # every message has this field
    if version != VERSION:
        raise Refusal(Reason.VERSION, f"the {kind.__name__} has version {version}; version {VERSION} is expected")
    return message


def same_id(said: str, place: Key, name: str) -> None:
    """Check that payload and key contain the same id; raises Refusal if not.

    said: id in the payload. place: the parsed key. name: kind of id, for example `device`.
    """
    if said != place.ids[name]:
        raise Refusal(Reason.FOREIGN_ID, f"the payload has {name} {said[:64]!r}, but the key has {place.ids[name]!r}")


def opened(kind: type[M], what: str, key: str, payload: bytes, id_: str = "device") -> tuple[M, Key]:
    """Parse a payload and its key, which must contain the same id; returns the protobuf message and the parsed key.

    kind: protobuf class. what: kind of key, for example `status`. id_: name of the id to compare.
    Raises Refusal for an invalid payload or key, and for different ids.
    """
    place = parse_key(key, what)
    message = read(kind, payload)
    same_id(getattr(message, id_), place, id_)
    return message, place
