"""Commands from people: asked on a thread of the bus, done on the service's own, answered with what came of it.

A command sent again with the same request id gets the same answer, changes nothing, and is counted: so a recording of commands
that is played does nothing. One that was answered as too late is not done afterwards. It is answered once it is written down.
"""

import queue
import threading
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field

from bridge.reasons.codes import Code, Sentence
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply
from bridge.wire.refusal import Refusal

#: how long a command waits for its turn, and then for its end; together less than who asks waits
ANSWER_S, FINISH_S = 1.0, 0.8
_REMEMBERED = 1000

#: is given what to call once that may be answered
Do = Callable[[keys.Key, Command, Callable[[], None]], CommandReply]


@dataclass(slots=True)
class _Asked:
    key: keys.Key
    command: Command
    done: threading.Event = field(default_factory=threading.Event)
    reply: CommandReply | None = None
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _decided: bool = False

    @property
    def request(self) -> tuple[str, str, str]:
        """By which it is the same as another."""
        return self.key.device, self.key.ids["verb"], self.command.request_id

    def decide(self) -> bool:
        """Begin it, or give it up: True for whoever comes first."""
        with self._lock:
            first, self._decided = not self._decided, True
        return first


class Commands:
    """The desk between the bus and the service. ours(device): whether it is for us to answer; from any thread."""

    def __init__(
        self, ours: Callable[[str], bool] = lambda _: True, counted: Callable[[str], object] = lambda _: None
    ) -> None:
        self._ours, self._counted = ours, counted
        self._refused: deque[str] = deque(maxlen=_REMEMBERED)  # on threads of the bus; counted on the service's own
        self._waiting: queue.Queue[_Asked] = queue.Queue(maxsize=64)
        self._answered: OrderedDict[tuple[str, str, str], CommandReply] = OrderedDict()
        self._unkept: dict[tuple[str, str, str], list[_Asked]] = {}  # those that are done, and not written down yet

    def ask(self, key: str, payload: bytes) -> bytes:
        """Called by the bus: hand a command to the service and wait for what came of it."""
        try:
            asked = _Asked(keys.parse(key), codec.decode_command(key, payload))
        except Refusal as refusal:
            self._refused.append(refusal.reason)
            return codec.encode_reply(
                CommandReply("", accepted=False, message=(Code.COMMAND_MALFORMED(detail=refusal),))
            )
        if not self._ours(asked.key.device):
            return b""  # another estimator answers
        try:
            self._waiting.put_nowait(asked)
        except queue.Full:
            return self._late(asked, Code.TOO_MANY_COMMANDS())
        if not asked.done.wait(ANSWER_S) and asked.decide():
            return self._late(asked, Code.ESTIMATOR_BUSY())
        if not asked.done.wait(FINISH_S) or asked.reply is None:
            return self._late(asked, Code.OUTCOME_UNKNOWN())
        return codec.encode_reply(asked.reply)

    def work(self, do: Do) -> None:
        """Called by the service: do what is waiting and was not given up."""
        while self._refused:
            self._counted(f"refused, {self._refused.popleft()}")
        while not self._waiting.empty():
            asked = self._waiting.get_nowait()  # nobody else takes any
            if asked.decide():
                self._once(asked, do)

    def _once(self, asked: _Asked, do: Do) -> None:
        request = asked.request
        if (before := self._answered.get(request)) is not None:
            self._counted("repeated")
            self._answer(asked, before)
            return
        self._unkept[request] = []

        def kept() -> None:
            for each in self._unkept.pop(request, ()):
                each.done.set()

        self._answered[request] = do(asked.key, asked.command, kept)
        self._answer(asked, self._answered[request])
        while len(self._answered) > _REMEMBERED:
            self._answered.popitem(last=False)

    def _answer(self, asked: _Asked, reply: CommandReply) -> None:
        """At once, or when what was done is written down."""
        asked.reply = reply
        if (waiting := self._unkept.get(asked.request)) is None:
            asked.done.set()
        else:
            waiting.append(asked)

    def _late(self, asked: _Asked, why: Sentence) -> bytes:
        return codec.encode_reply(CommandReply(asked.command.request_id, accepted=False, message=(why,)))
