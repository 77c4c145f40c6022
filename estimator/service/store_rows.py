"""Rows of the estimator's store: conversion between rows and objects."""

import logging
from collections.abc import Iterable
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
    """Calibrations of an earlier power-up under the same boot number.

    ids: ids of these calibrations. seen_ns: host time at which the repeated number was noticed, ns since the Unix
    epoch; None if the number was not repeated.
    """

    ids: frozenset[str]
    seen_ns: int | None

    def has(self, calibration: Calibration) -> bool:
        """Return whether a calibration belongs to the earlier power-up: by its id, or older than `seen_ns`."""
        return calibration.id in self.ids or (self.seen_ns is not None and calibration.time_ns < self.seen_ns)


class Kept(msgspec.Struct):
    """Stored bias of a boot, as `Store.save_bias` writes it.

    x (6): state of the bias filter: bias (3, rad/s), then its slope by temperature (3, rad/s/K). P (6, 6): covariance
    of x.
    time, powered: device time of the state and of power-up, s.
    temperature_c: mean of the last seconds, °C; the latest reading is `lag_k` kelvin above it. doubted: whether the
    bias was in doubt.
    calibration: id of the calibration in use. asked: person who requested the recalibration in progress, and the
    reason.
    reached: sequence number and host time, ns since the Unix epoch, of the last sample used for the bias. bridge: id of
    the bridge whose samples were used.
    """

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
        """Convert the stored bias to the state of a bias filter."""
        x, P = np.array(self.x), np.array(self.P)
        return BiasState(x, P, self.time, self.temperature_c, self.powered, lag_k=self.lag_k)


def calibrations_in(rows: Iterable[Row]) -> list[Calibration]:
    """Decode the calibrations in rows of the table `calibrations`.

    Calibrations that cannot be decoded are logged and left out.
    """
    found = []
    for row in rows:
        try:
            place = keys.build("store", "calibration", device=row["device"])
            found.append(codec.decode_calibration(place, row["payload"]))
        except Refusal as refusal:  # written by a truerate whose limits differ
            log.error("calibration %s of %s is not used: %s", row["id"], row["device"], refusal)
    return found


def written(sentences: Sentences) -> str:
    """Encode sentences (codes and parameters) as JSON for a text column. Inverse of `read_sentences`."""
    return msgspec.json.encode(sentences).decode()


def read_sentences(text: str) -> Sentences:
    """Decode sentences from the JSON of a text column. Inverse of `written`."""
    return msgspec.json.decode(text, type=Sentences)


def kept_in(row: dict[str, Any]) -> Kept | None:
    """Decode the stored bias in a row of the table `bias`; None if another power-up used its boot number."""
    return msgspec.msgpack.decode(row["state"], type=Kept) if row["state"] else None


def repeat_request(device: str, boot: int) -> str:
    """Return the request id under which the audit records that two power-ups used one boot number."""
    return f"{device} {keys.boot_id(boot)}"
