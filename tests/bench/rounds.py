"""What a message costs the estimator, by parts, without a network: rounds of a service in one process, on the bench's clock.

`python -m tests.bench.rounds [--devices 200] [--seconds 15] [--round 100]`.
A second of the ward's life has a second's share of
what is done once a second, however long it takes. The bus is not in it. All together is CPU time; what a part has of it is looked
at in a second run.
"""

import argparse
import pkgutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from time import perf_counter_ns, process_time
from types import GeneratorType
from typing import Any

import pytest
from rich.console import Console
from rich.table import Table

from bridge.bus.contract import Message
from bridge.bus.memory_bus import MemoryBroker, MemoryBus
from bridge.enrolled import Enrolment
from estimator.config import Estimator
from estimator.service.shell import Service
from estimator.service.store import Store
from tests.bench.load.stream import WARD, Fleet, name

_NOW_NS = 1_700_000_000_000_000_000
#: a ward that has just begun is not what is measured
_WARM_S = 15.0
_ROUNDS = "the rest of a round"
_PARTS = {
    "estimator.service.intake:Intake.take": "admitted",
    "estimator.service.intake:decode": "decoded",
    "estimator.session:DeviceSession._put": "put in its buffer",
    "estimator.session:DeviceSession._end_block": "a block's end",
    "estimator.service.intake:Intake._publish": "published",
    "estimator.service.intake:correct": "corrected",
    "estimator.service.published:Encoder.encode": "encoded",
    "estimator.service.shell:Service._learn": "learnt: around it",
    "estimator.learnt:Learnt.learn": "learnt: of each window",
    "estimator.stillness:Stillness.take": "learnt: stillness",
    "estimator.track.seconds:Seconds.take": "learnt: tracker",
    "estimator.track.tracker:Tracker.learn": "learnt: tracker",
    "estimator.under_way:UnderWay.add": "learnt: calibration",
    "estimator.under_way:UnderWay.judge": "learnt: calibration",
    "estimator.learnt:Learnt.correction": "learnt: what is applied",
    "estimator.service.shell:Service._every_second": "once a second: of all",
    "estimator.service.shell:Service._look_after": "once a second: of each",
    "estimator.service.device:Device.say_status": "once a second: status",
    "estimator.service.record:Record.checkpoint": "once a second: kept",
}

#: takes key and payload
Said = Callable[[str, bytes], None]


class Mute(MemoryBus):
    """A bus on which nothing that is said is heard; `said` takes it."""

    def __init__(self, said: Said) -> None:
        super().__init__(MemoryBroker())
        self._said = said

    def publisher(self, key: str, *, cache: int = 0) -> "_Pen":  # type: ignore[override]
        return _Pen(key, self._said)


class _Pen:
    wanted = False

    def __init__(self, key: str, said: Said) -> None:
        self._key, self._said = key, said

    def put(self, payload: bytes) -> None:
        self._said(self._key, payload)

    def close(self) -> None:
        pass


class _Laid:
    """A subscription to rounds that are laid before it; a clock goes on by round_s while the next one is waited for."""

    missed, closed, caught_up = 0, False, True

    def __init__(self, rounds: Sequence[list[Message]], round_s: float) -> None:
        self._rounds, self._round_s = iter(rounds), round_s
        self.now = 1000.0

    def drain(self, limit: int, timeout_s: float) -> list[Message]:
        self.now += self._round_s
        return next(self._rounds)

    def close(self) -> None:
        pass


class Meter:
    """Time by parts: what is spent in a part within a part is the inner one's."""

    def __init__(self) -> None:
        self.spent_ns = Counter[str]()
        self._inside, self._since = [_ROUNDS], 0

    def anew(self) -> None:
        """From here on."""
        self.spent_ns.clear()
        self._since = perf_counter_ns()

    def share(self, part: str) -> float:
        """Of all that was measured."""
        return self.spent_ns[part] / self.spent_ns.total()

    def metered(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, or the iterator it gives, as a part."""

        def called(*args: Any, **kwargs: Any) -> Any:
            self._now_in(part)
            try:
                found = function(*args, **kwargs)
            finally:
                self._out()
            return iterated(found) if isinstance(found, GeneratorType) else found

        def iterated(iterator: Iterator[Any]) -> Iterator[Any]:
            while True:
                self._now_in(part)
                one = next(iterator, self)
                self._out()
                if one is self:
                    return
                yield one

        return called

    def _now_in(self, part: str) -> None:
        self._spent()
        self._inside.append(part)

    def _out(self) -> None:
        self._spent()
        self._inside.pop()

    def _spent(self) -> None:
        now = perf_counter_ns()
        self.spent_ns[self._inside[-1]] += now - self._since
        self._since = now


class Ward:
    """Messages of a ward's devices, made beforehand; a service has `most` of them laid before it in each round."""

    def __init__(self, devices: int, seconds: float, most: int) -> None:
        fleet = Fleet(devices, rate_hz=104.0, batch=10, seed=1)
        self._names = tuple(map(name, range(devices)))
        periods = round((_WARM_S + seconds) / fleet.period_s)
        messages = [
            Message(fleet.keys[i], payload)
            for n in range(periods)
            for i, payload in fleet.round(n, _NOW_NS + round(n * fleet.period_s * 1e9))
        ]
        self._rounds = [messages[at : at + most] for at in range(0, len(messages), most)]
        self._round_s = fleet.period_s * most / devices
        self._warm = round(_WARM_S / self._round_s)
        #: messages that come when it is warm
        self.measured = sum(map(len, self._rounds[self._warm :]))

    def run(self, meter: Meter | None = None, said: Said = lambda *_: None) -> float:
        """CPU s, once the ward is warm; said is told all that is published."""
        raw = _Laid(self._rounds, self._round_s)
        with pytest.MonkeyPatch.context() as patch, Mute(said) as bus, MemoryBus(MemoryBroker()) as control:
            if meter is not None:
                for where, part in _PARTS.items():
                    owner, _, name = where.replace(":", ".").rpartition(".")
                    patch.setattr(pkgutil.resolve_name(owner), name, meter.metered(part, pkgutil.resolve_name(where)))
            patch.setattr("time.monotonic", lambda: raw.now)
            store = Store(":memory:")
            service = Service(
                WARD,
                Estimator(id="e"),
                bus,
                control,
                store,
                lambda: _NOW_NS + round(raw.now * 1e9),
                enrolment=Enrolment(enrolled=self._names),
            )
            service._raw = raw  # type: ignore[assignment]
            begun = 0.0
            for number in range(len(self._rounds)):
                if number == self._warm:
                    begun = process_time()
                    if meter is not None:
                        meter.anew()
                service.step(0.0)
            spent = process_time() - begun
            store.close()
        return spent


def main() -> int:
    """Print a table; no verdict."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=15.0, help="of the ward's life")
    parser.add_argument("--round", type=int, default=100, help="messages in each")
    args = parser.parse_args()
    ward, meter = Ward(args.devices, args.seconds, args.round), Meter()
    whole_us = 1e6 * ward.run() / ward.measured
    ward.run(meter)
    table = Table(title=f"{args.devices} devices, 10 samples a message")
    table.add_column("")
    table.add_column("µs a message", justify="right")
    for part in (_ROUNDS, *dict.fromkeys(_PARTS.values())):
        table.add_row(part, f"{whole_us * meter.share(part):.2f}")
    table.add_row("all together", f"{whole_us:.2f}", style="bold")
    Console().print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
