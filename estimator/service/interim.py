"""What devices that are taken over have sent since is corrected and published at once, by what was said of them last.

Whoever had them is gone, and a hundred sessions take longer to begin than a subscriber should wait. They follow, take all of it
in their turn, and only do not publish it again.
"""

from collections.abc import Callable, Sequence
from itertools import takewhile
from typing import NamedTuple

from bridge.bus.contract import Bus, BusError, Message, Publisher
from bridge.wire import keys
from bridge.wire.messages import Checkpoint, DeviceInfo
from bridge.wire.refusal import Refusal, Tally
from estimator.correction import Correction
from estimator.device.admission import PLAIN_S
from estimator.device.correct import Cut, correct
from estimator.device.samples import Samples
from estimator.remembered import correction
from estimator.restore import changed
from estimator.service.decode import decode
from estimator.service.device import CACHES, Device
from estimator.service.published import Encoder
from estimator.service.ready import Ready
from estimator.service.replicas import Replicas
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


class _Said(NamedTuple):
    publisher: Publisher
    encoder: Encoder
    applied: Correction
    boot: int
    #: the number of the first sample that was published, and the one that follows the last, which was taken at last_s
    begin: int
    end: int
    last_s: float


class _Run(NamedTuple):
    """Messages of a device that follow each other, decoded."""

    device: str
    samples: list[Samples]


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
        #: by their keys those that still only go on from what was published
        self._going = dict[str, str]()
        self.ready = Ready(replicas, self._declare, self._applied)
        #: what came before that, and is not published yet
        self._older = list[_Run]()

    def _declare(self, device: str) -> Publisher:
        return self._bus.publisher(keys.build(self._ward, "corrected", device=device), cache=CACHES["corrected"])

    def say(self, taken: Sequence[Taken]) -> None:
        """Publish what came of them last, of each up to the first message that is out of the ordinary."""
        for at in range(0, len(taken), AT_ONCE):
            self._say_recent(taken[at : at + AT_ONCE])

    @property
    def behind(self) -> bool:
        """Whether there is more to be published of what came of them."""
        return bool(self._older)

    def catch_up(self) -> None:
        """Publish what came of them before that: most of it for the second time, so others come first, but not for long.

        A subscriber waits for a tenth of a second for what is missing.
        """
        older, self._older = self._older, []
        self._publish(older)

    def go_on(self, messages: Sequence[Message]) -> None:
        """Publish what comes of them until they have their sessions, of each as long as it only goes on."""
        if not self._going:
            return
        by_key = dict[str, list[Message]]()
        for message in messages:
            if message.key in self._going:
                by_key.setdefault(message.key, []).append(message)
        runs = list[_Run]()
        for key, these in by_key.items():
            said = self._said[self._going[key]]
            samples = _run(decode(these), said)
            if samples:
                runs.append(_Run(self._going[key], samples))
            if len(samples) < len(these):
                del self._going[key]
        self._publish(runs)

    def _say_recent(self, taken: Sequence[Taken]) -> None:
        """Publish what came last of some of them; what came before that is still to be published."""
        recent = list[_Run]()
        for one in taken:
            try:
                if (found := self._begun(one)) is None:
                    continue
            except Exception:  # noqa: BLE001 - whatever it is, its session will meet it, too
                self._counts.add(FAILED)
                continue
            at = _recent(found)
            recent.append(_Run(one.device, found[at:]))
            if at:
                self._older.append(_Run(one.device, found[:at]))
        self._publish(recent)

    def _begun(self, taken: Taken) -> list[Samples] | None:
        """What of a device is to be published, where it is known what corrects it, and nothing of it was before."""
        device, bridge = taken.device, self._replicas.bridge(taken.device)
        if not bridge or device in self._said:
            return None
        self.ready.wanted.discard(device)  # it may be among what is still to be made ready
        key = keys.build(self._ward, "raw", bridge=bridge, device=device)
        samples = _run(decode([*takewhile(lambda message: message.key == key, taken.messages)]))
        applied = self._corrects(device, samples) if samples else None
        if applied is None:
            return None
        encoder, first = Encoder(device, taken.epoch), samples[0]
        publisher = self.ready.publisher(device)
        self._said[device] = _Said(
            publisher, encoder, applied, first.boot, first.sequence, first.sequence, first.first_s
        )
        if len(samples) == len(taken.messages):
            self._going[key] = device
        return samples

    def _corrects(self, device: str, samples: Sequence[Samples]) -> Correction | None:
        """What was said of a device last, where it corrects what comes of it now."""
        known, boot = self._replicas.of(device), samples[0].boot
        if known is None or known.boot != boot:
            return None
        remembered = self._replicas.recall(device, boot, self._now_ns())
        if known.calibration is not None and (remembered is None or remembered.calibration is None):
            return None  # of an earlier boot: whether it still holds is for its session to say
        info = self._info(known.bridge, device)
        used = None if remembered is None else remembered.calibration
        if used is not None and info is not None and info.boot == boot and changed(used, info, within_boot=True):
            return None
        last_s = samples[-1].last_s
        time_known = remembered is None or not remembered.lost_count(last_s)
        return self.ready.correction(known, last_s) if time_known else self._applied(known, last_s)

    def _applied(self, known: Checkpoint, time: float) -> Correction | None:
        """What corrects a device at a device time by what was said of it last; None where that is not enough."""
        remembered = self._replicas.recall(known.device, known.boot, self._now_ns())
        return correction(remembered, time, self._knobs(known.device))

    def _publish(self, runs: Sequence[_Run]) -> None:
        cuts = [Cut(s, self._said[run.device].applied, 0, s.n) for run in runs for s in run.samples]
        rates = iter(zip(cuts, correct(cuts), strict=True))
        for run in runs:
            these = [next(rates) for _ in run.samples]
            said, done = self._said[run.device], 0
            try:
                for done, (cut, rate) in enumerate(these, 1):  # noqa: B007 - how many were published
                    said.publisher.put(said.encoder.encode(cut, rate))
            except BusError:
                raise
            except Exception:  # noqa: BLE001 - as above
                done -= 1
                self._counts.add(FAILED)
            if done:
                first, last = run.samples[0], run.samples[done - 1]
                end, whole = last.sequence + last.n, done == len(these)
                if said.end in (first.sequence, said.begin):
                    begin = first.sequence if said.begin == said.end else said.begin
                    said = said._replace(begin=begin, end=end, last_s=last.last_s)
                elif whole and end == said.begin:
                    said = said._replace(begin=first.sequence)
                self._said[run.device] = said

    def hand_over(self, device: Device) -> None:
        """Its session is there."""
        if (said := self._leave(device.name)) is not None:
            device.foretold(said.publisher, said.boot, said.begin, said.end)

    def drop(self, device: str) -> list[Publisher]:
        """It is another's before it had a session: what was said of it may still be asked for."""
        said = self._leave(device)
        return [] if said is None else [said.publisher]

    def _leave(self, device: str) -> _Said | None:
        self._older = [run for run in self._older if run.device != device]
        self._going = {key: name for key, name in self._going.items() if name != device}
        return self._said.pop(device, None)

    def close(self) -> None:
        """Take back the publishers that nobody took over."""
        for device in list(self._said):
            for publisher in self.drop(device):
                publisher.close()
        self.ready.close()


def _run(found: Sequence[Samples | Refusal], said: _Said | None = None) -> list[Samples]:
    """The first of them, up to one that is refused or does not follow the one before, or what was said."""
    run = list[Samples]()
    for samples in found:
        if isinstance(samples, Refusal):
            break
        if run:
            before = run[-1]
            boot, following, last_s = before.boot, before.sequence + before.n, before.last_s
        elif said is not None:
            boot, following, last_s = said.boot, said.end, said.last_s
        else:
            boot, following, last_s = samples.boot, samples.sequence, samples.first_s
        if (samples.boot, samples.sequence) != (boot, following) or samples.last_s - last_s >= PLAIN_S:
            break
        if samples.first_s <= last_s and (run or said is not None):
            break
        run.append(samples)
    return run


def _recent(samples: list[Samples]) -> int:
    """The first of the messages of a device that are to be published before those of other devices."""
    last_ns, first = samples[-1].receive_time_ns, len(samples)
    if last_ns - samples[0].receive_time_ns > HUNG_NS:
        return 0
    while first > 0 and samples[first - 1].receive_time_ns >= last_ns - RECENT_NS:
        first -= 1
    return first
