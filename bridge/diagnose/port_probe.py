"""Probe of a port: listens at one baud rate after another, until a driver recognises the received bytes."""

import contextlib
import string
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from bridge.diagnose.protocol_guess import Candidate, Guess, guesses
from bridge.diagnose.serial_ports import Found
from bridge.reasons.catalogue import english
from bridge.transport import address, serial_errors
from bridge.transport.errors import DeviceLost, DeviceUnavailable
from bridge.transport.transport import Chunk, Transport

COMMON_BAUDS = (115_200, 9600, 57_600, 230_400, 460_800, 921_600, 38_400, 19_200)
_SILENT_SPEEDS = 2  # after silence at this many speeds, no other is tried
_READ_S = 0.1
_ENOUGH_BYTES = 1 << 20
_ALIKE = 0.05
_ODD_BYTES = 0.05  # of all bytes; the most unprintable bytes in a text
_SHOWN = 48  # bytes

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result of probing a port: the best guess of the protocol, or None, and the baud rate.

    found: the port. baud: bits per second; 0 if unknown, or if the port has no baud rate.
    words: why there is no guess, or other matching protocols, and advice; may be "".
    """

    found: Found
    guess: Guess | None
    baud: int
    words: str


def bauds(tried: Iterable[Candidate]) -> list[int]:
    """Return the baud rates to try, bits per second: first the usual rates of the candidates, then COMMON_BAUDS."""
    return list(dict.fromkeys([*(candidate.baud for candidate in tried if candidate.baud), *COMMON_BAUDS]))


def examine(found: Found, tried: Sequence[Candidate], speeds: Sequence[int], seconds: float, say: Say) -> Verdict:
    """Listen at a port at one baud rate after another, until a candidate driver recognises the bytes. Sends nothing.

    found: the port. tried: candidate drivers. speeds: baud rates, bits per second.
    seconds: time to listen at each baud rate, s. say: called with progress messages.
    """
    is_serial = "://" not in found.port
    if is_serial and (said := serial_errors.fault(found.port)) is not None:
        return Verdict(found, None, 0, english(said))
    heard: dict[int, list[Chunk]] = {}
    try:
        for baud in speeds if is_serial else speeds[:1]:
            say(f"{found.port}: listening{f' at {baud}' if is_serial else ''}, {seconds:g} s")
            heard[baud] = _listen(address.transport(found.port, baud), seconds)
            every = guesses(tried, heard[baud])
            made = [guess for guess in every if guess.understood]
            if made:
                return Verdict(found, made[0], baud if is_serial else 0, _advice(made))
            for guess in every:
                if guess.lacking is not None:
                    words = f"data of {guess.candidate}, but no angular rates: {english(guess.lacking)}"
                    return Verdict(found, None, 0, words)
            # A wrong speed gives bytes, but no text; so text, or silence at two speeds, ends the search.
            if _as_text(_joined(heard[baud])) or (len(heard) >= _SILENT_SPEEDS and not any(heard.values())):
                break
    except DeviceUnavailable as error:
        return Verdict(found, None, 0, str(error))
    return Verdict(found, None, 0, _puzzled(heard, is_serial=is_serial))


def _listen(transport: Transport, seconds: float) -> list[Chunk]:
    """Chunks received within `seconds`; raises DeviceUnavailable."""
    chunks: list[Chunk] = []
    transport.open()
    end_s, enough = time.monotonic() + seconds, _ENOUGH_BYTES
    with contextlib.closing(transport), contextlib.suppress(DeviceLost):  # at the end or loss, use the bytes so far
        while time.monotonic() < end_s and enough > 0:
            chunk = transport.read(_READ_S)
            enough -= len(chunk.data)
            if chunk.data:
                chunks.append(chunk)
    return chunks


def _advice(made: Sequence[Guess]) -> str:
    """Other drivers that understand nearly as much as the best one; empty if there are none."""
    best, *others = made
    alike = [str(guess.candidate) for guess in others if guess.share > best.share - _ALIKE]
    return f"other drivers that match: {', '.join(alike)}; choose by the device's model" if alike else ""


def _puzzled(heard: dict[int, list[Chunk]], *, is_serial: bool) -> str:
    speeds = f" at {', '.join(map(str, heard))}" if is_serial else ""
    came = {baud: data for baud, chunks in heard.items() if (data := _joined(chunks))}
    if not came:
        return f"no data{speeds}: switch the device on and let it send; some devices wait for a button or for a host"
    text = {baud: shown for baud, data in came.items() if (shown := _as_text(data))}
    if text:
        baud, shown = next(iter(text.items()))
        where = f" at {baud}" if is_serial else ""
        return f"text that no driver understands{where}, such as {shown!r}: write a profile for it (docs/devices.md)"
    first = next(iter(came.values()))
    wrong = f"a speed other than{speeds.removeprefix(' at')} (try --baud), or " if is_serial else ""
    return (
        f"bytes that no driver understands, such as {first[:16].hex(' ')}: perhaps {wrong}a protocol without a driver"
    )


def _joined(chunks: Iterable[Chunk]) -> bytes:
    return b"".join(chunk.data for chunk in chunks)


def _as_text(data: bytes) -> str:
    """The longest whole line of the data, if they are text; empty otherwise."""
    if not data or len(data.translate(None, string.printable.encode())) > _ODD_BYTES * len(data):
        return ""
    lines = data.decode("ascii", "replace").splitlines()
    return max(lines[1:-1] or lines, key=len)[:_SHOWN].strip() if lines else ""
