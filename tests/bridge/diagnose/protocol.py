"""A second protocol, for tests: lines `$,µs,x,y,z` of milli-rad/s, with a speed of its own; and ports that speak it."""

import os
import termios
from collections.abc import Callable

from bridge.drivers.byte_stream import Decoder, StreamOptions, stream_kind
from bridge.drivers.driver import Event
from bridge.drivers.native import KIND as NATIVE
from bridge.drivers.sample_assembly import DeviceDescription, SampleAssembler
from bridge.sim.pty_port import PtyPort
from bridge.wire.refusal import Tally


class LineOptions(StreamOptions, frozen=True, forbid_unknown_fields=True, kw_only=True):
    baud: int = 57_600
    sign: str = "$"


class LineDecoder(Decoder):
    def __init__(self, options: LineOptions | None) -> None:
        self.faults = Tally()
        self._sign = options.sign if options else "$"
        self._assembly = SampleAssembler(self.faults, DeviceDescription("line", "3", rate_hz=100.0), 1e-6)
        self._rest = b""

    def opened(self) -> None:
        self._rest = b""
        self._assembly.opened()

    def feed(self, data: bytes, receive_time_ns: int) -> list[Event]:
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            try:
                sign, tick, *xyz = line.decode("ascii").split(",")
                x, y, z = (float(value) * 1e-3 for value in xyz)
                if sign != self._sign:
                    raise ValueError(sign)
                self._assembly.add(int(tick), (x, y, z), receive_time_ns=receive_time_ns)
            except ValueError:
                self.faults.add("line")
        return self._assembly.events()


LINE = stream_kind("line", "lines for tests", LineOptions, LineDecoder)
SIGNED = stream_kind(
    "signed", "lines of another sign", LineOptions, LineDecoder, variants=lambda: ({"sign": "#"}, {"sign": "%"})
)
KINDS = (NATIVE, LINE, SIGNED)


def lines(sign: str = "$", first: int = 5_000_000, n: int = 100) -> bytes:
    return b"".join(f"{sign},{first + 10_000 * i},1,2,{i % 7}\n".encode() for i in range(n))


class Talker:
    """Something on a terminal that repeats itself, as a virtual device would."""

    name, boot = "talker", None

    def __init__(self, said: bytes, bytes_per_s: float = 3000.0) -> None:
        self._said, self._pace, self._sent = said, bytes_per_s, 0

    def receive(self, data: bytes) -> None:
        pass

    def advance(self, time_s: float) -> bytes:
        n, start = int(time_s * self._pace) - self._sent, self._sent
        self._sent += n
        whole = self._said * (2 + n // max(1, len(self._said))) if self._said else b""
        return whole[start % max(1, len(self._said)) :][:n]


def only_at(port: Callable[[], PtyPort], baud: int) -> Callable[[bytes], bytes]:
    """A line that is right at one speed and noise at any other, as a real one is."""

    def hear(data: bytes) -> bytes:
        speed = getattr(termios, f"B{baud}")
        terminal = os.dup(port()._slave)
        try:
            right = termios.tcgetattr(terminal)[5] == speed
        finally:
            os.close(terminal)
        return data if right else bytes(((byte * 181) & 0xFF ^ 0xA5) | 0x80 for byte in data)

    return hear
