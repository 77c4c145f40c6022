"""Each sample once and in order, by device, boot and sequence number, however often and in whatever order it comes.

What comes before its turn is held until the hole before it is filled, has been waited for, or too much is held. What an
estimator says of a device that is another's since is set aside, and given only where that one does not say it: where it was ended
within a cut, nobody knows any more that the device was its. Known of a boot are the number it has come to, what is held or set
aside, and its last few holes: never a set of samples.
"""

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, field, replace
from math import ceil
from typing import Self

from bridge.wire.messages import CorrectedBatch, SampleFlag
from bridge.wire.refusal import Tally
from estimator.fence import FORGET_S, Turns
from estimator.revision import SAME_TIME_NS

#: how long a hole is waited for: some batches, so that two publishers may overtake each other
WAIT_S = 0.1
#: and at least where another estimator goes on behind a hole that no device's or bridge's is: who had the device before may be
#: heard of late, as a line between routers is mended; publishers say their last number every two seconds
HANDED_OVER_S = 3.0
#: a bridge that stood still, or had just begun, may have taken samples for later than they were by as much as its caches reach
MISTAKEN_NS = 30_000_000_000
#: so many times what is held of a boot is set aside
_ASIDE = 2
#: samples of a boot that are held at least, and of the fastest device in a second
WINDOW, FASTEST_HZ = 4096, 1000.0


@dataclass(frozen=True, slots=True)
class OnceKnobs:
    """How long a hole is waited for, how many samples of a boot are held meanwhile, and how much is remembered."""

    wait_s: float = WAIT_S
    window: int = WINDOW  # samples
    devices: int = 4096  # of more, the one heard longest ago is forgotten
    boots: int = 64  # of each device
    holes: int = 64  # of each boot, and of each device for those who ask

    @property
    def forget_s(self) -> float:
        """How long only earlier turns may come before the latest is forgotten: it may be taken up again, and the patient wait."""
        return min(max(FORGET_S, self.wait_s), 2 * FORGET_S)

    @classmethod
    def patient(cls, wait_s: float) -> Self:
        """Who waits so long holds what comes meanwhile, of any device."""
        return cls(wait_s, max(WINDOW, ceil(wait_s * FASTEST_HZ)))


@dataclass(frozen=True, slots=True)
class Miss:
    """Samples `first` to `first + count - 1` did not come. `told`: the sample after them says itself that some were missing."""

    device: str
    boot: int
    first: int
    count: int
    told: bool


@dataclass(slots=True, eq=False)
class Missing:
    """What of a device did not come: how many samples in all, and the last few holes."""

    samples: int
    latest: deque[Miss]


Event = CorrectedBatch | Miss


@dataclass(slots=True, eq=False)
class _Boot:
    came_to: int | None  # all before it was given or given up; None while nothing was
    reached: int  # after the last of all that came
    latest: CorrectedBatch
    holes: deque[tuple[int, int]]
    turns: Turns
    held: list[tuple[CorrectedBatch, float]] = field(default_factory=list)  # by sequence, disjoint; and when each came
    samples: int = 0  # in them
    oldest: float = 0.0  # when the first of them came
    lowest: int = 0  # no epoch of them is below it
    epoch: int = 0  # of what was given last
    joined: int = 0  # nothing below was ever waited for
    aside: list[CorrectedBatch] = field(default_factory=list)  # of earlier turns than others say to have had it then
    lowest_aside: int = 0  # no number of them is below it
    samples_aside: int = 0
    aside_s: float = 0.0  # when the last of them came


class Once:
    """Batches in; batches and misses, in the order in which they are to be known, in `ready`.

    `left_out` counts samples that came and are not given: `repeated`, `late`, after the hole they belong to was given up, or
    `outdated`, from an estimator whose device it is no more.
    """

    def __init__(self, knobs: OnceKnobs | None = None) -> None:
        self.knobs = knobs or OnceKnobs()
        self.ready: deque[Event] = deque()
        self.left_out = Tally()
        self.missing: dict[str, Missing] = {}
        self._devices: dict[str, dict[int, _Boot]] = {}
        self._waiting: dict[tuple[str, int], _Boot] = {}
        self._aside: dict[tuple[str, int], _Boot] = {}

    def feed(self, batch: CorrectedBatch, now: float) -> None:
        """Take a batch that came at `now` seconds of a clock that does not go back."""
        boot = self._boot(batch)
        newest, end = boot.turns.newest, batch.sequence + len(batch)
        boot.reached = max(boot.reached, end)
        if batch.start_time_ns > boot.latest.start_time_ns and end > (boot.came_to or 0):
            boot.latest = batch
        owed = boot.turns.of(batch.epoch, batch.sequence, len(batch), now)
        if owed < len(batch):
            self._set_aside(boot, _cut(batch, owed, len(batch)), now)
        if owed:
            self._take(boot, _cut(batch, 0, owed), now)
        if boot.aside:
            self._look_aside(boot, now, forgotten=boot.turns.newest < newest)

    def _take(self, boot: _Boot, batch: CorrectedBatch, now: float) -> None:
        which = batch.device, batch.boot
        if batch.sequence == boot.came_to and not boot.held:
            boot.came_to, boot.epoch = batch.sequence + len(batch), batch.epoch
            self.ready.append(batch)
            return
        self._hold(boot, batch, now)
        self._in_turn(boot)
        while boot.samples > self.knobs.window:
            self._give_up_first(which, boot)
        self._settle(which, boot)

    def due(self) -> float | None:
        """When something held will have been waited for long enough; None when nothing is held."""
        held = [boot.oldest + self._wait_s(boot) for boot in self._waiting.values()]
        aside = [boot.aside_s + self.knobs.forget_s for boot in self._aside.values()]
        return min((*held, *aside), default=None)

    def overdue(self, now: float) -> None:
        """Give what has been held for wait_s, and give up the holes before it."""
        for which, boot in [one for one in self._aside.items() if one[1].aside_s + self.knobs.forget_s <= now]:
            self._fill(boot)
            self._in_turn(boot)
            self._settle(which, boot)
        waited = [(*one, self._wait_s(one[1])) for one in self._waiting.items()]
        for which, boot, wait_s in [one for one in waited if one[1].oldest + one[2] <= now]:
            last = max(batch.sequence for batch, came in boot.held if came + wait_s <= now)
            while boot.held and boot.held[0][0].sequence <= last:
                self._give_up_first(which, boot)
            self._settle(which, boot)

    def _wait_s(self, boot: _Boot) -> float:
        """How long what is held of a boot waits for what is missing before it."""
        first, came_to = boot.held[0][0], boot.came_to
        if came_to is None or first.sequence <= came_to or first.epoch <= boot.epoch:
            return self.knobs.wait_s
        told = first.flags[0] & SampleFlag.AFTER_GAP
        if told or any(start <= came_to < end for start, end in map(_span, boot.aside)):
            return self.knobs.wait_s
        return max(self.knobs.wait_s, HANDED_OVER_S)

    def rest(self) -> None:
        """Give all that is held or was set aside: nothing more is to come."""
        for device, boots in self._devices.items():
            for number, boot in boots.items():
                self._give_up((device, number), boot)

    def _boot(self, batch: CorrectedBatch) -> _Boot:
        """What is known of a batch's boot, from now on if nothing is."""
        which = batch.device, batch.boot
        boots = self._devices.pop(batch.device, None)
        boots = self._devices[batch.device] = {} if boots is None else boots  # heard last: at the end
        boot = boots.pop(batch.boot, None)
        end = batch.sequence + len(batch)
        if boot is not None and end <= boot.reached and _begins_anew(boot, batch):
            self._give_up(which, boot)
            boot = None
        if boot is not None:
            boots[batch.boot] = boot
            return boot
        begins, turns = 0 if batch.sequence == 0 else None, Turns(self.knobs.forget_s)
        boot = boots[batch.boot] = _Boot(begins, end, batch, deque(maxlen=self.knobs.holes), turns)
        self._forget(batch.device)
        return boot

    def _set_aside(self, boot: _Boot, piece: CorrectedBatch, now: float) -> None:
        boot.lowest_aside = min(boot.lowest_aside, piece.sequence) if boot.aside else piece.sequence
        boot.aside.append(piece)
        boot.samples_aside += len(piece)
        boot.aside_s = now
        self._aside[piece.device, piece.boot] = boot

    def _keep_aside(self, boot: _Boot, pieces: list[CorrectedBatch]) -> None:
        boot.aside, boot.samples_aside = pieces, sum(map(len, pieces))
        boot.lowest_aside = min((piece.sequence for piece in pieces), default=0)
        if not pieces:
            self._aside.pop((boot.latest.device, boot.latest.boot), None)

    def _look_aside(self, boot: _Boot, now: float, *, forgotten: bool) -> None:
        """Of what was set aside leave out what another has said, and what is too much; take it where that one is forgotten."""
        most, came_to = _ASIDE * self.knobs.window, boot.came_to or 0
        if forgotten:
            mine = sorted(boot.aside, key=lambda one: (-one.epoch, one.sequence))
            self._keep_aside(boot, [piece for piece in mine if piece.epoch < boot.turns.newest])
            for piece in mine:
                if piece.epoch >= boot.turns.newest:
                    boot.epoch = min(boot.epoch, piece.epoch)
                    self._take(boot, piece, now)
        elif came_to > boot.lowest_aside or boot.samples_aside > most:
            kept = list[CorrectedBatch]()
            for piece in boot.aside:
                start, end = _span(piece)
                self._leave_out("outdated", max(0, min(came_to, end) - start))
                if came_to < end:
                    kept.append(_cut(piece, max(0, came_to - start), len(piece)))
            while sum(map(len, kept)) > most:
                self._leave_out("outdated", len(kept.pop(0)))
            self._keep_aside(boot, kept)

    def _fill(self, boot: _Boot, end: int | None = None) -> None:
        """Put what was set aside where it is missing, up to a number: it is waited for no longer."""
        left, came_to = list[CorrectedBatch](), boot.came_to or 0
        for piece in sorted(boot.aside, key=lambda one: -one.epoch):
            first, last = _span(piece)
            begins, ends = min(max(first, came_to), last), last if end is None else max(first, min(last, end))
            self._leave_out("outdated", begins - first)
            if begins < ends:
                self._hold(boot, _cut(piece, begins - first, ends - first), boot.aside_s)
            if max(begins, ends) < last:
                left.append(_cut(piece, max(begins, ends) - first, len(piece)))
        self._keep_aside(boot, left)

    def _make_way(self, boot: _Boot, batch: CorrectedBatch) -> None:
        """Of what is held of earlier turns leave out what this batch says, too."""
        start, end = _span(batch)
        held, boot.held = boot.held, []
        for piece, came in held:
            first, last = _span(piece)
            if piece.epoch >= batch.epoch or last <= start or end <= first:
                boot.held.append((piece, came))
                continue
            kept = [(first, min(last, start)), (max(first, end), last)]
            boot.held += [(_cut(piece, a - first, b - first), came) for a, b in kept if a < b]
            self._leave_out("repeated", min(last, end) - max(first, start))
        boot.samples = sum(len(piece) for piece, _ in boot.held)
        boot.lowest = min((piece.epoch for piece, _ in boot.held), default=batch.epoch)
        boot.oldest = min((came for _, came in boot.held), default=boot.oldest)

    def _hold(self, boot: _Boot, batch: CorrectedBatch, now: float) -> None:
        """Put what is new of a batch among what is held."""
        start, end = batch.sequence, batch.sequence + len(batch)
        if boot.came_to is not None and start < boot.came_to:
            past = min(end, boot.came_to)
            late = sum(max(0, min(past, b) - max(start, a)) for a, b in boot.holes)
            self._leave_out("late", late)
            self._leave_out("repeated", past - start - late)
            start = past
        if boot.held and batch.epoch > boot.lowest:
            self._make_way(boot, batch)
        boot.oldest = boot.oldest if boot.held else now
        boot.lowest = min(boot.lowest, batch.epoch) if boot.held else batch.epoch
        at = max(0, bisect_right(boot.held, start, key=lambda one: one[0].sequence) - 1)
        while start < end:
            known, until = (end, end) if at == len(boot.held) else _span(boot.held[at][0])
            if start < min(known, end):
                piece = _cut(batch, start - batch.sequence, min(known, end) - batch.sequence)
                boot.held.insert(at, (piece, now))
                boot.samples += len(piece)
                start += len(piece)
            elif start < until:
                self._leave_out("repeated", min(until, end) - start)
                start = min(until, end)
            at += 1

    def _in_turn(self, boot: _Boot) -> None:
        """Give what there is no hole before; of an earlier turn than what was given last only if nobody else says it in time."""
        n = 0
        while n < len(boot.held) and boot.held[n][0].sequence == boot.came_to:
            batch = boot.held[n][0]
            if batch.epoch < boot.epoch:
                break
            boot.came_to += len(batch)
            boot.epoch = batch.epoch
            boot.samples -= len(batch)
            self.ready.append(batch)
            n += 1
        del boot.held[:n]
        if n and boot.held:
            boot.oldest = min(came for _, came in boot.held)

    def _give_up_first(self, which: tuple[str, int], boot: _Boot) -> None:
        """Wait no longer for what is missing before the first that is held."""
        first = boot.held[0][0]
        if boot.aside and boot.came_to is not None and boot.came_to < first.sequence:
            self._fill(boot, first.sequence)
            first = boot.held[0][0]
        boot.epoch = first.epoch
        if first.sequence != boot.came_to:
            boot.holes.append((boot.came_to or 0, first.sequence))
        if boot.came_to is None:
            boot.joined = first.sequence
        if boot.came_to is not None and first.sequence != boot.came_to:
            told = bool(first.flags[0] & SampleFlag.AFTER_GAP)
            miss = Miss(*which, boot.came_to, first.sequence - boot.came_to, told)
            missing = self.missing.setdefault(which[0], Missing(0, deque(maxlen=self.knobs.holes)))
            missing.samples += miss.count
            missing.latest.append(miss)
            self.ready.append(miss)
        boot.came_to = first.sequence
        self._in_turn(boot)

    def _give_up(self, which: tuple[str, int], boot: _Boot) -> None:
        if boot.aside:
            self._fill(boot)
        while boot.held:
            self._give_up_first(which, boot)
        self._settle(which, boot)

    def _settle(self, which: tuple[str, int], boot: _Boot) -> None:
        """Know whether a boot waits."""
        if boot.held:
            self._waiting[which] = boot
        else:
            self._waiting.pop(which, None)

    def _forget(self, device: str) -> None:
        """What was heard longest ago, by no clock that may be set back, of too many boots of a device, or devices."""
        boots = self._devices[device]
        if len(boots) > self.knobs.boots:
            number = next(iter(boots))
            self._give_up((device, number), boots.pop(number))
        if len(self._devices) > self.knobs.devices:
            device = next(iter(self._devices))
            for number, boot in self._devices.pop(device).items():
                self._give_up((device, number), boot)
            self.missing.pop(device, None)

    def _leave_out(self, why: str, samples: int) -> None:
        if samples:
            self.left_out.add(why, samples)


def _begins_anew(boot: _Boot, batch: CorrectedBatch) -> bool:
    """Whether low numbers are at a later time: no repeats, but of a device that was started anew under the same boot number.

    What is waited for may come late, at a time that the bridge mistook, and what was given up, of another estimator.
    """
    later_ns = batch.start_time_ns - _ends_ns(boot.latest)
    if not SAME_TIME_NS < later_ns <= MISTAKEN_NS:
        return later_ns > SAME_TIME_NS
    start, end = _span(batch)
    if boot.held and start >= (boot.came_to or 0):
        return False  # it is waited for
    given_up = any(boot.joined <= first < end and start < last for first, last in boot.holes)
    return not given_up or batch.epoch == boot.latest.epoch


def _span(batch: CorrectedBatch) -> tuple[int, int]:
    return batch.sequence, batch.sequence + len(batch)


def _ends_ns(batch: CorrectedBatch) -> int:
    lasts_s = (int(batch.ticks[-1]) - int(batch.ticks[0])) * batch.tick_period_s * batch.clock_rate
    return batch.start_time_ns + round(lasts_s * 1e9)


def _cut(batch: CorrectedBatch, start: int, end: int) -> CorrectedBatch:
    """Samples start to end of a batch."""
    rest = batch.after(start) if start else batch
    n = end - start
    return rest if n == len(rest) else replace(rest, ticks=rest.ticks[:n], rate=rest.rate[:n], flags=rest.flags[:n])
