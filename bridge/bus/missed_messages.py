"""English description of missed bus messages by stream: messages of one kind from one device. No I/O."""

from collections import Counter
from collections.abc import Mapping

from bridge.wire import keys
from bridge.wire.refusal import Refusal

_NAMED = 3


def describe_missed(by_key: Mapping[str, int]) -> str:
    """Describe missed messages as one English text, by stream; "" if none are missed.

    A stream is the messages of one kind from one device; the stream with the most losses comes first.
    by_key: number of missed messages by bus key.
    Example: '17 messages missed on the bus: 9 status of chest, 5 raw of wrist, 3 of 2 other streams'.
    """
    streams: Counter[str] = Counter()
    for key, n in by_key.items():
        streams[_stream(key)] += n
    unknown = streams.pop("", 0)
    found = [(stream, n) for stream, n in streams.most_common() if n]
    said = [f"{n} {stream}" for stream, n in found[:_NAMED]]
    if left := sum(n for _, n in found[_NAMED:]):
        said.append(f"{left} of {len(found) - _NAMED} other streams")
    if unknown:
        said.append(f"{unknown} of streams that were new")
    total = streams.total() + unknown
    return f"{total} messages missed on the bus: {', '.join(said)}" if total else ""


def _stream(key: str) -> str:
    try:
        parsed = keys.parse(key)
    except Refusal:
        return ""
    return f"{parsed.what} of {parsed.ids.get('device', parsed.ward)}"
