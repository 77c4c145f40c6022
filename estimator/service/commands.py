"""Commands from people: received on a thread of the bus, executed and answered on the service's own thread.

A command repeated with the same request id gets the same answer, changes nothing, and is counted. So replaying recorded
commands has no effect. A command that waited too long is not executed. The answer is sent once the outcome is on disk,
or after half a second if the disk fails.
"""

import logging
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from bridge.bus.contract import Reply
from bridge.reasons.catalogue import english
from bridge.reasons.codes import Code, Sentence, Sentences
from bridge.wire import codec, keys
from bridge.wire.messages import Command, CommandReply, Note, Placement
from bridge.wire.refusal import Refusal
from estimator.alerts.board import Change
from estimator.service.device import Device
from estimator.service.enrolment_gate import EnrolmentGate
from estimator.service.forgetting import ERASE, FORGET, Forgetting
from estimator.service.own_alerts import OwnAlerts
from estimator.service.parts import Parts

log = logging.getLogger(__name__)

#: how long a command may wait for its turn, s; with the wait for the disk shorter than the caller's own timeout
ANSWER_S = 1.0
#: most commands that wait, and most answers that are remembered
MOST, _REMEMBERED = 64, 1000
#: most device names listed in the reply to a command for an unknown device
SHOWN = 20
#: commands executed earlier, and not executed again, are counted under this name
REPEATED = "commands repeated"


#: device, verb and request id: together they identify a command
Request = tuple[str, str, str]


class _Asked(NamedTuple):
    key: str
    payload: bytes
    reply: Reply
    came_s: float


class Commands:
    """Receiver of commands from the bus: executes them on this estimator's devices and answers them."""

    def __init__(self, parts: Parts, gate: EnrolmentGate, watch: OwnAlerts, forgetting: Forgetting) -> None:
        self._watch, self._forgetting = watch, forgetting
        self._devices, self._record, self._gate = parts.devices, parts.record, gate
        self._counts, self._now_ns, self._ours = parts.counts, parts.now_ns, parts.cluster.answers
        self._waiting = deque[_Asked]()
        self._answered = OrderedDict[Request, CommandReply]()
        #: who waits for the answers to commands that were executed but are not on disk yet
        self._unkept = dict[Request, list[Callable[[], None]]]()

    def ask(self, key: str, payload: bytes, reply: Reply) -> None:
        """Queue a command, or refuse it when MOST commands wait; called on a thread of the bus.

        key, payload: bus key and encoded command. reply(payload) is called once: with the encoded reply, or empty if
        another estimator answers.
        """
        if len(self._waiting) >= MOST:
            _refuse(reply, Code.TOO_MANY_COMMANDS())
        else:
            self._waiting.append(_Asked(key, payload, reply, time.monotonic()))

    def work(self) -> None:
        """Execute the queued commands, on the service's thread.

        Malformed commands, and commands that waited longer than ANSWER_S seconds, are refused.
        """
        now = time.monotonic()
        while self._waiting:
            asked = self._waiting.popleft()
            try:
                key, command = keys.parse(asked.key), codec.decode_command(asked.key, asked.payload)
            except Refusal as refusal:
                self._counts.add(f"commands refused, {refusal.reason}")
                _refuse(asked.reply, Code.COMMAND_MALFORMED(detail=refusal))
                continue
            if not self._ours(key):
                asked.reply(b"")  # another estimator answers
                self._forgetting.overhear(key)
            elif now - asked.came_s > ANSWER_S:
                _refuse(asked.reply, Code.ESTIMATOR_BUSY(), command.request_id)
            else:
                self.do(key, command, partial(_answer, asked.reply))

    def do(self, key: keys.Key, command: Command, answer: Callable[[CommandReply], None]) -> None:
        """Execute a command and answer it: accepted or refused, with a message.

        key: contains device id and verb. answer(reply) is called once the outcome is on disk, after half a second if
        the disk fails, or at once if nothing is stored.
        A command that was executed before is not repeated: it gets its earlier reply and is counted.
        """
        request = key.device, key.ids["verb"], command.request_id
        reply = self._answered.get(request) or self._record.answered(key, command)
        if reply is not None:
            self._counts.add(REPEATED)
        else:
            self._unkept[request] = []
            reply = self._answered[request] = self._executed(key, command, partial(self._kept, request))
            while len(self._answered) > _REMEMBERED:
                self._answered.popitem(last=False)
        if (waiting := self._unkept.get(request)) is not None:
            waiting.append(partial(answer, reply))
        else:
            answer(reply)

    def _kept(self, request: Request) -> None:
        """Answer a command whose outcome is on disk."""
        for answer in self._unkept.pop(request, ()):
            answer()

    def _executed(self, key: keys.Key, command: Command, kept: Callable[[], None]) -> CommandReply:
        """Execute a command; kept() is called once its outcome is on disk, or at once if nothing is stored."""
        verb, device = key.ids["verb"], self._devices.get(key.device)
        if verb in (FORGET, ERASE) and (device is not None or self._record.stores(key.device)):
            done, said = self._forgetting.obey(key.device, verb, command.who)
            device, reply = None, CommandReply(command.request_id, accepted=done, message=(said,))
        elif device is not None:
            reply = self._done(device, verb, command)
        else:
            kept()
            if verb == "acknowledge" and key.device == self._watch.id:
                seen = self._watch.acknowledge(command.reason.strip(), command.who, self._now_ns())
                return CommandReply(command.request_id, accepted=bool(seen), message=acknowledged(key.device, seen))
            return self._unknown(key, command)
        log.info("%s: %s by %s: %s", key.device, verb, command.who, english(*reply.message))
        self._record.audit(device, key, command, reply, kept)
        return reply

    def _unknown(self, key: keys.Key, command: Command) -> CommandReply:
        """Refuse a command for an unknown device; counted but not stored, since anybody can invent names."""
        names = sorted(self._devices)
        message = self._gate.why(key.device) or (Code.UNKNOWN_DEVICE(device=key.device), *_known(names))
        if self._counts.add("commands to unknown devices") == 1:
            log.warning(
                "%s by %s: %s (further refusals are counted, not logged)",
                key.ids["verb"],
                command.who,
                english(*message),
            )
        return CommandReply(command.request_id, accepted=False, message=message)

    def _done(self, device: Device, verb: str, command: Command) -> CommandReply:
        if verb == "acknowledge":
            seen = device.board.acknowledge(command.reason.strip(), command.who, self._now_ns())
            for change in seen:
                self._record.alert(device.name, change)
            self._devices.guard(device, lambda: device.say_status(self._now_ns()))
            return CommandReply(command.request_id, accepted=bool(seen), message=acknowledged(device.name, seen))
        refusals: list[Sentence | None] = []
        if not self._devices.guard(device, lambda: refusals.append(_obey(device, verb, command))):
            return CommandReply(command.request_id, accepted=False, message=(Code.COMMAND_FAILED(),))
        if verb == "note" and refusals[0] is None:
            note = Note(device.name, device.session.boot or 0, self._now_ns(), command.who, command.reason)
            self._devices.guard(device, device.say, "note", codec.encode_note(note))
        if verb == "place" and refusals[0] is None:
            device.placement = replace(command.placement or Placement(), since_ns=self._now_ns(), who=command.who)
            self._record.place(device.name, device.placement)
        self._devices.guard(device, lambda: device.say_status(self._now_ns()))
        self._devices.guard(device, lambda: self._record.checkpoint(device, time.monotonic(), force=True))
        if (refusal := refusals[0]) is not None:
            return CommandReply(command.request_id, accepted=False, message=(refusal,))
        done = {"note": (Code.NOTED(),), "zero-heading": (Code.HEADING_IS_ZERO(),)}
        done["place"] = (Code.PLACED(placement=device.placement) if device.placement else Code.NOBODY_WEARS(),)
        message = done.get(verb, device.session.life.goes_on)
        return CommandReply(command.request_id, accepted=True, message=message)


def _answer(send: Reply, reply: CommandReply) -> None:
    send(codec.encode_reply(reply))


def _refuse(send: Reply, why: Sentence, request_id: str = "") -> None:
    _answer(send, CommandReply(request_id, accepted=False, message=(why,)))


def acknowledged(subject: str, seen: Sequence[Change]) -> Sentences:
    """Return the reply text to an acknowledgement: which alerts were acknowledged, or that there were none.

    subject: id of a device or estimator. seen: alerts that nobody had acknowledged before.
    """
    if not seen:
        return (Code.NOTHING_TO_ACKNOWLEDGE(subject=subject),)
    return (Code.ACKNOWLEDGED(labels=", ".join(f"{subject}/{one.alert.kind}" for one in seen)),)


def _known(names: list[str]) -> Sentences:
    """The known devices as a sentence, at most SHOWN names."""
    if not names:
        return ()
    if len(names) <= SHOWN:
        return (Code.KNOWN_DEVICES(names=", ".join(names)),)
    return (Code.KNOWN_DEVICES_AND_MORE(names=", ".join(names[:SHOWN]), more=len(names) - SHOWN),)


def _obey(device: Device, verb: str, command: Command) -> Sentence | None:
    """Execute a command on the session; returns why it was refused, or None."""
    if verb == "recalibrate":
        return device.session.recalibrate(command.who, command.reason)
    if verb == "cancel":
        return device.session.cancel(command.who)
    if verb == "zero-heading":
        return device.session.zero_heading(command.who)
    if verb == "place":
        return None if command.placement or device.placement else Code.NO_PLACEMENT(device=device.name)
    return None if command.reason.strip() else Code.NOTE_EMPTY()
