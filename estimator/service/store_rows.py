"""Rows of the estimator's store: their content as objects, and objects as columns."""

import logging
from collections.abc import Iterable
from functools import cache
from importlib.metadata import version
from typing import Any, NamedTuple

import msgspec
import numpy as np

from bridge.reasons.codes import Sentences
from bridge.wire import codec, keys
from bridge.wire.messages import Calibration
from bridge.wire.refusal import Refusal
from estimator.database import Row
from estimator.tracking.bias_state import BiasState

log = logging.getLogger(__name__)


class Before(NamedTuple):
    """Calibrations of an earlier power-up under the same boot number: their ids, and when that was seen, or None."""

    ids: frozenset[str]
    seen_ns: int | None

    def has(self, calibration: Calibration) -> bool:
        """Whether a calibration belongs to the earlier power-up, as far as known."""
        return calibration.id in self.ids or (self.seen_ns is not None and calibration.time_ns < self.seen_ns)


class Kept(msgspec.Struct):
    """Stored bias of a boot: see `Store.save_bias`."""

    x: list[float]
    P: list[list[float]]
    time: float
    temperature_c: float
    powered: float
    lag_k: float
    doubted: bool
    calibration: str
    asked: tuple[str, str] | None
    reached: tuple[int, int] | None
    bridge: str
    #: the whole session of an estimator that was stopped in order; empty where only the bias is stored
    session: bytes = b""

    def state(self) -> BiasState:
        """The bias filter's state."""
        x, P = np.array(self.x), np.array(self.P)
        return BiasState(x, P, self.time, self.temperature_c, self.powered, lag_k=self.lag_k)


def calibrations_in(rows: Iterable[Row]) -> list[Calibration]:
    """Calibrations of rows of `calibrations`; one that this version cannot decode is left out and logged."""
    found = []
    for row in rows:
        try:
            place = keys.build("store", "calibration", device=row["device"])
            found.append(codec.decode_calibration(place, row["payload"]))
        except Refusal as refusal:  # written by a truerate whose limits differ
            log.error("calibration %s of %s is not used: %s", row["id"], row["device"], refusal)
    return found


def written(sentences: Sentences) -> str:
    """Sentences as JSON for a text column."""
    return msgspec.json.encode(sentences).decode()


def read_sentences(text: str) -> Sentences:
    """Sentences from the JSON of a text column."""
    return msgspec.json.decode(text, type=Sentences)


def kept_in(row: dict[str, Any]) -> Kept | None:
    """Content of a row of `bias`; None where another power-up used its boot number."""
    return msgspec.msgpack.decode(row["state"], type=Kept) if row["state"] else None


def repeat_request(device: str, boot: int) -> str:
    """Request id of a repeated boot number in the audit."""
    return f"{device} {keys.boot_id(boot)}"


@cache
def own_version() -> str:
    """Version of this program."""
    return version("truerate")
