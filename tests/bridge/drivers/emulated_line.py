"""A simulated device and a decoder on a wire, 20 ms of their time at a go."""

from typing import Generic, Protocol, Self, TypeVar

from bridge.drivers.byte_stream import Decoder
from bridge.drivers.driver import Event, Identity, Notice, Readings
from bridge.reasons.catalogue import english

TURN_NS = 20_000_000


class Device(Protocol):
    """What a simulated device does."""

    def receive(self, data: bytes) -> None: ...

    def advance(self, seconds: float) -> bytes: ...


D = TypeVar("D", bound=Device)


class Wire(Generic[D]):
    def __init__(self, device: D, decoder: Decoder) -> None:
        self.device, self.decoder = device, decoder
        self.decoder.opened()
        self.now_ns = 10**18
        self.events: list[Event] = []

    def run(self, seconds: float) -> Self:
        for _ in range(round(seconds * 1e9 / TURN_NS)):
            self.now_ns += TURN_NS
            self.device.receive(self.decoder.to_send())
            self.events += self.decoder.feed(self.device.advance(TURN_NS * 1e-9), self.now_ns)
        return self

    @property
    def identities(self) -> list[Identity]:
        return [event for event in self.events if isinstance(event, Identity)]

    @property
    def readings(self) -> list[Readings]:
        return [event for event in self.events if isinstance(event, Readings)]

    @property
    def notices(self) -> list[str]:
        return [english(event.said) for event in self.events if isinstance(event, Notice) and event.said]
