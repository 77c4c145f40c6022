"""Receiver of a ward's live messages, which distinguishes them from old messages that the bus has cached."""

import time

from estimator.client.client import NONE_S, Client
from estimator.overview.ward import SILENT_S, WardView

#: listening time for a first view, s; each device's status comes once a second
FIRST_S = 1.5
_STEP_S = 0.1
#: advice where no device is heard
NO_DEVICE_DO = "Start a bridge, or name the right ward (--config WARD.toml or --ward NAME)."


def interrupted(begin: float, *, heard: bool) -> None:
    """Handle Ctrl-C in a live view: raise KeyboardInterrupt if nothing can be reported yet, else return.

    A report is possible once a device was heard, or after NONE_S seconds of silence. begin: monotonic time of the
    start, s. heard: whether any device was heard.
    """
    if not heard and time.monotonic() - begin < NONE_S:
        raise KeyboardInterrupt


class LiveMessages:
    """Receiver of the statuses and infos of a client's ward; keeps the latest in `view`."""

    def __init__(self, client: Client) -> None:
        self.view = WardView()
        self._statuses, self._infos = client.follow(), client.follow_infos()

    def listen(self, for_s: float) -> None:
        """Wait `for_s` seconds, then add the messages that arrived to the view."""
        time.sleep(for_s)
        for info in self._infos.drain():
            self.view.take_info(info)
        now = time.monotonic()
        for status in self._statuses.drain():
            self.view.take_status(status, now)

    def close(self) -> None:
        """End the subscriptions; the view stays as it is."""
        self._statuses.close()
        self._infos.close()

    def settle(self, least_s: float = FIRST_S) -> None:
        """Listen for `least_s` seconds, and then until each device is known to be live or silent.

        The second part lasts at most 2 × SILENT_S seconds.
        """
        self.listen(least_s)
        end = time.monotonic() + 2 * SILENT_S
        while not self.view.settled(time.monotonic()) and time.monotonic() < end:
            self.listen(_STEP_S)
