"""What can be done to a ward: each fault begins, lasts, and is undone. A seed decides which, when and for how long."""

import random
import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

import numpy as np

from tests.nemesis.field import BRIDGE, ESTIMATOR, ROUTER, TRUNK, Field, numbered

_Fault = Callable[[Field, str], AbstractContextManager[None]]


@dataclass(frozen=True, slots=True)
class Kind:
    """A fault: what of the ward it may be done to, and for how long at least and at most, s."""

    name: str
    to: tuple[str, ...]
    least_s: float
    most_s: float
    do: _Fault
    #: done to which of these it may cost samples: a device its own, else all
    costs: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Planned:
    """One that is to be done at a time since the beginning, s."""

    at_s: float
    lasts_s: float
    kind: Kind
    to: str

    @property
    def costs(self) -> str | None:
        """Whose samples it may cost: of a device, "" of all, or None."""
        if self.kind.costs == DEVICES:
            return self.to
        return "" if self.to in self.kind.costs else None

    @property
    def sort(self) -> str:
        """What it is, whichever of several it is done to."""
        return f"{self.kind.name} {'a device' if self.kind.to == DEVICES else self.to.partition('-')[0]}"

    def __str__(self) -> str:
        return f"{self.kind.name} {self.to} for {self.lasts_s:.1f} s"


DEVICES = ("device",)  # stands for any of them, as each of the others for all of its kind
PARTS = (BRIDGE, ESTIMATOR)
_ALL = (ROUTER, *PARTS)


@contextmanager
def _killed(field: Field, part: str) -> Iterator[None]:
    field.kill(part)
    yield
    field.ward.start(part)


@contextmanager
def _stopped(field: Field, part: str) -> Iterator[None]:
    field.send(part, signal.SIGSTOP)
    yield
    field.send(part, signal.SIGCONT)


@contextmanager
def _restarted(field: Field, part: str) -> Iterator[None]:
    field.ward.stop(part)
    yield
    field.ward.start(part)


@contextmanager
def _held(field: Field, part: str) -> Iterator[None]:
    field.lines[part].hold()
    yield
    field.lines[part].mend()


@contextmanager
def _cut(field: Field, part: str) -> Iterator[None]:
    field.lines[part].cut()
    yield
    field.lines[part].mend()


@contextmanager
def _rebooted(field: Field, device: str) -> Iterator[None]:
    field.devices[device].power_off()
    yield
    field.devices[device].power_on()


@contextmanager
def _unplugged(field: Field, device: str) -> Iterator[None]:
    field.ward.ports[device].unplug()
    yield
    field.ward.ports[device].plug()


def _bit_errors(data: bytes, probability: float) -> bytes:
    """The same bytes, each bit flipped with that probability."""
    flips = np.random.default_rng().random((len(data), 8)) < probability
    return bytes(np.frombuffer(data, np.uint8) ^ np.packbits(flips, axis=1)[:, 0])


@contextmanager
def _garbled(field: Field, device: str) -> Iterator[None]:
    field.ward.ports[device].byte_fault = lambda data: _bit_errors(data, 1e-4)
    yield
    field.ward.ports[device].byte_fault = None


@contextmanager
def _full(field: Field, part: str) -> Iterator[None]:
    field.fill_disk(part, full=True)
    yield
    field.fill_disk(part, full=False)


def _clock(ahead_s: float) -> _Fault:
    @contextmanager
    def jumped(field: Field, part: str) -> Iterator[None]:
        assert field.clock is not None
        field.clock.set(part, ahead_s)
        yield
        field.clock.set(part, 0.0)

    return jumped


KINDS = (
    Kind("kill", _ALL, 0.0, 1.5, _killed, (BRIDGE,)),
    Kind("stop (SIGSTOP)", _ALL, 0.2, 4.0, _stopped),
    Kind("restart", PARTS, 0.0, 0.5, _restarted, (BRIDGE,)),
    Kind("hold the line of", PARTS, 0.3, 4.0, _held),
    Kind("cut the line of", PARTS, 0.3, 3.0, _cut),
    Kind("reboot", DEVICES, 0.0, 1.0, _rebooted),
    Kind("unplug", DEVICES, 0.1, 2.0, _unplugged, DEVICES),
    Kind("garble the line of", DEVICES, 0.5, 2.0, _garbled, DEVICES),
    Kind("fill the disk of", (ESTIMATOR,), 0.5, 5.0, _full),
)
#: where there are several routers
PARTED = (Kind("hold", (TRUNK,), 1.0, 10.0, _held), Kind("cut", (TRUNK,), 1.0, 10.0, _cut))
CLOCKS = (
    Kind("set forward an hour the clock of", PARTS, 1.5, 4.0, _clock(3600.0)),
    Kind("set back an hour the clock of", PARTS, 1.5, 4.0, _clock(-3600.0)),
)


def plan(
    seed: int, names: tuple[str, ...], lasts_s: float, *, clocks: bool, estimators: int = 1, routers: int = 1
) -> list[Planned]:
    """Faults one after the other, up to two at a time and never two on the same thing; the last is over by lasts_s."""
    chance = random.Random(seed)
    kinds = KINDS + (CLOCKS if clocks else ()) + (PARTED if routers > 1 else ())
    every = {"device": names, ESTIMATOR: numbered(ESTIMATOR, estimators), ROUTER: numbered(ROUTER, routers)}
    planned: list[Planned] = []
    free: dict[str, float] = {}
    at_s = chance.uniform(0.5, 3.0)
    while at_s < lasts_s:
        kind = chance.choice(kinds)
        to = chance.choice([one for what in kind.to for one in every.get(what, (what,))])
        one = Planned(at_s, min(chance.uniform(kind.least_s, kind.most_s), max(0.0, lasts_s - at_s)), kind, to)
        under_way = sum(other.at_s + other.lasts_s > at_s for other in planned)
        if free.get(to, 0.0) <= at_s and under_way < 2:
            planned.append(one)
            free[to] = at_s + one.lasts_s + 0.5
        at_s += chance.uniform(0.3, 4.0)
    return planned
