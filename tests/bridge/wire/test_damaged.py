"""What is damaged, or noise, is refused; nothing else escapes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.bridge.wire.examples import DOORS, try_door


@pytest.mark.parametrize("kind", DOORS)
def test_every_truncation_is_whole_or_refused(kind: str) -> None:
    door, payload = DOORS[kind]
    door(payload)
    for end in range(len(payload)):
        try_door(door, payload[:end])


@pytest.mark.parametrize("kind", DOORS)
@given(data=st.data())
def test_whatever_is_mutated_only_a_refusal_comes_out(kind: str, data: st.DataObject) -> None:
    door, payload = DOORS[kind]
    mutated = bytearray(payload)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(mutated) - 1))
        mutated[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=5))
        mutated = mutated or bytearray(b"\0")
    try_door(door, bytes(mutated))


@pytest.mark.parametrize("kind", DOORS)
@given(payload=st.binary(max_size=200))
def test_noise_is_refused(kind: str, payload: bytes) -> None:
    try_door(DOORS[kind][0], payload)
