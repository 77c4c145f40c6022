"""What an Xsens motion tracker is asked and told: one request at a time, each again until it is answered.

In its config state, which it is called into and sent out of again; what it is told it keeps, power or not.
"""

from collections import deque
from collections.abc import Iterable

from bridge.drivers.driver import Notice
from bridge.framing import mtdata2
from bridge.framing.mtdata2 import Message, encode

_ASKED = (mtdata2.REQ_PRODUCT, mtdata2.REQ_DEVICE, mtdata2.REQ_FIRMWARE)
_AGAIN_NS = 500_000_000
_TIMES = 5
_ALWAYS = 0xFFFF  # in every message
_WARMTH_HZ = 10


class Settings:
    """One device's. rate_hz: what it is to send, 0 for what it sends.

    model, firmware, sends_hz: empty and 0 until answered. resumed: it has begun to measure again, to be set back by who saw it.
    """

    def __init__(self, rate_hz: float) -> None:
        self.model, self.firmware, self.sends_hz = "", "", 0.0
        self.resumed = False
        self._wanted_hz = rate_hz
        self._requests: deque[tuple[int, bytes]] = deque()
        self._out: deque[bytes] = deque()
        self._times, self._asked_ns = 0, 0
        self._given_up = False

    @property
    def settled(self) -> bool:
        """Nothing is waited for."""
        return self._given_up or not self._requests

    def begin(self, *, woken: bool = False) -> None:
        """Ask and set everything: the device was opened, or has booted and said so."""
        self._out.clear()
        if woken:
            self._out.append(encode(mtdata2.WAKE_UP_ACK))  # else it would begin to measure
        self._visit(_ASKED)

    def want(self, rate_hz: float) -> None:
        """Another rate from now on."""
        if rate_hz != self._wanted_hz:
            self._wanted_hz = rate_hz
            self._visit([kind for kind, _ in self._requests if kind in _ASKED])

    def command(self) -> bytes:
        """The next one to send; empty if none."""
        return self._out.popleft() if self._out else b""

    def passed(self, now_ns: int) -> list[Notice]:
        """Ask what is open, for the first time or again; what is not answered is given up, but never the way back."""
        if not self._requests or (self._times and 0 <= now_ns - self._asked_ns < _AGAIN_NS):
            return []
        if self._times == _TIMES:
            return self._failed("does not answer")
        self._times += 1
        self._asked_ns = now_ns
        self._out.append(encode(*self._requests[0]))
        return []

    def answered(self, message: Message) -> list[Notice]:
        """A message that is no data."""
        if not self._requests:
            return []
        if message.kind == mtdata2.ERROR:
            return self._failed(f"answers error {message.data.hex()}")
        kind, _ = self._requests[0]
        if message.kind != kind + 1:
            return []
        match kind:
            case mtdata2.REQ_PRODUCT:
                self.model = _printable(message.data)
            case mtdata2.REQ_DEVICE:
                self.model = f"{self.model or 'Xsens'} {message.data[:8].hex().upper()}".strip()
            case mtdata2.REQ_FIRMWARE:
                self.firmware = ".".join(map(str, message.data[:3]))
            case mtdata2.SET_OUTPUT:
                self.sends_hz = _rate_in(message.data)
            case mtdata2.GOTO_MEASUREMENT:
                self.resumed = True
        self._requests.popleft()
        self._times = 0
        return []

    def measures(self) -> None:
        """It sent data: where it was given up, it is left at that."""
        if self._given_up:
            self._requests.clear()

    def _visit(self, asked: Iterable[int]) -> None:
        there = [(mtdata2.GOTO_CONFIG, b""), *((kind, b"") for kind in asked), *self._output()]
        self._requests = deque([*there, (mtdata2.GOTO_MEASUREMENT, b"")])
        self._times, self._given_up = 0, False

    def _failed(self, how: str) -> list[Notice]:
        kind, _ = self._requests[0]
        self._requests = deque([(mtdata2.GOTO_MEASUREMENT, b"")])
        self._times, self._given_up = 0, True
        what = "what it sends was not changed" if self._wanted_hz else "who it is was not learnt"
        return [Notice("settings", f"to request {kind:02X} it {how}: {what}")]

    def _output(self) -> list[tuple[int, bytes]]:
        """All that is of use, and nothing else."""
        if not self._wanted_hz:
            return []
        rate_hz = round(self._wanted_hz)
        wanted = {
            mtdata2.PACKET_COUNTER: _ALWAYS,
            mtdata2.SAMPLE_TIME: _ALWAYS,
            mtdata2.ACCELERATION: rate_hz,
            mtdata2.RATE_OF_TURN: rate_hz,
            mtdata2.TEMPERATURE: min(rate_hz, _WARMTH_HZ),
            mtdata2.STATUS: _ALWAYS,
        }
        data = b"".join(what.to_bytes(2, "big") + often.to_bytes(2, "big") for what, often in wanted.items())
        return [(mtdata2.SET_OUTPUT, data)]


def _rate_in(data: bytes) -> float:
    """The rate of turn's, in what the device says that it will send."""
    for at in range(0, len(data) - 3, 4):
        if int.from_bytes(data[at : at + 2], "big") & 0xFFF0 == mtdata2.RATE_OF_TURN:
            rate_hz = int.from_bytes(data[at + 2 : at + 4], "big")
            return float(rate_hz) if rate_hz != _ALWAYS else 0.0
    return 0.0


def _printable(data: bytes) -> str:
    return "".join(c for c in data[:32].decode("ascii", "ignore") if c.isprintable()).strip()
