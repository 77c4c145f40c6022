"""Window summaries for viewers, computed for several devices at once."""

import logging
from collections import deque
from collections.abc import Sequence

from bridge.bus.contract import BusError
from bridge.wire.refusal import Tally
from estimator.device.window_summary import Second, windows
from estimator.service.device import Device

log = logging.getLogger(__name__)

#: most device seconds summarised at once, and how long fewer of them wait for more, s
AT_ONCE, WAIT_S = 64, 0.2
#: most seconds that wait; beyond that the oldest are dropped, since viewers want the present
MOST = 4096
FAILED = "windows failed"


class WindowViews:
    """Queue of device seconds, published as window summaries; `counts` are the ward's."""

    def __init__(self, counts: Tally) -> None:
        self._counts = counts
        self._waiting: deque[tuple[Device, Second]] = deque(maxlen=MOST)
        self._said = float("-inf")

    def take(self, device: Device, seconds: Sequence[Second]) -> None:
        """Queue the completed seconds of a device."""
        self._waiting.extend((device, second) for second in seconds)

    def say(self, now: float) -> None:
        """Publish due summaries, at `now` s of any steady clock."""
        if not self._waiting or (len(self._waiting) < AT_ONCE and now - self._said < WAIT_S):
            return
        self._said = now
        due = [self._waiting.popleft() for _ in range(min(AT_ONCE, len(self._waiting)))]
        try:
            for (device, _), batch in zip(due, windows([second for _, second in due]), strict=True):
                device.say_windows(batch)
        except BusError:
            raise  # a lost bus concerns all devices
        except Exception:  # any failure is contained: viewers must not stop the correction
            if self._counts.add(FAILED, len(due)) == len(due):
                log.exception("windows could not be made (more are only counted)")
