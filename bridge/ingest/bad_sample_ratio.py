"""Ratio of clipped, refused and other bad samples of one device over the last minute. No I/O; time is an argument."""

from collections import deque
from collections.abc import Mapping

from bridge.reasons.codes import Code, Sentences

_WINDOW_NS = 60_000_000_000
_NOTABLE = 0.01
_LEAST_SAMPLES = 200


class BadSampleRatio:
    """Ratio of bad samples to all samples of one boot over the last minute."""

    def __init__(self) -> None:
        self._past: deque[tuple[int, int, dict[str, int]]] = deque()  # time_ns, samples, counts

    def notable(self, time_ns: int, samples: int, counts: Mapping[str, int]) -> Sentences:
        """Return a sentence for each kind of bad sample above 1 % of the last minute's samples, largest ratio first.

        Returns () if no kind is above 1 %, or if the last minute has fewer than 200 samples.
        time_ns: time of the call, ns since the Unix epoch. samples: number of samples since boot. counts: number of bad
        samples since boot, by label.
        """
        while len(self._past) > 1 and self._past[1][0] <= time_ns - _WINDOW_NS:
            self._past.popleft()
        self._past.append((time_ns, samples, dict(counts)))
        _, before, counted = self._past[0]
        came = samples - before
        if came < _LEAST_SAMPLES:
            return ()
        shares = {label: (n - counted.get(label, 0)) / came for label, n in counts.items()}
        found = sorted(((share, label) for label, share in shares.items() if share > _NOTABLE), reverse=True)
        return tuple(Code.SAMPLES_BAD(percent=f"{min(100, 100 * share):.0f}", label=label) for share, label in found)
