"""What estimators tell each other, and no estimator can have."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from bridge.wire import codec
from bridge.wire.messages import (
    Holding,
    Move,
    Owned,
    Verdict,
)
from bridge.wire.refusal import Reason
from tests.bridge.wire.drawn import CHECKPOINT, NAN, OWN
from tests.bridge.wire.examples import CAL, KEPT, refused
from tests.sentences import free


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"device": "d2"}, Reason.FOREIGN_ID),
        ({"calibration": dataclasses.replace(CAL, device="d2")}, Reason.FOREIGN_ID),
        ({"calibration": dataclasses.replace(CAL, verdict=Verdict.REFUSED)}, Reason.RANGE),
        ({"calibration": dataclasses.replace(CAL, parameters=(), covariance=np.zeros((0, 0)))}, Reason.RANGE),
        ({"epoch": 2**63}, Reason.RANGE),
    ],
    ids=str,
)
def test_a_checkpoint_that_is_of_no_device_or_no_calibration_is_refused(
    changes: dict[str, Any], reason: Reason
) -> None:
    wrong = dataclasses.replace(KEPT, **changes)
    assert refused(codec.encode_checkpoint(wrong), CHECKPOINT, codec.decode_checkpoint) is reason


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"estimator": "e2"}, Reason.FOREIGN_ID),
        ({"holdings": (Holding("D 1", 1, 1, 1),)}, Reason.BAD_ID),
        ({"holdings": (Holding("d1", 2**63, 1, 1),)}, Reason.RANGE),
        ({"holdings": (Holding("d1", 1, 1, 1),) * 513}, Reason.LENGTH),
        ({"moves": (Move(1, 1, 1, ()),) * 9}, Reason.LENGTH),
        ({"part": 1}, Reason.RANGE),
        ({"parts": 65}, Reason.RANGE),
        ({"load": NAN}, Reason.NON_FINITE),
    ],
    ids=str,
)
def test_what_no_estimator_can_have_is_refused(changes: dict[str, Any], reason: Reason) -> None:
    owned = dataclasses.replace(Owned("e1", 9, 7, 0.5, ()), **changes)
    assert refused(codec.encode_owned(owned), OWN, codec.decode_owned) is reason


def test_a_payload_has_room_for_as_many_devices_as_are_taken() -> None:
    full = Owned(
        "e" * 32, 2**62, 2**62, 1.0, (Holding("d" * 32, 2**62, 2**64 - 1, 2**62, busy=True),) * codec.MAX_HOLDINGS,
        (Move(2**62, 4096, 4096, free("x" * 500)),) * 8,
    )  # fmt: skip
    assert len(codec.encode_owned(full)) <= codec.MAX_PAYLOAD
