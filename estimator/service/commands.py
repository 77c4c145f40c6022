"""Queue of commands from people: received on a thread of the bus, executed on the service's own thread.

A command that waited too long is not executed. `CommandHandler` executes a command, and answers once the outcome is on
disk, or after half a second of a failing disk.
"""

import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from bridge.bus.contract import Reply
from bridge.reasons.codes import Code, Sentence
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply
from bridge.wire.refusal import Refusal

#: how long a command may wait for its turn, s; with the wait for the disk shorter than the caller's own timeout
ANSWER_S = 1.0
#: most commands that wait
MOST = 64

#: executes a command; the third argument takes the reply, once it may be sent
Do = Callable[[keys.Key, Command, Callable[[CommandReply], None]], None]


class _Asked(NamedTuple):
    key: str
    payload: bytes
    reply: Reply
    came_s: float


class Commands:
    """Command queue between the bus and the service.

    ours(key): whether this estimator answers the command. counted(reason): called for each malformed command.
    others(key): called for each command that another estimator answers.
    """

    def __init__(
        self,
        ours: Callable[[keys.Key], bool] = lambda _: True,
        counted: Callable[[str], object] = lambda _: None,
        others: Callable[[keys.Key], object] = lambda _: None,
    ) -> None:
        self._ours, self._counted, self._others = ours, counted, others
        self._waiting = deque[_Asked]()

    def ask(self, key: str, payload: bytes, reply: Reply) -> None:
        """Queue a command, or refuse it when MOST commands wait; called on a thread of the bus.

        reply(payload) is called once: with the encoded reply, or empty if another estimator answers.
        """
        if len(self._waiting) >= MOST:
            _refuse(reply, Code.TOO_MANY_COMMANDS())
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
                _refuse(asked.reply, Code.COMMAND_MALFORMED(detail=refusal))
                continue
            if not self._ours(key):
                asked.reply(b"")  # another estimator answers
                self._others(key)
            elif now - asked.came_s > ANSWER_S:
                _refuse(asked.reply, Code.ESTIMATOR_BUSY(), command.request_id)
            else:
                do(key, command, partial(_answer, asked.reply))


def _answer(send: Reply, reply: CommandReply) -> None:
    send(codec.encode_reply(reply))


def _refuse(send: Reply, why: Sentence, request_id: str = "") -> None:
    _answer(send, CommandReply(request_id, accepted=False, message=(why,)))
