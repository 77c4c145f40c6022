"""What must hold whatever happens to a ward. Pure: a history in, broken promises in words out; none is fine."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bridge.wire.messages import CorrectedBatch, Quality, SampleFlag, Verdict
from estimator.fence import FORGET_S
from estimator.service.law import EVENT
from tests.nemesis.history import Boot, History

Floats = NDArray[np.float64]
#: the true bias (3,) rad/s of a sample of a boot; LookupError where it is not known any more
Truth = Callable[[Boot, int], Floats]

#: a bias is wrong that is off by more standard deviations than this and by more than that, rad/s
WRONG_SIGMAS, WRONG = 6.0, np.radians(0.15)
_LOOKED_AT = 25  # every so many batches


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
    """Sequence numbers rise in every boot; of a boot that is over nothing comes but what is flagged late."""
    for (device, boot), heard in history.heard.items():
        due = None
        for _, batch in heard:
            if due is not None and batch.sequence < due:
                yield f"{device}, boot {boot:016x}: sample {batch.sequence} came after {due - 1}"
            due = batch.sequence + len(batch)
    for device, boots in _boots(history).items():
        latest = sorted(boots, key=lambda boot: history.heard[device, boot][0].time_s)
        for before, after in pairwise(latest):
            in_time = [one.time_s for one in history.heard[device, before] if not _late(one.batch)]
            late = max(in_time, default=-np.inf) - history.heard[device, after][0].time_s
            if late > 0:
                yield f"{device}: boot {before:016x} goes on {late:.2f} s after {after:016x} began"


def outdated(history: History) -> Iterator[str]:
    """Nothing of an older epoch after a newer one but what is flagged late, unless that is heard no more."""
    for (device, boot), heard in history.heard.items():
        newest, heard_s = 0, -np.inf
        for at_s, batch in heard:
            if batch.epoch < newest and at_s - heard_s < FORGET_S:
                if _late(batch):
                    continue
                yield (
                    f"{device}, boot {boot:016x}: sample {batch.sequence} of epoch {batch.epoch} "
                    f"{at_s - heard_s:.3f} s after {newest}"
                )
                break
            newest, heard_s = batch.epoch, at_s


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
    """Whatever was done: so many seconds after the last of it every device is heard."""
    lifted = max((done.end_s for done in history.done), default=-np.inf)
    for device, boots in _boots(history).items():
        last = max(history.heard[device, boot][-1].time_s for boot in boots)
        if history.end_s - lifted > within_s and last < history.end_s - within_s / 2:
            silent_s, since_s = history.end_s - last, history.end_s - lifted
            status_s = history.end_s - history.status_s
            yield (
                f"{device}: nothing for the last {silent_s:.1f} s, {since_s:.1f} s after the last fault; "
                f"the last status of any {status_s:.1f} s ago"
            )


def wrong(history: History, truth: Truth) -> Iterator[str]:
    """A bias that is called GOOD is what it is, give or take what it says of itself."""
    for (device, boot), heard in history.heard.items():
        for _, batch in [h for h in heard if h.batch.quality is Quality.GOOD][::_LOOKED_AT]:
            try:
                off = np.abs(batch.bias - truth((device, boot), batch.sequence))
            except LookupError:
                continue
            if np.any(off > np.maximum(WRONG, WRONG_SIGMAS * batch.bias_std)):
                yield (
                    f"{device}, sample {batch.sequence}: GOOD, and its bias is off by "
                    f"{np.degrees(off).max():.2f} °/s, ± {np.degrees(batch.bias_std).max():.2f}"
                )
                break


def broken(history: History, truth: Truth, recovered_s: float) -> list[str]:
    """All promises that were broken."""
    checks: Iterable[Iterator[str]] = (
        good_without_calibration(history),
        out_of_order(history),
        outdated(history),
        missing_unsaid(history),
        unaccounted(history),
        not_recovered(history, recovered_s),
        wrong(history, truth),
    )
    return [words for check in checks for words in check]


def _late(batch: CorrectedBatch) -> bool:
    return bool((batch.flags & SampleFlag.LATE).all())


def _boots(history: History) -> dict[str, list[int]]:
    boots: dict[str, list[int]] = defaultdict(list)
    for device, boot in history.heard:
        boots[device].append(boot)
    return boots
