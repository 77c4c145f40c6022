"""What devices that are taken over have sent since is corrected and published at once, by what was said of them last.

Whoever had them is gone, and a hundred sessions take longer to begin than a subscriber should wait. They follow, take all of it
in their turn, and only do not publish it again.
"""

from collections.abc import Callable, Sequence
from itertools import takewhile
from typing import NamedTuple

import numpy as np

from bridge.bus.contract import Bus, BusError, Message, Publisher
from bridge.wire import keys
from bridge.wire.messages import Checkpoint, DeviceInfo
from bridge.wire.refusal import Tally
from estimator.course import PLAIN_S
from estimator.remembered import correction
from estimator.restore import changed
from estimator.service.device import CACHES, Device
from estimator.service.published import Encoder
from estimator.service.ready import MOST, Applied, Ready
from estimator.service.replicas import Replicas
from estimator.service.senders import Sender, Senders
from estimator.service.together import Round, Span
from estimator.session_knobs import SessionKnobs

#: of a device that could not be corrected before its session is there
FAILED = "devices not corrected at once"
#: devices that are looked at together: those of them need not wait until all have been
AT_ONCE = 6
#: what came last, ns of the bridge's clock, is published first, of all devices: whoever is gone has most likely done the rest
RECENT_NS = 150_000_000
#: unless there is so much of it that who had them hung: then nothing of it is done, and subscribers do not wait that long
HUNG_NS = 1_000_000_000


class Taken(NamedTuple):
    """A device that is ours from now on, since an epoch, and what of it came and is not known to be done, in its order."""

    device: str
    epoch: int
    messages: list[Message]


class _From(NamedTuple):
    """What a device comes under, and its place among the senders."""

    key: str
    place: int


class _Said(NamedTuple):
    publisher: Publisher
    boot: int
    #: the number of the first sample that was published, and the one that follows the last, which was taken at last_s
    begin: int
    end: int
    last_s: float


class _Run(NamedTuple):
    """Messages of a round, from the first up to before the last, of one device that only goes on in them."""

    device: str
    boot: int
    first: int
    last: int


class Interim:
    """Of devices whose sessions are to be made; knobs: how each is treated, info: what a bridge says of a device it has.

    What fails is counted in `counts`, and costs one device its turn here.
    """

    def __init__(
        self,
        bus: Bus,
        ward: str,
        replicas: Replicas,
        knobs: Callable[[str], SessionKnobs],
        now_ns: Callable[[], int],
        counts: Tally,
        info: Callable[[str, str], DeviceInfo | None],
    ) -> None:
        self._bus, self._ward, self._replicas, self._knobs = bus, ward, replicas, knobs
        self._now_ns, self._counts, self._info = now_ns, counts, info
        self._said = dict[str, _Said]()
        self._senders, self._free, self._from = Senders(MOST), list(range(MOST)), dict[str, _From]()
        #: by their keys those that still only go on from what was published
        self._going = dict[str, str]()
        self.ready = Ready(replicas, self._declare, self._applied)
        #: what came before that, and is not published yet
        self._older = list[tuple[Round, list[_Run]]]()

    def _declare(self, device: str) -> Publisher:
        return self._bus.publisher(keys.build(self._ward, "corrected", device=device), cache=CACHES["corrected"])

    def say(self, taken: Sequence[Taken]) -> None:
        """Publish what came of them last, of each up to the first message that is out of the ordinary."""
        said = [self._say_recent(taken[at : at + AT_ONCE]) for at in range(0, len(taken), AT_ONCE)]
        self._older += [(whole, older) for whole, older in said if older]

    @property
    def behind(self) -> bool:
        """Whether there is more to be published of what came of them."""
        return bool(self._older)

    def catch_up(self) -> None:
        """Publish what came of them before that: most of it for the second time, so others come first, but not for long.

        A subscriber waits for a tenth of a second for what is missing.
        """
        older, self._older = self._older, []
        for whole, runs in older:
            self._publish(whole, runs)

    def go_on(self, messages: Sequence[Message]) -> None:
        """Publish what comes of them until they have their sessions, of each as long as it only goes on."""
        by_key = dict[str, list[Message]]()
        for message in messages:
            if message.key in self._going:
                by_key.setdefault(message.key, []).append(message)
        if not by_key:
            return
        came = [(self._going[key], self._from[self._going[key]], these) for key, these in by_key.items()]
        whole, runs = self._round([(of, these) for _, of, these in came]), list[_Run]()
        begin = 0
        for name, of, these in came:
            said, end = self._said[name], begin + len(these)
            run = _run(whole, name, begin, end)
            goes_on = run is not None and _follows(whole, begin, said)
            if run is not None and goes_on:
                runs.append(run)
            if run is None or not goes_on or run.last < end:
                del self._going[of.key]
            begin = end
        self._publish(whole, runs)

    def _say_recent(self, taken: Sequence[Taken]) -> tuple[Round, list[_Run]]:
        """Publish what came last of some of them; what came before that, still to be published."""
        came = [(self._admit(one.device), one.messages) for one in taken]
        whole, runs, begin = self._round(came), list[_Run](), 0
        for one, (of, messages) in zip(taken, came, strict=True):
            end = begin + len(messages)
            try:
                run = None if of is None else _run(whole, one.device, begin, end)
                if run is not None and of is not None and self._corrects(one.epoch, of.place, whole, run):
                    runs.append(run)
                    if run.last == end:
                        self._going[of.key] = one.device
            except Exception:  # noqa: BLE001 - whatever it is, its session will meet it, too
                self._counts.add(FAILED)
            begin = end
        recent = [run._replace(first=_recent(whole, run)) for run in runs]
        try:
            self._publish(whole, recent)
        finally:
            for one, (of, _) in zip(taken, came, strict=True):
                if of is not None and one.device not in self._said:
                    self._leave(one.device)
        older = [run._replace(last=late.first) for run, late in zip(runs, recent, strict=True)]
        return whole, [run for run in older if run.first < run.last and run.device in self._said]

    def _round(self, came: Sequence[tuple[_From | None, Sequence[Message]]]) -> Round:
        """What came of some devices; of one that has no place, or under another key, is nobody's."""
        places = [of.place if of is not None and m.key == of.key else -1 for of, messages in came for m in messages]
        return Round([m.payload for _, messages in came for m in messages], places, self._senders, goes_on=False)

    def _admit(self, device: str) -> _From | None:
        """Where it is from now on; None where that is not known, or something was published of it before."""
        bridge = self._replicas.bridge(device)
        if not bridge or device in self._from or not self._free:
            return None
        self.ready.wanted.discard(device)  # it may be among what is still to be made ready
        of = self._from[device] = _From(keys.build(self._ward, "raw", bridge=bridge, device=device), self._free.pop())
        self._senders.admit(of.place, Sender.of(device, bridge))
        return of

    def _leave(self, device: str) -> None:
        if (of := self._from.pop(device, None)) is not None:
            self._free.append(of.place)
            self._going.pop(of.key, None)
            for _, runs in self._older:  # its place is another's from now on
                runs[:] = [run for run in runs if run.device != device]
            self._older = [(whole, runs) for whole, runs in self._older if runs]

    def _corrects(self, epoch: int, place: int, whole: Round, run: _Run) -> bool:
        """Have what was said of a device last correct what comes of its place; whether it can."""
        name, known = run.device, self._replicas.of(run.device)
        if known is None or known.boot != run.boot:
            return False
        remembered = self._replicas.recall(name, run.boot, self._now_ns())
        if known.calibration is not None and (remembered is None or remembered.calibration is None):
            return False  # of an earlier boot: whether it still holds is for its session to say
        info = self._info(known.bridge, name)
        used = None if remembered is None else remembered.calibration
        if used is not None and info is not None and info.boot == run.boot and changed(used, info, within_boot=True):
            return False
        last_s = whole.span(run.last - 1).last_s
        time_known = remembered is None or not remembered.lost_count(last_s)
        applied = self.ready.applied(known, last_s) if time_known else self._applied(known, last_s)
        return applied is not None and self._senders.corrects(place, applied.correction, applied.stencil.under(epoch))

    def _applied(self, known: Checkpoint, time: float) -> Applied | None:
        """What corrects a device at a device time by what was said of it last; None where that is not enough."""
        remembered = self._replicas.recall(known.device, known.boot, self._now_ns())
        best = correction(remembered, time, self._knobs(known.device))
        return None if best is None else Applied(best, Encoder().stencil(known.device, known.boot, best))

    def _publish(self, whole: Round, runs: Sequence[_Run]) -> None:
        """Of each run up to what the wire does not take."""
        numbers = [n for run in runs for n in range(run.first, run.last)]
        said = dict(zip(numbers, whole.corrected_ahead(np.array(numbers, np.int64)), strict=True))
        for run in runs:
            fit = list(takewhile(len, (said[n] for n in range(run.first, run.last))))
            try:
                self._put(whole, run, fit)
            except BusError:
                raise
            except Exception:  # noqa: BLE001 - as above
                self._counts.add(FAILED)

    def _put(self, whole: Round, run: _Run, said: Sequence[bytes]) -> None:
        if not said:
            return
        name, before = run.device, self._said.get(run.device)
        publisher = self.ready.publisher(name) if before is None else before.publisher
        begin = whole.span(run.first).sequence
        for at, payload in enumerate(said, run.first):
            publisher.put(payload)
            if before is None or begin == before.end:
                first = begin if before is None else before.begin
                self._said[name] = _Said(publisher, run.boot, first, whole.following(at), whole.span(at).last_s)
        if before is not None and whole.following(run.first + len(said) - 1) == before.begin:
            self._said[name] = before._replace(begin=begin)

    def hand_over(self, device: Device) -> None:
        """Its session is there."""
        if (said := self._said.pop(device.name, None)) is not None:
            device.foretold(said.publisher, said.boot, said.begin, said.end)
        self._leave(device.name)

    def drop(self, device: str) -> list[Publisher]:
        """It is another's before it had a session: what was said of it may still be asked for."""
        said = self._said.pop(device, None)
        self._leave(device)
        return [] if said is None else [said.publisher]

    def close(self) -> None:
        """Take back the publishers that nobody took over."""
        for device in list(self._said):
            for publisher in self.drop(device):
                publisher.close()
        self.ready.close()


def _run(whole: Round, device: str, begin: int, end: int) -> _Run | None:
    """The messages of a device that begin there, up to the first that is unfit or does not go on from the one before."""
    if begin == end or not whole.fit(begin):
        return None
    before, at = whole.span(begin), begin + 1
    if before.last_s - before.first_s >= PLAIN_S:
        return None
    while at < end and whole.fit(at):
        here = whole.span(at)
        if here.sequence != whole.following(at - 1) or not _goes_on(here, before.boot, before.last_s):
            break
        before, at = here, at + 1
    return _Run(device, before.boot, begin, at)


def _follows(whole: Round, number: int, said: _Said) -> bool:
    here = whole.span(number)
    return here.sequence == said.end and _goes_on(here, said.boot, said.last_s)


def _goes_on(here: Span, boot: int, last_s: float) -> bool:
    """As Course.goes_on."""
    return here.boot == boot and here.first_s > last_s and here.last_s < last_s + PLAIN_S


def _recent(whole: Round, run: _Run) -> int:
    """The first of its messages that are to be published before those of other devices."""
    last_ns, first = whole.span(run.last - 1).received_ns, run.last
    if last_ns - whole.span(run.first).received_ns > HUNG_NS:
        return run.first
    while first > run.first and whole.span(first - 1).received_ns >= last_ns - RECENT_NS:
        first -= 1
    return first
