"""Which devices are being calibrated, by what the estimator says of them."""

import logging

from bridge.bus.contract import Bus
from bridge.wire import keys
from bridge.wire.codec import decode_status
from bridge.wire.messages import State, Status
from bridge.wire.refusal import Refusal, Tally

_DURING = (State.AWAITING_STILL, State.BIAS_ONLY, State.TURNING)
_FORGOTTEN_S = 10.0  # an estimator speaks of each device once a second
_AT_ONCE = 1000  # messages
_MAX_DEVICES = 1000

_log = logging.getLogger(__name__)


class Calibrating:
    """The status of every device of a ward. `refused` counts what could not be understood. All times are arguments."""

    def __init__(self, bus: Bus, ward: str) -> None:
        self.refused = Tally()
        self._statuses = bus.subscribe(keys.pattern(ward, "status"), history=True, capacity=2 * _AT_ONCE)
        self._during: dict[str, tuple[int, float]] = {}  # the boot that is calibrated, and when that was said

    def hear(self, now_s: float) -> list[Status]:
        """Take what came, and give it."""
        heard: list[Status] = []
        for message in self._statuses.drain(_AT_ONCE, 0.0):
            try:
                status = decode_status(*message)
            except Refusal as refusal:
                if self.refused.add(refusal.reason) == 1:
                    _log.warning("a status is refused (more of this kind are only counted): %s", refusal)
                continue
            heard.append(status)
            self._during.pop(status.device, None)
            if status.state in _DURING:
                self._during[status.device] = (status.boot, now_s)
        while len(self._during) > _MAX_DEVICES:
            del self._during[next(iter(self._during))]
        return heard

    def now(self, device: str, boot: int, now_s: float) -> bool:
        """Whether this boot of a device is being calibrated; not if nobody has said so lately."""
        during, said_s = self._during.get(device, (0, 0.0))
        return boot != 0 and during == boot and now_s - said_s < _FORGOTTEN_S

    def close(self) -> None:
        """Hear no more."""
        self._statuses.close()
