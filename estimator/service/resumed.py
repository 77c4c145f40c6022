"""What an estimator that was restarted need not do again.

Bridges keep half a minute of what they sent, for whoever missed it. Most of it had been corrected, said and learnt from before
the restart; to do it again would keep what comes now waiting, of hundreds of devices for minutes. Where turns were taken of a
calibration under way all of it is: they may be in it. That takes longer than what is left of the others, and waits for them.
"""

from collections.abc import Callable, Mapping

from google.protobuf.message import DecodeError

from bridge.bus.contract import Message
from bridge.wire import columns_pb2 as columns
from bridge.wire import keys
from bridge.wire.refusal import Refusal, Tally
from estimator.service.roster import MAX_DEVICES

#: under this, samples are counted that were corrected before the restart
DONE = "samples corrected before the restart"
#: longer than a bridge's cache goes back, and than it takes to come, s
LASTS_S = 60.0
#: so much of what was done is done again, s: so long a line may be dead before what was said over it counts as lost
OVERLAP_S = 5.0

#: of a device: boot, sequence number and host time up to which it is done, and the bridge that it was heard from
Reached = tuple[int, int, int, str]


class Resumed:
    """Messages in, those that are to be handled out; `reached` is what was kept of devices, came takes numbers of samples.

    begins is told of each key that messages are left of, and whether they go on from where its device was, so that
    little is to be done.
    """

    def __init__(
        self,
        reached: Mapping[str, Reached],
        came: Callable[[int], None],
        counts: Tally,
        begins: Callable[[str, bool], None],
        now: float,
    ) -> None:
        self._reached, self._came, self._counts, self._begins = reached, came, counts, begins
        self._until = now + LASTS_S
        #: of each key where it is done up to; None from the first message on that is not
        self._keys: dict[str, Reached | None] = {}
        self._go_on = set[str]()

    @property
    def over(self) -> bool:
        """Whether all is handed out that comes."""
        return not self._reached

    def goes_on(self, key: str) -> bool:
        """Whether the first message of this key that was left goes on from where its device was."""
        return key in self._go_on

    def bridge(self, device: str, came_ns: int) -> str:
        """Whom a device was heard from before the restart, where the first that comes of it now was received before that, too.

        Another bridge may still have what it heard long ago; from which it comes by now is told by what is new.
        """
        found = self._reached.get(device)
        return "" if found is None or came_ns > found[2] else found[3]

    def left(self, messages: list[Message], now: float) -> list[Message]:
        """Those that were not done before, in their order."""
        if not self._reached:
            return messages
        if now >= self._until:
            self._reached, self._keys, self._go_on = {}, {}, set()
            return messages
        return [message for message in messages if not self._done(message)]

    def _done(self, message: Message) -> bool:
        point = self._point(message.key)
        if point is None:
            return False
        boot, last, time_ns, _ = point
        try:
            raw = columns.SampleBatch.FromString(message.payload)
        except (DecodeError, UnicodeDecodeError, RuntimeWarning):
            return False  # the door says why
        n = len(raw.ticks) // 8
        before = raw.receive_time_ns < time_ns - OVERLAP_S * 1e9  # else it is another run under the same boot number
        if raw.boot == boot and raw.sequence + n <= last and before:
            self._came(n)
            self._counts.add(DONE, n)
            return True
        self._keys[message.key] = None
        goes_on = raw.boot == boot
        if goes_on:
            self._go_on.add(message.key)
        self._begins(message.key, goes_on)
        return False

    def _point(self, key: str) -> Reached | None:
        if key in self._keys:
            return self._keys[key]
        if len(self._keys) >= MAX_DEVICES:
            return None
        try:
            found = self._reached.get(keys.parse(key).device)
        except Refusal:
            found = None
        self._keys[key] = found
        if found is None:
            self._begins(key, False)  # noqa: FBT003 - it does not go on
        return found
