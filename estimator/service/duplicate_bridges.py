"""Devices sent by two bridges: the estimator takes one bridge's samples and refuses the other's."""

from collections.abc import Iterable, Sequence

from bridge.reasons.codes import Code, Sentence
from bridge.wire.messages import Status

_MOST = 4  # devices named in a sentence


def said(devices: Sequence[str], owner: str, refused: Sequence[str]) -> Sentence:
    """Return a sentence about devices that two bridges send, and what to do.

    owner: the bridge whose samples are taken. refused: the other bridges. The sentence names the first few devices.
    """
    params = {"devices": ", ".join(devices[:_MOST]), "owner": owner, "refused": ", ".join(refused)}
    if (left := len(devices) - _MOST) > 0:
        return Code.TWO_BRIDGES_AND_MORE(more=left, **params)
    return Code.TWO_BRIDGES(**params)


def found(statuses: Iterable[Status]) -> list[Sentence]:
    """Return one sentence for each set of bridges that send the same devices now, from the devices' latest statuses."""
    sets: dict[tuple[str, tuple[str, ...]], list[str]] = {}
    for status in statuses:
        if status.refused_bridges:
            sets.setdefault((status.bridge, tuple(sorted(status.refused_bridges))), []).append(status.device)
    return [said(sorted(devices), owner, refused) for (owner, refused), devices in sorted(sets.items())]
