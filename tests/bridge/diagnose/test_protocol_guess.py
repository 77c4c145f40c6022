"""Bytes are given to every decoder, and the right one is told from the others."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.diagnose.protocol_guess import Guess, candidates, guesses
from bridge.drivers import registry
from bridge.drivers.driver import DriverKind
from bridge.sim.virtual_device import demo_device
from bridge.transport.transport import Chunk
from tests.bridge.diagnose.protocol import KINDS, lines
from tests.bridge.text.printed import PRINTS

START_NS = 10**18


def chunks(data: bytes, size: int = 40, period_ns: int = 10_000_000) -> list[Chunk]:
    return [Chunk(data[i : i + size], START_NS + i // size * period_ns) for i in range(0, len(data), size)]


def best(data: bytes, kinds: tuple[DriverKind, ...] = KINDS) -> Guess:
    return guesses(candidates(kinds), chunks(data))[0]


def test_each_protocol_is_known_by_its_bytes_and_by_what_it_says() -> None:
    native = best(demo_device("d", 1).advance(2.0))
    assert (str(native.candidate), native.understood, native.faults) == ("native", True, 0)
    assert native.identity is not None
    assert native.identity.model == "truerate-virtual"
    line = best(lines())
    assert (str(line.candidate), line.understood, line.share) == ("line", True, 1.0)
    other = best(lines("%"))
    assert (str(other.candidate), other.candidate.table) == ("signed %", {"sign": "%"})


@given(st.integers(0, 5000), st.binary(max_size=200))
def test_a_beginning_anywhere_and_some_noise_do_not_mislead(cut: int, noise: bytes) -> None:
    native = demo_device("d", 1).advance(4.0)
    assert str(best(noise + native[cut:]).candidate) == "native"
    assert str(best(noise + lines(n=400)[cut:]).candidate) == "line"


@given(st.binary(max_size=3000))
def test_noise_is_nobodys(noise: bytes) -> None:
    assert not any(guess.understood for guess in guesses(candidates(KINDS), chunks(noise)))


@pytest.mark.parametrize("name", ["nano-33-ble", "icm-20948-sparkfun", "openlog-artemis", "razor-m0"])
def test_text_is_known_by_its_profile(name: str) -> None:
    printed = PRINTS[name](60).splitlines(keepends=True)
    chunks = [Chunk(line, START_NS + 10_000_000 * i) for i, line in enumerate(printed)]
    first = guesses(candidates(registry.kinds().values()), chunks)[0]
    assert first.understood
    assert str(first.candidate) == f"text_profile {name}"
