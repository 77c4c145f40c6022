"""Queries and settings of an Xsens motion tracker. No I/O; time is an argument.

Queries need the device's config state, which is entered first and left afterwards. The device stores its settings
permanently.
"""

from bridge.drivers.driver import Notice
from bridge.drivers.request_queue import RequestQueue
from bridge.framing import mtdata2
from bridge.framing.mtdata2 import Message, encode
from bridge.reasons.codes import Code

_ASKED = (mtdata2.REQ_PRODUCT, mtdata2.REQ_DEVICE, mtdata2.REQ_FIRMWARE)
_AGAIN_S, _TIMES = 0.5, 5
_ALWAYS = 0xFFFF  # output frequency that means: in every message
_WARMTH_HZ = 10


class Settings(RequestQueue):
    """Queries and settings of one Xsens motion tracker, and their progress.

    rate_hz: output data rate to set, Hz; 0 leaves it. model, firmware: "" until the device answers.
    sends_hz: output data rate that the device reports, Hz; 0 until it answers.
    """

    def __init__(self, rate_hz: float) -> None:
        self.model, self.firmware, self.sends_hz = "", "", 0.0
        self._wanted_hz = rate_hz
        super().__init__(_AGAIN_S, _TIMES, self._unanswered)
        self._given_up = False

    @property
    def settled(self) -> bool:
        """True if all queries and settings are answered, or were given up."""
        return self._given_up or self.key is None

    def begin(self, *, woken: bool = False) -> None:
        """Restart all queries and settings, because the device was opened or (woken=True) reported a boot."""
        self._given_up = False
        self.clear()
        if woken:
            self.tell(encode(mtdata2.WAKE_UP_ACK))  # otherwise the device would start to measure
        for kind in (mtdata2.GOTO_CONFIG, *_ASKED):
            self.add(kind, encode(kind))
        if self._wanted_hz:
            self.add(mtdata2.SET_OUTPUT, encode(mtdata2.SET_OUTPUT, self._output()))
        self._back()

    def took(self, message: Message) -> list[Notice]:
        """Process a message without samples, such as the answer to a query.

        Returns one notice if the device refused the query, else [].
        """
        kind = self.key
        if kind is not None and message.kind == mtdata2.ERROR:
            return self._failed(Code.REQUEST_REFUSED, error=message.data.hex())
        if not isinstance(kind, int) or message.kind != kind + 1:
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
        self.answered()
        return []

    def measures(self) -> None:
        """Report that the device sent samples. If a query was given up, the commands still waiting are discarded."""
        if self._given_up:
            self.clear()

    def _back(self) -> None:
        self.add(mtdata2.GOTO_MEASUREMENT, encode(mtdata2.GOTO_MEASUREMENT))

    def _unanswered(self) -> list[Notice]:
        return self._failed(Code.REQUEST_UNANSWERED)

    def _failed(self, code: Code, **params: str) -> list[Notice]:
        """Give up all queries after one that failed, but never the return to measurement."""
        kind = self.key
        self.clear()
        self._back()
        self._given_up = True
        return [Notice("settings", code(request=f"{kind:02X}", **params))]

    def _output(self) -> bytes:
        """Output configuration with the useful data only."""
        rate_hz = round(self._wanted_hz)
        wanted = {
            mtdata2.PACKET_COUNTER: _ALWAYS,
            mtdata2.SAMPLE_TIME: _ALWAYS,
            mtdata2.ACCELERATION: rate_hz,
            mtdata2.RATE_OF_TURN: rate_hz,
            mtdata2.TEMPERATURE: min(rate_hz, _WARMTH_HZ),
            mtdata2.STATUS: _ALWAYS,
        }
        return b"".join(what.to_bytes(2, "big") + often.to_bytes(2, "big") for what, often in wanted.items())


def _rate_in(data: bytes) -> float:
    """Output data rate of the rate of turn, from an output configuration, in Hz; 0 if not given."""
    for at in range(0, len(data) - 3, 4):
        if int.from_bytes(data[at : at + 2], "big") & 0xFFF0 == mtdata2.RATE_OF_TURN:
            rate_hz = int.from_bytes(data[at + 2 : at + 4], "big")
            return float(rate_hz) if rate_hz != _ALWAYS else 0.0
    return 0.0


def _printable(data: bytes) -> str:
    return "".join(c for c in data[:32].decode("ascii", "ignore") if c.isprintable()).strip()
