"""Keys, and messages drawn at random."""

from typing import Any

import numpy as np
from hypothesis import strategies as st

from bridge.reasons.codes import Sentence
from bridge.wire import keys
from bridge.wire.messages import (
    AccelerometerCalibration,
    BiasRevision,
    BootCause,
    Calibration,
    Checkpoint,
    CommandReply,
    CorrectedBatch,
    DeviceInfo,
    Holding,
    Move,
    Owned,
    Quality,
    SampleBatch,
    State,
    Status,
    Turn,
    Verdict,
)

RAW = keys.build("ward", "raw", bridge="b1", device="d1")
INFO = keys.build("ward", "info", bridge="b1", device="d1")
CORRECTED = keys.build("ward", "corrected", device="d1")
ORIENTATION = keys.build("ward", "orientation", device="d1")
STATUS = keys.build("ward", "status", device="d1")
CALIBRATION = keys.build("ward", "calibration", device="d1")
REVISION = keys.build("ward", "revision", device="d1")
WINDOWED = keys.build("ward", "@windowed", device="d1")
NOTE = keys.build("ward", "note", device="d1")
RPC = keys.build("ward", "rpc", device="d1", verb="recalibrate")

CHECKPOINT = keys.build("ward", "checkpoint", device="d1")
OWN = keys.build("ward", "owned", estimator="e1")

NAN, INF = float("nan"), float("inf")
U64 = st.integers(0, 2**64 - 1)
TIME = st.integers(0, 2**62)
#: printable: neither control, unassigned nor separator, but for the space
TEXT = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z"), include_characters=" "), max_size=64)
#: so that the last sample of a dozen, too, has a time that can be said
BEGIN, PERIOD = st.integers(0, 2**61), st.floats(1e-9, 1e-3)
SENTENCES = st.lists(st.builds(Sentence, TEXT, st.dictionaries(TEXT, TEXT, max_size=8)), max_size=16).map(tuple)
LABELS = st.dictionaries(TEXT, U64, max_size=5)


def within(limit: float) -> st.SearchStrategy[float]:
    return st.floats(-limit, limit, width=32)


def column(data: st.DataObject, limit: float, *shape: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    size = int(np.prod(shape))
    return np.array(data.draw(st.lists(within(limit), min_size=size, max_size=size)), np.float32).reshape(shape)


def ticks(data: st.DataObject) -> np.ndarray[Any, np.dtype[np.uint64]]:
    steps = data.draw(st.lists(st.integers(1, 2**20), min_size=1, max_size=12))
    return data.draw(st.integers(0, 2**62)) + np.cumsum(steps, dtype=np.uint64)


def flags(data: st.DataObject, n: int) -> np.ndarray[Any, np.dtype[np.uint32]]:
    return np.array(data.draw(st.lists(st.integers(0, 3), min_size=n, max_size=n)), np.uint32)


def samples(data: st.DataObject) -> SampleBatch:
    when = ticks(data)
    n = len(when)
    return SampleBatch(
        "d1", data.draw(U64), data.draw(TIME), data.draw(TIME), data.draw(BEGIN), data.draw(PERIOD),
        data.draw(st.floats(1e-4, 1e4)), when, column(data, 1000, n, 3),
        column(data, 10_000, n, 3) if data.draw(st.booleans()) else None,
        column(data, 500, n) if data.draw(st.booleans()) else None, flags(data, n), "b1",
    )  # fmt: skip


def corrected(data: st.DataObject) -> CorrectedBatch:
    when = ticks(data)
    n = len(when)
    return CorrectedBatch(
        "d1", data.draw(U64), data.draw(TIME), data.draw(BEGIN), data.draw(PERIOD),
        data.draw(st.floats(1e-4, 1e4)), when, column(data, 2000, n, 3), flags(data, n),
        data.draw(st.sampled_from(Quality)), abs(column(data, 9, 3)),
        abs(column(data, 9, 3)), abs(column(data, 9, 3)), column(data, 1000, 3), data.draw(TEXT), abs(column(data, 9, 3)),
        data.draw(TIME), abs(column(data, 9, 3)),
    )  # fmt: skip


INFOS = st.builds(
    DeviceInfo, st.just("d1"), st.just("b1"), U64, st.sampled_from(BootCause), TEXT, TEXT, TEXT, TEXT,
    st.floats(0, 1e6), st.floats(0, 1e9), st.floats(0, 1000), st.booleans(), st.booleans(), TIME, U64, LABELS, LABELS,
    SENTENCES, st.floats(0, 100), st.booleans(), SENTENCES, st.booleans(),
)  # fmt: skip
THREE = st.tuples(*[st.floats(-10, 10)] * 3)
STDS = st.tuples(*[st.floats(0, 10)] * 3)
ACCELEROMETERS = st.none() | st.builds(
    AccelerometerCalibration, st.just(Verdict.ACCEPTED), SENTENCES, st.integers(0, 50), THREE, STDS,
    st.just((0.5,) * 36), st.floats(0, 1),
) | st.builds(AccelerometerCalibration, st.just(Verdict.REPEAT), SENTENCES, st.integers(0, 5))  # fmt: skip
STATUSES = st.builds(
    Status, st.just("d1"), U64, TIME, st.sampled_from(State), st.sampled_from(Quality), SENTENCES, st.floats(0, 1),
    st.lists(st.integers(0, 2), max_size=3).map(tuple), THREE, STDS, THREE, TEXT, TIME, st.floats(0, 1e9),
    st.floats(-100, 100), st.floats(0, 1e6), U64, U64, LABELS, LABELS, st.just("b1"), st.just(("b2",)), TIME,
    accelerometer=ACCELEROMETERS,
)  # fmt: skip
TURNS = st.builds(Turn, st.integers(0, 2), st.floats(-9, 9), st.floats(0, 9), st.floats(0, 99))


PARAMETERS = ("bias_x", "bias_y", "bias_z", "k_x", "k_y", "k_z")


@st.composite
def calibrations(draw: st.DrawFn, *, in_use: bool = False) -> Calibration:
    names = (PARAMETERS if in_use else ()) + tuple(draw(st.lists(TEXT, max_size=4)))
    size = len(names)
    verdict = Verdict.ACCEPTED if in_use else draw(st.sampled_from(Verdict))
    return Calibration(
        "d1", draw(U64), draw(TEXT), draw(TIME), draw(TEXT), verdict, draw(SENTENCES),
        np.array(draw(st.lists(st.floats(-2, 2), min_size=9, max_size=9))).reshape(3, 3), np.array(draw(THREE)), names,
        np.array(draw(st.lists(st.floats(-2, 2), min_size=size**2, max_size=size**2)), float).reshape(size, size),
        tuple(draw(st.lists(TURNS, max_size=4))), np.array(draw(STDS)), draw(TEXT), draw(TEXT),
        draw(st.floats(0, 1000)), draw(st.floats(0, 1e6)), draw(st.floats(-100, 100)), draw(TEXT), draw(TIME),
        draw(ACCELEROMETERS),
    )  # fmt: skip


HOLDINGS = st.builds(Holding, st.sampled_from(["d1", "bed-2_chest"]), TIME, U64, TIME, st.booleans())
OWNED = st.builds(
    Owned, st.just("e1"), TIME, TIME, st.floats(0, 100), st.lists(HOLDINGS, max_size=4).map(tuple),
    st.lists(st.builds(Move, TIME, st.integers(0, 9), st.integers(0, 9), SENTENCES), max_size=8).map(tuple),
    st.integers(0, 3), st.integers(4, 64),
)  # fmt: skip


ANSWERS = st.lists(st.tuples(TEXT, st.builds(CommandReply, TEXT, st.booleans(), SENTENCES)), max_size=8).map(tuple)


@st.composite
def checkpoints(draw: st.DrawFn) -> Checkpoint:
    used = draw(st.none() | calibrations(in_use=True))
    ids = draw(U64), draw(TIME), draw(TIME), draw(st.sampled_from(["", "b1"]))
    return Checkpoint("d1", *ids, used, draw(ANSWERS), draw(st.booleans()), draw(st.binary(max_size=100)))


def rising(data: st.DataObject, n: int, high: int) -> list[int]:
    return sorted(data.draw(st.lists(st.integers(0, high), min_size=n, max_size=n, unique=True)))


def revision(data: st.DataObject) -> BiasRevision:
    n = data.draw(st.integers(2, 12))
    return BiasRevision(
        "d1", data.draw(U64), data.draw(TEXT), data.draw(TIME), column(data, 10, 3, 3).astype(float),
        np.array(rising(data, n, 2**62), np.uint64), np.array(rising(data, n, 2**62), np.int64),
        column(data, 1000, n, 3), abs(column(data, 9, n, 3)), data.draw(SENTENCES),
    )  # fmt: skip
