"""View of a ward's estimators: which are alive, which devices each owns, and recent changes of ownership. Pure."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bridge.reasons.catalogue import sentences_as_json
from bridge.reasons.codes import Code, Sentences
from bridge.wire.messages import Holding, Move, Owned


@dataclass(frozen=True, slots=True)
class Share:
    """Estimator of a ward: whether it is alive, the devices that it owns, and recent changes of these.

    load: processor time used by the estimator's process, s per s; 1 is one core in full use. holdings: the owned
    devices. moves: numbers of devices gained and given up, with host times.
    """

    estimator: str
    alive: bool
    load: float
    holdings: tuple[Holding, ...]
    moves: tuple[Move, ...]


@dataclass(frozen=True, slots=True)
class ClusterView:
    """View of all estimators of a ward, sorted by id, each with its devices.

    `troubles`: faults of the ward's estimators, most urgent first.
    """

    ward: str
    shares: Sequence[Share]
    troubles: Sentences

    @property
    def devices(self) -> Mapping[str, tuple[str, Holding]]:
        """Owner of each device, by device id: the estimator's id and its claim.

        If two estimators claim a device, the claim with the higher epoch (number of the ownership) is taken.
        """
        found: dict[str, tuple[str, Holding]] = {}
        for share in self.shares:
            for holding in share.holdings:
                before = found.get(holding.device)
                if before is None or holding.epoch > before[1].epoch:
                    found[holding.device] = share.estimator, holding
        return dict(sorted(found.items()))


def cluster_view(ward: str, alive: Sequence[str], said: Iterable[Owned]) -> ClusterView:
    """Combine the messages of a ward's estimators into one view.

    said: their ownership messages, in order of arrival. alive: ids of the estimators that are alive.
    """
    parts: dict[str, dict[int, Owned]] = {}
    for owned in said:
        heard = parts.setdefault(owned.estimator, {})
        heard[owned.part] = owned
        for part in [part for part in heard if part >= max(1, owned.parts)]:
            del heard[part]
    shares = [_share(name, parts.get(name, {}), alive=name in alive) for name in sorted({*alive, *parts})]
    troubles = [] if alive else [Code.NO_ESTIMATOR()]
    troubles += [
        Code.ESTIMATOR_SILENT(estimator=share.estimator)
        for share in shares
        if share.alive and share.estimator not in parts
    ]
    twice = _twice(shares)
    if twice:
        shown = ", ".join(twice[:3]) + (" …" if len(twice) > 3 else "")
        troubles.append(Code.TWO_ESTIMATORS(devices=len(twice), names=shown))
    return ClusterView(ward, shares, tuple(troubles))


def as_json(view: ClusterView) -> dict[str, Any]:
    """Return the view of a ward's estimators as one JSON-compatible object.

    Keys: ward; well (True without troubles); troubles (sentences); estimators.
    Keys of an estimator: id; alive; load (s per s); devices (by id: epoch, boot id, number of the first sample not yet
    corrected); moves.
    Keys of a move: time_ns (ns since the Unix epoch); came and left (numbers of devices gained and given up); reason.
    """
    return {
        "ward": view.ward,
        "well": not view.troubles,
        "troubles": sentences_as_json(view.troubles),
        "estimators": [
            {
                "id": share.estimator,
                "alive": share.alive,
                "load": round(share.load, 4),
                "devices": {
                    h.device: {"epoch": h.epoch, "boot": f"{h.boot:016x}", "next": h.next} for h in share.holdings
                },
                "moves": [
                    {"time_ns": m.time_ns, "came": m.came, "left": m.left, "reason": sentences_as_json(m.reason)}
                    for m in share.moves
                ],
            }
            for share in view.shares
        ],
    }


def _share(name: str, parts: Mapping[int, Owned], *, alive: bool) -> Share:
    holdings = tuple(h for part in sorted(parts) for h in parts[part].holdings)
    last = max(parts.values(), key=lambda owned: owned.time_ns, default=None)
    return Share(name, alive, last.load if last else 0.0, holdings, last.moves if last else ())


def _twice(shares: Iterable[Share]) -> list[str]:
    seen, twice = set[str](), set[str]()
    for share in shares:
        for holding in share.holdings:
            (twice if holding.device in seen else seen).add(holding.device)
    return sorted(twice)
