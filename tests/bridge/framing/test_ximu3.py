"""x-IMU3 messages: the manual's own examples, and x-io's reader as the witness for all others."""

import math
from pathlib import Path

import numpy as np
import pytest

from bridge.framing.lines import Lines
from bridge.framing.packets import BadPacket, Charge
from bridge.framing.ximu3 import Inertial, Message, Reply, Said, Temperature, decode
from tests.bridge.drivers import xio
from tests.bridge.framing import ximu3_encode

# User manual, section "Data messages": each at 1 s, binary and ASCII. (Its binary temperature is printed big-endian.)
T = "40 42 0F 00 00 00 00 00"
ZEROS = "00 00 00 00 "
MANUAL: list[tuple[str, str, Message | None]] = [
    (
        f"C9 {T} {5 * ZEROS} 00 00 80 3F",
        "I,1000000,0.0000,0.0000,0.0000,0.0000,0.0000,1.0000",
        Inertial(1_000_000, (0, 0, 0), (0, 0, 1)),
    ),
    (f"D4 {T} 00 00 C8 41", "T,1000000,25.0000", Temperature(25.0)),
    (
        f"C2 {T} 00 00 C8 42 66 66 86 40 00 00 00 40",
        "B,1000000,100.0000,4.2000,2.0000",
        Charge(100.0, charging=False),
    ),
    (
        f"CE {T} 42 75 74 74 6F 6E 20 70 72 65 73 73 65 64 2E",
        "N,1000000,Button pressed.",
        Said(error=False, text="Button pressed."),
    ),
    (
        f"C6 {T} 42 61 74 74 65 72 79 20 65 6D 70 74 79 2E",
        "F,1000000,Battery empty.",
        Said(error=True, text="Battery empty."),
    ),
    (f"CD {T} 00 00 80 3F {2 * ZEROS}", "M,1000000,1.0000,0.0000,0.0000", None),
    (f"D1 {T} 00 00 80 3F {3 * ZEROS}", "Q,1000000,1.0000,0.0000,0.0000,0.0000", None),
    (f"D2 {T} {9 * ZEROS}", "R,1000000,1,0,0,0,1,0,0,0,1", None),
    (f"C1 {T} {3 * ZEROS}", "A,1000000,0.0000,0.0000,0.0000", None),
    (f"CC {T} {7 * ZEROS}", "L,1000000,1,0,0,0,0,0,0", None),
    (f"C5 {T} {7 * ZEROS}", "E,1000000,1,0,0,0,0,0,0", None),
    (f"D5 {T} {4 * ZEROS}", "U,1000000,1,0,0,0", None),
    (f"C8 {T} {3 * ZEROS}", "H,1000000,0,0,1", None),
    (f"D7 {T} 00 00 C8 42 00 00 48 C2", "W,1000000,100.0000,-50.0000", None),
    (f"D3 {T} 61 62 63 31 32 33 F1 F2 F3", "S,1000000,abc123???", None),
]


@pytest.mark.parametrize(("binary", "text", "message"), MANUAL)
def test_the_manual_s_examples(binary: str, text: str, message: Message | None) -> None:
    assert decode(bytes.fromhex(binary)) == message
    assert decode(text.encode()) == message
    assert decode(text.encode() + b"\r") == message


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("45 58 41 4D 50 4C 45", "45 58 41 4D 50 4C 45"),
        ("45 0A 41 4D 50 4C 45", "45 DB DC 41 4D 50 4C 45"),
        ("45 58 DB 4D 50 4C 45", "45 58 DB DD 4D 50 4C 45"),
        ("45 58 41 4D 50 DB 0A", "45 58 41 4D 50 DB DD DB DC"),
    ],
)
def test_the_manual_s_examples_of_byte_stuffing(before: str, after: str) -> None:
    # The manual stuffs the word EXAMPLE; here it is the text of a notification, with what is not printable as it is shown.
    said = decode(bytes.fromhex(f"CE {T} {after}"))
    assert isinstance(said, Said)
    shown = bytes.fromhex(before).decode("ascii", "replace")
    assert said.text == "".join(c if c.isprintable() else "?" for c in shown)


def test_answers_to_commands() -> None:
    assert decode(b'{"ping":{"interface":"USB","name":"x-IMU3","sn":"01234567"}}') == Reply(
        "ping", {"interface": "USB", "name": "x-IMU3", "sn": "01234567"}
    )
    assert decode(b'{"Serial Number":null}\r') == Reply("serialnumber", None)


@pytest.mark.parametrize(
    ("line", "label"),
    [
        (f"C9 {T} {5 * ZEROS} 00 00 80", "message_length"),
        (f"C9 {T} {6 * ZEROS} 00", "message_length"),
        (f"C9 {T} {5 * ZEROS} 00 00 80 7F", "message_content"),  # an infinity
        (f"C9 {T} {5 * ZEROS} 00 00 C0 7F", "message_content"),  # no number
        (f"D4 {T} 00 00 41 DB C8", "message_escape"),
        (f"D4 {T} 00 00 41 DB", "message_escape"),
        (f"C2 {T} 00 00 C9 42 {2 * ZEROS}", "message_content"),  # 100.5 %
        ("CE 40 42", "message_length"),
        (f"DA {T} {ZEROS}", "message_unknown"),
        ("80", "message_unknown"),
        (b"I,1,2,3,4,5,6".hex(), "message_length"),
        (b"I,1,2,3,4,5,6,7,8".hex(), "message_length"),
        (b"I,1,2,3,4,5,6,nan".hex(), "message_content"),
        (b"I,1,2,3,4,5,6,1e999".hex(), "message_content"),
        (b"I,1,2,3,4,5,6,1_0".hex(), "message_content"),
        (b"I,1.5,2,3,4,5,6,7".hex(), "message_content"),
        (b"I,18446744073709551616,2,3,4,5,6,7".hex(), "message_content"),
        (b"T".hex(), "message_unknown"),
        (b"Temperature 25".hex(), "message_unknown"),
        (b"N,1".hex(), "message_length"),
        (b"N,x,y".hex(), "message_content"),
        (b"Z,1,2".hex(), "message_unknown"),
        (b"{".hex(), "reply_not_json"),
        ((b'{"a":' + 2000 * b"[").hex(), "reply_not_json"),
        (b"{}".hex(), "reply_content"),
        (b'{"a":1,"b":2}'.hex(), "reply_content"),
    ],
)
def test_what_is_damaged_is_said_to_be(line: str, label: str) -> None:
    with pytest.raises(BadPacket) as bad:
        decode(bytes.fromhex(line))
    assert bad.value.label == label


def samples(n: int, rng: np.random.Generator) -> list[bytes]:
    """Messages full of bytes that have to be stuffed."""
    time_us = rng.choice(np.array([0x0A, 0xDB, 0x0ADB, 0x0A0A0ADBDB, 1 << 63, 12345], np.uint64), n)
    gyro, accel = np.radians(rng.normal(size=(2, n, 3)) * 500)
    return ximu3_encode.inertial(time_us, gyro, accel * 9.8)


def ours(data: bytes) -> list[xio.Row]:
    rows: list[xio.Row] = []
    for line in Lines(4096).feed(data):
        try:
            message = decode(line.data)
        except BadPacket:
            continue
        if isinstance(message, Inertial):
            rows.append((message.time_us, message.gyro_dps + message.accel_g))
    return rows


def test_x_io_s_reader_reads_what_we_encode(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    time_us = np.arange(500, dtype=np.int64) * 2500 + 10
    gyro, accel = rng.normal(size=(500, 3)), 9.80665 * rng.normal(size=(500, 3))
    data = b"".join(ximu3_encode.inertial(time_us, gyro, accel))
    data += ximu3_encode.temperature(10, 36.6) + ximu3_encode.battery(219, 10.0, charging=True)
    data += ximu3_encode.notification(2570, "quality good")
    heard = xio.read(data, tmp_path)
    assert heard.errors == []
    assert [row[0] for row in heard.inertial] == time_us.tolist()
    expected = np.hstack([np.degrees(gyro), accel / 9.80665]).astype(np.float32)
    assert np.array_equal(np.array([row[1] for row in heard.inertial], np.float32), expected)
    assert heard.temperature == [(10, (float(np.float32(36.6)),))]
    assert heard.battery == [(219, (10.0, 0.0, 1.0))]
    assert heard.texts == [(2570, "quality good")]


@pytest.mark.parametrize("seed", range(2))
def test_we_and_x_io_make_the_same_of_damaged_bytes(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    stream = []
    for message in samples(10_000, rng):
        damaged = bytearray(message)
        match rng.integers(12):
            case 0:
                damaged[rng.integers(len(damaged))] ^= 1 << rng.integers(8)
            case 1:
                del damaged[rng.integers(len(damaged)) :]
            case 2:
                damaged[rng.integers(len(damaged))] = rng.choice([0x0A, 0xDB, 0xDC, 0xDD, 0x49, 0xC9])
            case 3:
                at = rng.integers(len(damaged))
                damaged[at:at] = rng.bytes(int(rng.integers(1, 9)))
        stream.append(bytes(damaged))
    data = b"".join(stream) + b"\n"
    heard = xio.read(data, tmp_path)
    finite = [row for row in heard.inertial if all(map(math.isfinite, row[1]))]
    mine = ours(data)
    assert mine == finite
    assert 6_000 < len(mine) < 10_000
    assert heard.errors
