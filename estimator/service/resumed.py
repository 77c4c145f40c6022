"""Samples that a restarted estimator receives again from the bridges' caches, and had corrected before it was restarted. Pure."""

from collections.abc import Mapping

from estimator.device.samples import Samples

#: samples corrected before the restart are counted under this name
DONE = "samples corrected before the restart"
#: longer than a bridge's cache goes back, and than it takes to come, s
LASTS_S = 60.0
#: the last seconds are published again: a line may have been dead for so long before that was noticed, s
OVERLAP_S = 5.0

#: of a device: boot, sequence number and host time, ns, up to which it was corrected; the bridge that it was heard from
Reached = tuple[int, int, int, str]


class Resumed:
    """Knows how far each device was; `now` is monotonic seconds."""

    def __init__(self, reached: Mapping[str, Reached], now: float) -> None:
        self._reached, self._until = dict(reached), now + LASTS_S

    def done(self, samples: Samples, now: float) -> bool:
        """Whether samples were corrected before the restart; another run under the same boot number was not."""
        if not self._reached:
            return False
        if now >= self._until:
            self._reached = {}
            return False
        boot, following, time_ns, _ = self._reached.get(samples.device, (-1, 0, 0, ""))
        before = samples.receive_time_ns < time_ns - OVERLAP_S * 1e9
        return samples.boot == boot and samples.sequence + samples.n <= following and before

    def bridge(self, device: str, came_ns: int) -> str:
        """The bridge that a device was heard from before the restart, for samples received before it; empty where unknown."""
        found = self._reached.get(device)
        return "" if found is None or came_ns > found[2] else found[3]
