"""What must hold whatever happens to a ward. Pure: a history in, broken promises in words out; none is fine."""

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise

import numpy as np

from bridge.sim.sample_source import TrueSamples
from bridge.wire.messages import Quality, SampleFlag, Verdict
from estimator.service.periodic_checks import EVENT
from tests.nemesis.history import Boot, Heard, History
from tests.nemesis.losses import invented, lost

#: what is true of samples first to last of a boot, both included; LookupError where they were never sent
Truth = Callable[[Boot, int, int], TrueSamples]

#: a bias, or a rate, is wrong that is off by more standard deviations than this and by more than that, rad/s
WRONG_SIGMAS, WRONG = 6.0, np.radians(0.15)
_LOOKED_AT = 25  # every so many batches
#: a device is heard all the time that is silent for no longer, s: then it would be called lost
_SILENT_S = 2.0
#: a batch that is heard so long after its device sent it is late, s
_LATE_S = 1.0
#: what is said at one time may be heard so much sooner on another way, s
_APART_S = 0.5


def good_without_calibration(history: History) -> Iterator[str]:
    """GOOD only with an accepted calibration of the very boot."""
    for (device, boot), heard in history.heard.items():
        for named in dict.fromkeys(h.batch.calibration for h in heard if h.batch.quality is Quality.GOOD):
            known = history.calibrations.get(named)
            if known is None:
                yield f"{device}: GOOD by calibration {named!r}, which nobody has published"
            elif (known.device, known.boot) != (device, boot):
                yield f"{device}: GOOD by calibration {named} of {known.device}, boot {known.boot:016x}, in {boot:016x}"
            elif known.verdict is not Verdict.ACCEPTED:
                yield f"{device}: GOOD by calibration {named}, which was {known.verdict.name}"


def out_of_order(history: History) -> Iterator[str]:
    """Sequence numbers rise in every boot."""
    for (device, boot), heard in history.heard.items():
        due = None
        for _, batch in heard:
            if due is not None and batch.sequence < due:
                yield f"{device}, boot {boot:016x}: sample {batch.sequence} came after {due - 1}"
            due = batch.sequence + len(batch)


def said_again(history: History) -> Iterator[str]:
    """An estimator says a sample once in a turn, though not always in order, and nothing of a boot that is over."""
    said: dict[tuple[str, int], dict[int, list[tuple[int, int]]]] = defaultdict(dict)
    for _, batch in history.said:
        boots = said[batch.device, batch.epoch]
        if batch.boot in boots and batch.boot != next(reversed(boots)):
            yield f"{batch.device}: boot {batch.boot:016x} was over in epoch {batch.epoch}, and {batch.sequence} of it is said"
            return
        boots.setdefault(batch.boot, []).append((batch.sequence, batch.sequence + len(batch)))
    for (device, epoch), boots in said.items():
        for boot, spans in boots.items():
            for (_, end), (again, _) in pairwise(sorted(spans)):
                if again < end:
                    yield f"{device}, boot {boot:016x}: sample {again} is said again in epoch {epoch}"
                    return


def outdated(history: History) -> Iterator[str]:
    """Nothing of an older epoch is given that a newer one had said."""
    said: dict[tuple[str, int], dict[int, list[tuple[int, int, float]]]] = defaultdict(lambda: defaultdict(list))
    for at_s, batch in history.said:
        said[batch.device, batch.boot][batch.epoch].append((batch.sequence, batch.sequence + len(batch), at_s))
    for (device, boot), heard in history.heard.items():
        epochs = {epoch: np.array(messages) for epoch, messages in said[device, boot].items()}
        for at_s, batch in heard if len(epochs) > 1 else ():
            for newer in [epoch for epoch in epochs if epoch > batch.epoch]:
                first, end, said_s = epochs[newer].T
                over = (first < batch.sequence + len(batch)) & (end > batch.sequence) & (said_s < at_s - _APART_S)
                if over.any():
                    yield (
                        f"{device}, boot {boot:016x}: sample {batch.sequence} of epoch {batch.epoch} is given, of which epoch "
                        f"{newer} had said some {at_s - said_s[over].min():.1f} s before"
                    )
                    return


def missing_unsaid(history: History) -> Iterator[str]:
    """A hole in a boot is told to the application, sample by sample."""
    told: dict[Boot, int] = defaultdict(int)
    for miss in history.misses:
        told[miss.device, miss.boot] += miss.count
    for (device, boot), heard in history.heard.items():
        holes = sum(
            after.batch.sequence - before.batch.sequence - len(before.batch) for before, after in pairwise(heard)
        )
        if holes > told[device, boot]:
            yield f"{device}, boot {boot:016x}: {holes} samples are missing, {told[device, boot]} were told"


def unaccounted(history: History) -> Iterator[str]:
    """in = out + dropped, at the end and in every second."""
    for device, status in history.statuses.items():
        out = status.samples_out + sum(status.dropped.values())
        if status.samples_in != out:
            yield f"{device}: {status.samples_in} samples in, {out} out or dropped: {dict(status.dropped)}"
    yield from (f"{device}: {event}" for device, event in sorted(history.events) if event == EVENT)


def not_recovered(history: History, within_s: float) -> Iterator[str]:
    """Whatever was done: so many seconds after it every device is heard as it lives, without a break, until more is done."""
    for lifted_s, until_s in _spells(history, within_s):
        for device, heard in _by_device(history).items():
            due_s, live = lifted_s + within_s, [h.time_s for h in heard if not _late(history, h)]
            times = sorted([due_s, until_s, *(s for s in live if due_s < s < until_s)])
            silent_s, at_s = max((after - before, before) for before, after in pairwise(times))
            if silent_s > _SILENT_S:
                status_s = history.end_s - history.status_s
                yield (
                    f"{device}: nothing that is not late for {silent_s:.1f} s, from {at_s - lifted_s:.1f} s after "
                    f"what was done before; the last status of any {status_s:.1f} s before the end"
                )
                break


def good_no_more(history: History, within_s: float) -> Iterator[str]:
    """A calibration outlives whatever is done: so long after it what was GOOD is so again."""
    for lifted_s, until_s in _spells(history, within_s):
        for (device, boot), heard in history.heard.items():
            first_s = min((h.time_s for h in heard if h.batch.quality is Quality.GOOD), default=np.inf)
            begin_s = max(first_s, lifted_s + within_s)
            for at_s, batch in heard:
                if begin_s < at_s < until_s and batch.quality is not Quality.GOOD:
                    yield (
                        f"{device}, boot {boot:016x}: sample {batch.sequence} is {batch.quality.name}, "
                        f"{at_s - lifted_s:.1f} s after what was done before, {at_s - first_s:.1f} s after it was GOOD first"
                    )
                    break


def wrong(history: History, truth: Truth) -> Iterator[str]:
    """Bias and rates that are called GOOD are what they are, give or take what is said of them."""
    for (device, boot), heard in history.heard.items():
        for _, batch in [h for h in heard if h.batch.quality is Quality.GOOD][::_LOOKED_AT]:
            try:
                true = truth((device, boot), batch.sequence, batch.sequence + len(batch) - 1)
            except LookupError:
                continue  # such as no device has sent are found elsewhere
            sound = (batch.flags & ~np.uint32(SampleFlag.LATE)) == 0
            for what, off, std in (
                ("bias", np.abs(batch.bias - true.bias[0])[None], batch.bias_std[None]),
                ("rate", np.abs(batch.rate - true.rate)[sound], batch.rate_std[sound]),
            ):
                if np.any(off > np.maximum(WRONG, WRONG_SIGMAS * std)):
                    yield (
                        f"{device}, sample {batch.sequence}: GOOD, and its {what} is off by "
                        f"{np.degrees(off).max():.2f} °/s, ± {np.degrees(std).max():.2f}"
                    )
                    return


def not_understood(history: History) -> Iterator[str]:
    """All that is said can be read."""
    yield from (f"{count} messages were refused: {why}" for why, count in history.refused.items())


def broken(history: History, truth: Truth, recovered_s: float) -> list[str]:
    """All promises that were broken."""
    checks: Iterable[Iterator[str]] = (
        good_without_calibration(history),
        out_of_order(history),
        said_again(history),
        outdated(history),
        invented(history),
        lost(history),
        missing_unsaid(history),
        unaccounted(history),
        not_recovered(history, recovered_s),
        good_no_more(history, recovered_s),
        wrong(history, truth),
        not_understood(history),
    )
    return [words for check in checks for words in check]


def _late(history: History, heard: Heard) -> bool:
    """Whether a batch was heard long after its device had sent it."""
    batch = heard.batch
    sent = history.sent.get((batch.device, batch.boot), [])
    n = bisect_left(sent, batch.sequence + len(batch), key=lambda one: one.samples)
    return n < len(sent) and heard.time_s - sent[n].time_s > _LATE_S


def _spells(history: History, longer_s: float) -> list[tuple[float, float]]:
    """From when to when nothing was done, monotonic s, after something was; those that last longer."""
    found: list[tuple[float, float]] = []
    lifted_s = np.inf
    for done in sorted(history.done, key=lambda done: done.begin_s):
        found.append((lifted_s, done.begin_s))
        lifted_s = max(done.end_s, lifted_s if np.isfinite(lifted_s) else done.end_s)
    found.append((lifted_s, history.end_s))
    return [(begin_s, end_s) for begin_s, end_s in found if end_s - begin_s > longer_s]


def _by_device(history: History) -> dict[str, list[Heard]]:
    found: dict[str, list[Heard]] = defaultdict(list)
    for (device, _), heard in history.heard.items():
        found[device] += heard
    return found
