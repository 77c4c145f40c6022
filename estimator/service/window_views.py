"""Window summaries for viewers, made for many devices at once, a few at a time."""

import logging
from collections import deque
from collections.abc import Sequence

from bridge.bus.contract import BusError
from bridge.wire.refusal import Tally
from estimator.device.window_summary import Second, windows
from estimator.service.device import Device

log = logging.getLogger(__name__)

#: seconds of devices that are told at once, and how long a few of them wait for more, s
AT_ONCE, WAIT_S = 64, 0.2
#: of more that wait the oldest are left out: who looks wants what is now
MOST = 4096
FAILED = "windows failed"


class WindowViews:
    """Takes seconds of devices and says them; `counts` are the ward's."""

    def __init__(self, counts: Tally) -> None:
        self._counts = counts
        self._waiting: deque[tuple[Device, Second]] = deque(maxlen=MOST)
        self._said = float("-inf")

    def take(self, device: Device, seconds: Sequence[Second]) -> None:
        """Seconds of a device that are over."""
        self._waiting.extend((device, second) for second in seconds)

    def say(self, now: float) -> None:
        """Publish what is due, at `now` s of any steady clock."""
        if not self._waiting or (len(self._waiting) < AT_ONCE and now - self._said < WAIT_S):
            return
        self._said = now
        due = [self._waiting.popleft() for _ in range(min(AT_ONCE, len(self._waiting)))]
        try:
            for (device, _), batch in zip(due, windows([second for _, second in due]), strict=True):
                device.say_windows(batch)
        except BusError:
            raise  # the bus itself is gone: for all
        except Exception:  # whatever it is: who only looks must not end what others rely on
            if self._counts.add(FAILED, len(due)) == len(due):
                log.exception("windows could not be made (more are only counted)")
