"""Encoding and decoding of sentences (reason codes with parameters), bounded and printable."""

from collections.abc import Iterable, Sequence

from bridge.reasons.codes import Sentence, Sentences
from bridge.wire import truerate_pb2 as pb
from bridge.wire.refusal import Reason, Refusal
from bridge.wire.validation import MAX_NAME, MAX_SENTENCE, MAX_TEXTS, clean, text

_MAX_PARAMS = 8


def encoded(sentences: Sentences) -> Iterable[pb.Sentence]:
    """Yield the first MAX_TEXTS sentences as protobuf messages; parameter values are made printable and cut."""
    for code, params in sentences[:MAX_TEXTS]:
        values = {name: clean(value, MAX_SENTENCE) for name, value in params.items()}
        yield pb.Sentence(code=code, params=values)


def decoded(raw: Sequence[pb.Sentence], name: str) -> Sentences:
    """Validate and convert the sentences of a repeated protobuf field `name`.

    Accepts unknown codes, for later versions.
    Raises Refusal.
    """
    if len(raw) > MAX_TEXTS:
        raise Refusal(Reason.LENGTH, f"{name} has {len(raw)} sentences; at most {MAX_TEXTS} are allowed")
    return tuple(_decoded(one, name) for one in raw)


def _decoded(raw: pb.Sentence, name: str) -> Sentence:
    if len(raw.params) > _MAX_PARAMS:
        raise Refusal(Reason.LENGTH, f"{name} has {len(raw.params)} parameters; at most {_MAX_PARAMS} are allowed")
    code = text(raw.code, f"a code of {name}")
    params = {
        text(label, f"a parameter of {name}", MAX_NAME): text(value, f"{label} of {name}", MAX_SENTENCE)
        for label, value in raw.params.items()
    }
    return Sentence(code, params)
