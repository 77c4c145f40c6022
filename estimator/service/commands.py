"""Queue of commands from people: received on a thread of the bus, executed on the service's own thread.

A command repeated with the same request id gets the same answer, changes nothing, and is counted. So playing a
recording of commands has no effect. A command that waited too long is not executed. The answer is sent once it is on
disk, or after half a second of a failing disk.
"""

import time
from collections import OrderedDict, deque
from collections.abc import Callable
from typing import NamedTuple

from bridge.bus.contract import Reply
from bridge.reasons.codes import Code, Sentence
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply
from bridge.wire.refusal import Refusal

#: how long a command may wait for its turn, s; with the wait for the disk shorter than the caller's own timeout
ANSWER_S = 1.0
#: most commands that wait, and most answers that are remembered
MOST, _REMEMBERED = 64, 1000

#: executes a command; the third argument is to be called once the answer may be sent
Do = Callable[[keys.Key, Command, Callable[[], None]], CommandReply]
#: device, verb and request id: together they identify a command
Request = tuple[str, str, str]


class _Asked(NamedTuple):
    key: str
    payload: bytes
    reply: Reply
    came_s: float


class Commands:
    """Command queue between the bus and the service.

    ours(key): whether this estimator answers the command. counted(reason): called for each malformed or repeated
    command. others(key): called for each command that another estimator answers.
    """

    def __init__(
        self,
        ours: Callable[[keys.Key], bool] = lambda _: True,
        counted: Callable[[str], object] = lambda _: None,
        others: Callable[[keys.Key], object] = lambda _: None,
    ) -> None:
        self._ours, self._counted, self._others = ours, counted, others
        self._waiting = deque[_Asked]()
        self._answered = OrderedDict[Request, CommandReply]()
        #: commands executed but not on disk yet
        self._unkept = dict[Request, list[tuple[_Asked, bytes]]]()

    def ask(self, key: str, payload: bytes, reply: Reply) -> None:
        """Queue a command, or refuse it when MOST commands wait; called on a thread of the bus.

        reply(payload) is called once: with the encoded reply, or empty if another estimator answers.
        """
        if len(self._waiting) >= MOST:
            _refuse(reply, "", Code.TOO_MANY_COMMANDS())
        else:
            self._waiting.append(_Asked(key, payload, reply, time.monotonic()))

    def work(self, do: Do) -> None:
        """Execute the queued commands with `do` and send the replies; called on the service's thread.

        Malformed commands, and those that waited longer than ANSWER_S, are refused.
        """
        now = time.monotonic()
        while self._waiting:
            asked = self._waiting.popleft()
            try:
                key, command = keys.parse(asked.key), codec.decode_command(asked.key, asked.payload)
            except Refusal as refusal:
                self._counted(f"refused, {refusal.reason}")
                _refuse(asked.reply, "", Code.COMMAND_MALFORMED(detail=refusal))
                continue
            if not self._ours(key):
                asked.reply(b"")  # another estimator answers
                self._others(key)
            elif now - asked.came_s > ANSWER_S:
                _refuse(asked.reply, command.request_id, Code.ESTIMATOR_BUSY())
            else:
                self._once(asked, key, command, do)

    def _once(self, asked: _Asked, key: keys.Key, command: Command, do: Do) -> None:
        request = key.device, key.ids["verb"], command.request_id
        if request in self._answered:
            self._counted("repeated")
        else:
            self._unkept[request] = []
            self._answered[request] = do(key, command, lambda: self._kept(request))
        answer = codec.encode_reply(self._answered[request])
        while len(self._answered) > _REMEMBERED:
            self._answered.popitem(last=False)
        if (waiting := self._unkept.get(request)) is not None:
            waiting.append((asked, answer))
        else:
            asked.reply(answer)

    def _kept(self, request: Request) -> None:
        """Answer a command whose outcome is on disk."""
        for asked, answer in self._unkept.pop(request, ()):
            asked.reply(answer)


def _refuse(reply: Reply, request_id: str, why: Sentence) -> None:
    reply(codec.encode_reply(CommandReply(request_id, accepted=False, message=(why,))))
